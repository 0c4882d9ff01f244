"""Limits of the verdict and of the comparison of priors: just within and just beyond each, as docs/validation.md states them."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import binom, norm

from stoop.assessment.prior_conflicts import prior_tests
from stoop.assessment.verdict import verdict
from stoop.results import result as results
from stoop.results.extensions import ExtensionTest, ExtensionTests, ResponseMisfit
from stoop.results.result import GoodnessOfFit, ManeuverResult, ParameterEstimate, Result
from stoop.results.uncertainty import ParameterRepeatability, Repeatability
from stoop.results.verdict import Need, Use
from stoop.vehicle.vehicle import Parameter

GOOD, LOST = GoodnessOfFit(0.1, 0.1, 0.9, 0.2), GoodnessOfFit(0.5, 0.5, 0.1, 0.2)
TRUSTED, USABLE, REFUSED = "trusted", "usable", "do not use"


def flown(start: float, role: Any, **channels: GoodnessOfFit) -> ManeuverResult:
    return ManeuverResult("f", start, start + 5.0, role, (), {"p": GOOD, "V": GOOD} | channels)


def result(held_back: dict[str, GoodnessOfFit] | None = None, **changes: Any) -> Result:
    """Return a trusted result of two maneuvers and one held back; noise is 1 in each channel."""
    parameters = changes.pop("parameters", {"Clp": ParameterEstimate(-0.5, 0.01)})
    covariance = results.Covariance(tuple(parameters), np.diag([p.std_error**2 for p in parameters.values()]))
    maneuvers = flown(0.0, "fit"), flown(5.0, "fit"), flown(10.0, "validation", **held_back or {})
    made = Result(
        parameters, covariance, results.NoiseCovariance(("p", "V"), np.eye(2)), (), (), (), maneuvers, 1.0, 10.0, 1.0, 0, "lm",
        "converged", extensions=ExtensionTests(100, 0.01),
    )  # fmt: skip
    return replace(made, **changes)


def grade(found: Result, size: float = 0.0) -> str:
    need = Need("damping in roll", ("Clp",), (size,) if size else (), "mass.inertia.xx")
    return verdict(found, (Use("control design", ("p", "V"), (need,)),)).grade


def lacks(moved: float, error: float = 0.01) -> Result:
    test = ExtensionTest("x.lag", "lag", 0.04, 0.004, "s", 10.0, 1e-9, 50.0, "line", moves={"Clp": moved})
    known = {"Clp": ParameterEstimate(-0.5, error)}
    return result(parameters=known, extensions=ExtensionTests(100, 0.01, (test,)))


def colored(p_value: float) -> Result:
    white = results.Whiteness(0.0, 20.0, 20, p_value, "white" if p_value > 0.05 else "colored")
    figures = results.InnovationFigures(1.0, 0.95, white)
    return result({c: replace(GOOD, innovations=figures) for c in ("p", "V")})


def scattered(count: int) -> Result:
    each = {f"C{i}": ParameterRepeatability((), chi_square=1.0, degrees=1, verdict="scatter" if i < count else "agree")
            for i in range(20)}  # fmt: skip
    return result(repeatability=Repeatability((0, 1), each))


def unknown(count: int) -> Result:
    others = {f"C{i}": ParameterEstimate(1.0, 0.01, identifiable=i >= count) for i in range(7)}
    return result(parameters={"Clp": ParameterEstimate(-0.5, 0.01)} | others)


def twice(first: dict[str, GoodnessOfFit], second: dict[str, GoodnessOfFit]) -> Result:
    found = result(first)
    return replace(found, maneuvers=(*found.maneuvers, flown(15.0, "validation", **second)))


def by_priors(share: float) -> Result:
    """Return a result that knows Clp, and the inertia it counts over, by a share of the errors of their priors of 10 %."""
    parameters = {
        "Clp": ParameterEstimate(-0.5, 0.05 * share, identifiable=False, prior_std=0.05),
        "mass.inertia.xx": ParameterEstimate(1.0, 0.1 * share, prior_std=0.1),
    }
    return result(parameters=parameters)


#: least number of 20 comparisons at 5 % that are no chance at 1 %
NO_CHANCE = next(k for k in range(20) if binom.sf(k - 1, 20, 0.05) < 0.01)
Row = tuple[Any, str, Any, str]  #: within and its grade, beyond and its grade
ROWS: dict[str, Row] = {
    "error 0.2": (lambda: grade(result(parameters={"Clp": ParameterEstimate(-0.5, 0.0999)})), TRUSTED,
                  lambda: grade(result(parameters={"Clp": ParameterEstimate(-0.5, 0.1001)})), REFUSED),
    "minor 0.1": (lambda: grade(result(parameters={"Clp": ParameterEstimate(-0.001, 0.019)}), 1.0), TRUSTED,
                  lambda: grade(result(parameters={"Clp": ParameterEstimate(-0.001, 0.021)}), 1.0), REFUSED),
    "no size": (lambda: grade(result(parameters={"Clp": ParameterEstimate(0.0, 0.019)}), 1.0), TRUSTED,
                lambda: grade(result(parameters={"Clp": ParameterEstimate(0.0, 0.019)})), REFUSED),
    "moved_errors 3": (lambda: grade(lacks(2.99)), USABLE, lambda: grade(lacks(3.01)), REFUSED),
    "moved_share 0.05": (lambda: grade(lacks(4.9, 0.005)), USABLE, lambda: grade(lacks(5.1, 0.005)), REFUSED),
    "unknown 0.5": (lambda: grade(unknown(4)), USABLE, lambda: grade(unknown(5)), REFUSED),
    "not_predicted 0.5": (lambda: verdict(result({"V": LOST, "q": LOST, "r": GOOD}), ()).grade, USABLE,
                          lambda: verdict(result({"V": LOST, "q": LOST, "r": LOST}), ()).grade, REFUSED),
    "not_predicted 0.5 of a channel": (
        lambda: grade(twice({"V": LOST}, {})), TRUSTED, lambda: grade(twice({"V": LOST}, {"V": LOST})), REFUSED),
    "prior_share 0.5": (lambda: grade(by_priors(0.499)), USABLE, lambda: grade(by_priors(0.501)), REFUSED),
    "inside 0.75": (lambda: grade(result({"V": replace(GOOD, inside=0.75)})), TRUSTED,
                    lambda: grade(result({"V": replace(GOOD, inside=0.7499)})), USABLE),
    "motion 3": (lambda: grade(result({c: replace(LOST, signal_to_noise=2.99) for c in "pV"})), USABLE,
                 lambda: grade(result({c: replace(LOST, signal_to_noise=3.0) for c in "pV"})), REFUSED),
    "size 1000": (lambda: grade(result({"V": replace(GOOD, rmse=1000.0)})), TRUSTED,
                  lambda: grade(result({"V": replace(GOOD, rmse=1000.1)})), REFUSED),
    "chance 0.01 of innovations": (lambda: grade(colored(0.0101)), TRUSTED, lambda: grade(colored(0.0099)), USABLE),
    "chance 0.01 of scatter": (lambda: grade(scattered(NO_CHANCE - 1)), TRUSTED,
                               lambda: grade(scattered(NO_CHANCE)), USABLE),
    "error 0.2 of a response": (
        lambda: grade(result(response_misfits=(ResponseMisfit("aileron", "p", 3.0, 30.0, 0.9, 0.3, 0.2),))), TRUSTED,
        lambda: grade(result(response_misfits=(ResponseMisfit("aileron", "p", 3.0, 30.0, 0.9, 0.3, 0.2001),))), REFUSED),
}  # fmt: skip


@pytest.mark.parametrize("limit", ROWS)
def test_the_grade_changes_at_the_limit(limit: str) -> None:
    within, before, beyond, after = ROWS[limit]
    assert (within(), beyond()) == (before, after)


def conflicts(offsets: list[float], information: float) -> int:
    """Return how many priors N(0, 1) contradict a flight that says `offsets` of their numbers, each with this information."""
    count, precise = len(offsets), information + 1.0
    names = [f"C{i}" for i in range(count)]
    priors = [Parameter(n, 0.0, -99.0, 99.0, True, 1.0, "1") for n in names]
    estimates = {n: x * information / precise for n, x in zip(names, offsets, strict=True)}
    problem, inverse = SimpleNamespace(layout=SimpleNamespace(parameters=priors)), np.eye(count) / precise
    fit: Any = SimpleNamespace(problem=problem, estimates=estimates)
    found = SimpleNamespace(information=precise * np.eye(count), corrected=inverse, cramer_rao=inverse)
    bars: Any = SimpleNamespace(free=np.arange(count), uncertainty=found, of_free=lambda *names: inverse)
    return len(prior_tests(fit, bars).conflicts)


def test_a_prior_contradicts_the_flight_from_one_percent_on() -> None:
    """The difference over the root of both variances, two-sided, shared by the priors that the flight tells something of."""
    spread = np.sqrt(1.0 + 1.0 / 9.0)
    for count, quantile in ((1, norm.isf(0.005)), (2, norm.isf(0.0025)), (5, norm.isf(0.001))):
        for factor, found in ((0.999, 0), (1.001, 1)):
            offsets = [factor * quantile * spread, *[0.0] * (count - 1)]
            assert conflicts(offsets, 9.0) == found, (count, factor)
            assert conflicts([-x for x in offsets], 9.0) == found


def test_a_prior_is_compared_where_the_flight_takes_a_twentieth_off_its_error() -> None:
    """With information d the error is 1 / sqrt(1 + d) of the prior's."""
    assert [conflicts([50.0], d) for d in (0.95**-2.0 - 1.0001, 0.95**-2.0 - 0.9999)] == [0, 1]
