"""Bootstrap and PRESS of regressions: the packed linear problem, against the corrected errors and refits from the start."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest

from stoop.assessment.assessment import Finding, pack, packed, unpack
from stoop.assessment.bootstrap import Bootstrap
from stoop.assessment.error_bars import error_bars
from stoop.assessment.goodness_of_fit import left_out_residuals, press_notices
from stoop.estimate.estimate import Estimate
from stoop.estimate.fit import Options
from stoop.estimate.regression.linear_problem import LinearProblem
from stoop.estimate.regression.method import equation_error, frequency_domain
from stoop.flight import Flight
from stoop.parallel import Given
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

NAMES = ("CLalpha", "Cmalpha", "Cmq", "Clp", "Cnbeta", "Cmelevator", "Claileron")
METHODS = {"equation-error": equation_error, "frequency-domain": frequency_domain}


@pytest.fixture(scope="module", params=METHODS)
def fit(request: pytest.FixtureRequest, full: Vehicle, noisy: Flight) -> Estimate:
    options = Options(method=request.param)
    freed = full.with_numbers({"CLalpha": {"prior": 0.5}})
    return METHODS[request.param](freed, {"noisy": noisy}, [Window("noisy", 0.0, 25.0)], options)


def bootstrap(
    fit: Estimate, count: int = 100, store: Path | None = None, watch: object = lambda _: None
) -> Finding:
    assessment = Bootstrap(count, Given(ThreadPoolExecutor(1)), store)
    return assessment(fit, error_bars(fit), 0, watch)  # type: ignore[arg-type]


def test_a_problem_comes_back_from_text_with_the_same_residuals(fit: Estimate) -> None:
    problem = fit.refit_problem
    again, arrays = unpack(packed(fit, error_bars(fit), {}))
    assert isinstance(again, LinearProblem)
    Z = fit.z + 1e-3 * np.random.default_rng(0).standard_normal((3, len(fit.z)))
    np.testing.assert_array_equal(again.residuals(Z, 0), problem.residuals(Z, 0))
    assert again.deviations == problem.deviations  # type: ignore[union-attr]
    assert pack(again, {"z": arrays["z"]}) == pack(problem, {"z": fit.z})


def test_the_bootstrap_agrees_with_the_corrected_errors(fit: Estimate) -> None:
    found = bootstrap(fit, 300).intervals
    std = dict(zip(fit.estimates, error_bars(fit).std, strict=False))
    ratios = [found.parameters[name].std_error / std[name] for name in NAMES]
    assert np.median(ratios) == pytest.approx(1.0, abs=0.15)
    assert found.figures == {"replicates": 300.0, "refined": 0.0, "failed": 0.0}


def test_press_is_the_error_of_refits_without_each_second(fit: Estimate) -> None:
    """Done again from the whitened rows and the priors by a general solver, every row of a second left out."""
    (found,) = press_notices(fit)
    problem = fit.refit_problem
    assert isinstance(problem, LinearProblem)
    assert left_out_residuals(fit) is None  # of channels it has none
    free = fit.evidence.free
    stated = np.flatnonzero(np.diag(fit.evidence.prior)[free])
    priors = np.diag(np.sqrt(np.diag(fit.evidence.prior)))[free][:, free][stated]
    block = round(1.0 / problem.dt) if np.isfinite(problem.dt) else 1
    rows = [(s.residual, s.jacobian[:, :, free]) for s in problem.stretches]
    (e, J), means = rows[0], rows[1:]
    others = [(r.ravel(), j.reshape(-1, len(free))) for r, j in means]
    missed = []
    for first in range(0, len(e), block):
        kept = np.ones(len(e), dtype=bool)
        kept[first : first + block] = False
        A = np.concatenate([J[kept].reshape(-1, len(free)), *(j for _, j in others), priors])
        y = np.concatenate([e[kept].ravel(), *(r for r, _ in others), np.zeros(len(priors))])
        size = np.linalg.norm(A, axis=0)
        step = np.linalg.lstsq(A / size, y, rcond=None)[0] / size
        missed.append(e[~kept] - J[~kept] @ step)
    # the estimates are the optimum of the old weights: what is left of the gradient is the naive refit's alone
    naive = np.sqrt(np.mean(np.concatenate(missed) ** 2, axis=0)) * list(problem.deviations.values())
    assert found.values["press"] == pytest.approx(naive.tolist(), rel=1e-3)
    assert found.values["equations"] == ("CL", "CD", "CQ", "Cl", "Cm", "Cn")
    assert all(p > r for p, r in zip(found.values["press"], found.values["rms"], strict=True))  # type: ignore[arg-type]
