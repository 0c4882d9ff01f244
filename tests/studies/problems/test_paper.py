import numpy as np
import pytest

from stoop.errors import IdentificationError
from stoop.workflow.demo import TABLE_1
from stoop_studies.problems import pose
from stoop_studies.problems.paper import NEAR, paper

EXPERIMENT = dict(
    zip(TABLE_1, (0.06, 0.43, 0.385, 4.78, 10.47, 0.201, 0.194, -2.12, -47.6, -0.8), strict=True)
)  #: of the paper's Table 1


def test_the_truth_is_the_papers_and_costs_nothing() -> None:
    posed = pose("paper-W", 5)
    assert posed.truth is not None
    assert dict(zip(posed.parameters, posed.truth.tolist(), strict=True)) == EXPERIMENT
    layout = paper().problem("W", 5, noise=False).layout
    x = layout.unit(posed.truth)
    assert posed.values(x) == pytest.approx(posed.truth)
    assert posed.problem.costs(x[None], len(posed.problem.prices) - 1)[0] < 1e-12 * posed.reference
    assert posed.target == NEAR * posed.reference
    assert (np.abs(x - 0.5) > 0.02).any(), "never on purpose in the middle"


def test_noise_moves_the_optimum_and_the_target_follows_it() -> None:
    posed = pose("paper-N+noise", 5)
    assert posed.truth is not None
    x = paper().problem("N", 5, noise=True).layout.unit(posed.truth)
    at_truth = posed.problem.costs(x[None], len(posed.problem.prices) - 1)[0]
    assert posed.target < at_truth
    assert at_truth == pytest.approx(9000.0, rel=0.05), "the sum of squares of 6 x 1500 unit residuals"
    assert at_truth - posed.target == pytest.approx(10.0, abs=15.0), "chi square of ten parameters"


def test_few_sensors_leave_the_others_out() -> None:
    few, all_six = pose("paper-N+few", 1), pose("paper-N", 1)
    assert few.reference < all_six.reference
    x = np.full((1, 10), 0.4)
    residuals = few.problem.residuals(x, len(few.problem.prices) - 1).reshape(-1, 6)
    assert (np.abs(residuals).sum(axis=0) > 0.0).tolist() == [True, False, True, True, False, False]


def test_unknown_arguments_are_refused() -> None:
    with pytest.raises(IdentificationError, match="paper-N: knows no flight; leave it out"):
        pose("paper-N", 0, flight="x")
    with pytest.raises(IdentificationError, match="lateral: knows no flight, wind; leave it out"):
        pose("lateral", 0, wind="x", flight="y")
