"""Bootstrap, profile and PRESS of filter error and multiple shooting; the posterior of a regression is refused."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest
from unit.flown import maneuver, with_few_free

from stoop import Bootstrap, FittedModel, Options, Profile, load_vehicle, simulate_flight
from stoop.assessment.assessment import check_method
from stoop.errors import IdentificationError
from stoop.optimize.normal_equations import dense
from stoop.parallel import Given
from stoop.vehicle import parse_vehicle
from stoop.workflow import identify

DELAY = "sensors.alpha.delay"
FREE = ("CLalpha", "Cmalpha", "Cmq", "Cmelevator")
MANEUVER = maneuver(10.0, ("elevator", "3-2-1-1", 0.5, 0.4, 0.05), ("elevator", "doublet", 5.0, 0.6, 0.04))


@pytest.fixture(scope="module", params=["filter-error", "multiple-shooting"])
def job(request: pytest.FixtureRequest) -> FittedModel:
    text = load_vehicle("twin-boom").text + "[sensors.alpha]\ndelay = 0.033\n"
    late = {DELAY: {"free": request.param == "multiple-shooting", "bounds": (0.0, 0.1)}}
    vehicle = with_few_free(parse_vehicle(text, "late").reduced("longitudinal"), FREE).with_numbers(late)
    flight = simulate_flight(vehicle, MANEUVER, seed=3, name="sim")
    return identify(vehicle, flight, ["0:10"], options=Options(method=request.param))


def test_residuals_and_derivatives_are_those_of_the_evidence(job: FittedModel) -> None:
    problem, evidence = job.estimate.refit_problem, job.estimate.evidence
    r = problem.residuals(job.estimate.z[None], 0)[0]
    (piece,) = evidence.pieces
    assert -r[: piece.residual.size] == pytest.approx(piece.filled()[0].ravel(), abs=1e-6)
    J = dense(problem.jacobian(job.estimate.z, 0, r)[0])
    expected = piece.filled()[1].reshape(piece.residual.size, -1)[:, : len(job.estimate.z)]
    found = J[: piece.residual.size] / job.estimate.problem.layout.scales
    size = np.linalg.norm(expected, axis=0)
    assert np.linalg.norm(found - expected, axis=0)[size > 0.0] == pytest.approx(0.0, abs=0.05 * size.max())
    own = size[: len(FREE)]
    assert np.linalg.norm((found - expected)[:, : len(FREE)], axis=0) / own == pytest.approx(0.0, abs=0.05)


def test_bootstrap_and_profile_agree_with_the_corrected_errors(job: FittedModel) -> None:
    free = [p.name for p in job.estimate.problem.layout.parameters]
    own = ("Cmq", DELAY) if DELAY in free else ("Cmq",)
    pool = Given(ThreadPoolExecutor(1))
    result = job.assess(Bootstrap(100, pool), Profile(own, pool)).result
    corrected, found = (result.uncertainty[m].parameters for m in ("corrected", "bootstrap"))
    ratios = [found[n].std_error / corrected[n].std_error for n in FREE]
    assert float(np.median(ratios)) == pytest.approx(1.0, abs=0.25)
    assert result.uncertainty["bootstrap"].figures["failed"] == 0.0
    for name in own:
        profile = result.uncertainty["profile"].parameters[name]
        assert profile.std_error == pytest.approx(corrected[name].std_error, rel=0.2)
        assert profile.ci95_lower < result.parameters[name].estimate < profile.ci95_upper
        assert found[name].std_error == pytest.approx(corrected[name].std_error, rel=0.35)


@pytest.mark.parametrize("method", ["equation-error", "frequency-domain"])
def test_the_likelihood_of_a_regression_has_no_shape_of_its_own(method: str) -> None:
    check_method(method, ["bootstrap"])
    for name in ("posterior", "profile"):
        with pytest.raises(IdentificationError, match=f"{name}: --method {method} is a linear regression"):
            check_method(method, ["bootstrap", name])
