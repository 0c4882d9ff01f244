"""Agreement of maneuvers and of methods, and draws of estimates: by hand, by chance, and against SciPy."""

import math
from math import nan

import numpy as np
import pytest

from stoop.assessment.uncertainty import agreement, method_agreement, scatter, without_prior
from stoop.errors import StoopError
from stoop.results import uncertainty as of
from stoop.results.result import Covariance, ManeuverResult, NoiseCovariance, ParameterEstimate, Result


def singles(values: list[float], errors: list[float]) -> list[of.SingleEstimate]:
    return [of.SingleEstimate(v, e, counted=True) for v, e in zip(values, errors, strict=True)]


def test_by_hand() -> None:
    found = scatter(singles([1.0, 2.0], [1.0, 0.5]))
    assert (found.mean, found.std_error) == pytest.approx((9.0 / 5.0, math.sqrt(1.0 / 5.0)))
    assert found.chi_square == pytest.approx(0.8**2 + (0.2 / 0.5) ** 2)
    assert (found.degrees, found.verdict) == (1, "agree")
    # chi-square of one degree is a normal
    assert found.p_value == pytest.approx(math.erfc(math.sqrt(0.8 / 2.0)))


def test_what_is_not_counted_does_not_count() -> None:
    some = [*singles([1.0, 1.1], [0.1, 0.1]), of.SingleEstimate(9.0, 0.1, counted=False)]
    found, alone, nobody = scatter(some), scatter(some[1:]), scatter(some[2:])
    assert (found.mean, found.degrees, len(found.singles)) == (pytest.approx(1.05), 1, 3)
    assert (alone.mean, alone.degrees, alone.verdict) == (1.1, 0, "")
    assert (math.isnan(nobody.mean), nobody.verdict) == (True, "")


def test_taking_the_prior_out_gives_what_the_data_alone_say() -> None:
    data, error, mean, prior = 2.0, 0.4, 1.0, 0.6
    weight = error**-2 + prior**-2
    both, spread = (data / error**2 + mean / prior**2) / weight, weight**-0.5
    found = without_prior(both, spread, spread**2 / prior**2, mean, prior)
    assert found.counted
    assert (found.estimate, found.std_error) == pytest.approx((data, error))
    assert not without_prior(1.0, 0.5, 0.8, 1.0, 0.55).counted
    assert without_prior(1.0, 0.5, 0.0, nan, nan) == of.SingleEstimate(1.0, 0.5, counted=True)
    assert not without_prior(1.0, math.inf, 0.0, nan, nan).counted


def result(at: dict[str, float], error: float, flight: str, prior: float = nan, **changes: object) -> Result:
    """Return a result of one maneuver whose every estimate has the same standard error, the prior's part included."""
    empty = np.empty((0, 0))
    given = {
        "parameters": {n: ParameterEstimate(v, error, prior_mean=0.0, prior_std=prior) for n, v in at.items()},
        "covariance": Covariance((), empty), "noise_covariance": NoiseCovariance((), empty),
        "initial_states": (), "biases": (), "wind": (), "cost": 1.0, "trajectories": 1.0, "seconds": 1.0, "seed": 0,
        "optimizer": "", "status": "converged", "inputs": {f"{flight}.nc": flight},
        "maneuvers": (ManeuverResult(flight, 0.0, 10.0, "fit", (), {}),),
        "uncertainty": {"cramer_rao": of.MethodIntervals({n: of.Interval(error) for n in at})},
    }  # fmt: skip
    return Result(**{**given, **changes})  # type: ignore[arg-type]


def test_the_scatter_ratio_is_the_root_of_chi_square_over_degrees_of_freedom() -> None:
    compared = {
        verdict: of.ParameterRepeatability((), chi_square=square, degrees=degrees, verdict=verdict)
        for square, degrees, verdict in ((4.0, 2, "agree"), (8.0, 4, "scatter"), (99.0, 0, ""))
    }
    assert of.Repeatability(parameters=compared).scatter_ratio == pytest.approx(math.sqrt(12.0 / 6.0))


@pytest.mark.parametrize("prior", [nan, 0.5])
def test_flights_with_right_error_bars_agree_in_19_parameters_of_20(prior: float) -> None:
    """Also where a prior pulls both toward its mean, beside which they agree too well."""
    random, names, error = np.random.default_rng(1), [f"C{i}" for i in range(2000)], 0.4
    pull = 1.0 / (1.0 + error**2 / prior**2) if prior > 0.0 else 1.0
    truth, flights = random.normal(0.0, 0.5, len(names)), {}
    for flight in ("one", "two"):
        drawn = dict(zip(names, (pull * random.normal(truth, error)).tolist(), strict=True))
        flights[flight] = result(drawn, error * math.sqrt(pull), flight, prior)
    found = agreement(flights)
    assert found.share_agreeing == pytest.approx(0.95, abs=0.015)
    assert found.scatter_ratio == pytest.approx(1.0, abs=0.05)


def correlated(random: np.random.Generator, flight: str, truth: np.ndarray) -> Result:
    """Return a result whose four estimates are off by errors of strong correlations, each with its own scale."""
    scales, rho = np.array([1.0, 0.01, 30.0, 0.5]), 0.8
    C = (rho + (1.0 - rho) * np.eye(4)) * np.outer(scales, scales)
    drawn = random.multivariate_normal(truth, C).tolist()
    known = {n: ParameterEstimate(v, s) for n, v, s in zip("abcd", drawn, scales.tolist(), strict=True)}
    return result({}, 0.1, flight, parameters=known, uncertainty={}, covariance=Covariance(tuple("abcd"), C))


def test_the_joint_test_rejects_right_error_bars_as_often_as_promised() -> None:
    random, truth = np.random.default_rng(0), np.array([1.0, 2.0, -3.0, 0.0])
    found = [agreement({n: correlated(random, n, truth) for n in "xyz"}).joint for _ in range(1000)]
    assert {one.degrees for one in found} == {8}
    assert 0.035 < np.mean([one.p_value < 0.05 for one in found]) < 0.065
    # two that are off by less than two standard errors of their difference each, one up and one down
    moved = truth + np.array([1.5, -0.015, 45.0, -0.75]) * np.sqrt(2.0) * 0.8
    both = [{"x": correlated(random, "x", truth), "y": correlated(random, "y", moved)} for _ in range(50)]
    assert np.mean([agreement(one).joint.p_value < 0.05 for one in both]) > 0.9
    alone = [p.verdict for one in both for p in agreement(one).parameters.values()]
    assert np.mean([verdict == "agree" for verdict in alone]) > 0.4


def test_what_cannot_be_compared_is_refused_or_not_counted() -> None:
    one = result({"a": 1.0, "b": 1.0, "c": 0.0}, 0.1, "one")
    held = {"a": ParameterEstimate(2.0, 0.1), "b": ParameterEstimate(9.0, 0.1, at_bound=True)}
    two = result({"a": 2.0, "b": 9.0}, 0.1, "two", parameters=held, status="budget", advice="allow more")
    found = agreement({"one": one, "two": two})
    assert [n for n, p in found.parameters.items() if p.verdict] == ["a"]
    assert [n.code for n in found.remarks] == ["maneuver-no-optimum"]
    seconds = {"a": ParameterEstimate(1.0, unit="s")}
    for other, said in (
        (result({"a": 1.0}, 0.1, "one"), "share samples"),
        (result({"z": 1.0}, 0.1, "two"), "no parameter was estimated in all"),
        (result({}, 0.1, "two", parameters=seconds), "has units"),
    ):
        with pytest.raises(StoopError, match=said):
            agreement({"one": one, "other": other})


def test_one_maneuver_takes_the_scatter_that_the_maneuvers_of_another_result_show() -> None:
    parts = of.Components({"noise": {"a": 0.01}, "maneuvers": {"a": 0.08}, "model": {"a": 9.0}})
    several = result({"a": 1.0}, 0.3, "one", components=parts)
    found = agreement({"one": several, "two": result({"a": 1.5}, 0.2, "two")})
    assert [one.std_error for one in found.parameters["a"].singles] == pytest.approx([0.3, 0.6])
    assert found.parameters["a"].chi_square == pytest.approx(0.25 / (0.3**2 + 0.6**2))
    assert [n.code for n in found.remarks] == ["widened-as-others"]


ONE = {"a": ParameterEstimate(1.0, 0.1), "b": ParameterEstimate(2.0, 0.1)}


def method(std: float, low: float = 1.96, high: float = 1.96, **figures: float) -> of.MethodIntervals:
    at = {n: of.Interval(std, p.estimate - low * std, p.estimate + high * std) for n, p in ONE.items()}
    return of.MethodIntervals(at, figures)


def repeated(scale: float, seed: int, count: int = 40) -> of.Repeatability:
    drawn = scale * 0.1 * np.random.default_rng(seed).standard_normal((count, 3))
    each = {f"p{i}": scatter(singles((1.0 + row).tolist(), [0.1] * 3)) for i, row in enumerate(drawn)}
    return of.Repeatability((0, 1, 2), each)


COLORED = {"corrected": method(0.1), "cramer_rao": method(0.025)}


def test_no_error_bars_are_trusted_beside_maneuvers_that_scatter_beyond_them() -> None:
    codes = {n.code: n for n in method_agreement(ONE, COLORED, repeated(2.4, 1, 400))}
    assert "agreement-colored" not in codes
    told = codes["agreement-scatter-colored"]
    assert (told.severity, told.values["ratio"]) == ("warning", pytest.approx(2.4, rel=0.15))
    assert told.values["plain"] == pytest.approx(4.0 * 2.4, rel=0.15)
    white = {"corrected": method(0.1), "cramer_rao": method(0.1)}
    assert "agreement-scatter" in {n.code for n in method_agreement(ONE, white, repeated(2.4, 1))}


@pytest.mark.parametrize(
    ("name", "code"), [("maneuvers", "agreement-one-maneuver"), ("color", "agreement-colored")]
)
def test_nothing_is_said_of_a_component_that_is_left_out(name: str, code: str) -> None:
    every, less = (
        {n.code for n in method_agreement(ONE, COLORED, components=of.Components(left_out=out))}
        for out in ((), (name,))
    )
    assert every - less == {code}


def test_maneuvers_that_agree_change_nothing_but_for_one_in_twenty() -> None:
    codes = [[n.code for n in method_agreement(ONE, COLORED, repeated(1.0, seed))] for seed in range(100)]
    assert sum("agreement-scatter-colored" in one for one in codes) <= 12
    assert sum("agreement-colored" in one for one in codes) >= 88


def test_what_methods_say_decides_which_one_is_trusted() -> None:
    """Methods beside three that agree, the notice that follows, its subject and some of its values."""
    agreeing = dict.fromkeys(("corrected", "conditional", "cramer_rao"), method(0.1))
    for methods, code, subject, values in (
        ({}, "agreement-white", "", {}),
        ({"cramer_rao": method(0.025)}, "agreement-colored", "", {"ratio": pytest.approx(4.0)}),
        ({"corrected": method(0.2)}, "agreement-maneuvers", "", {"ratio": pytest.approx(2.0)}),
        ({"bootstrap": method(0.11)}, "bootstrap-agrees", "", {}),
        # conditional on the model, too
        ({"corrected": method(0.2), "bootstrap": method(0.1)}, "bootstrap-agrees", "", {}),
        ({"bootstrap": method(0.2)}, "bootstrap-wider", "", {"wider": "a and b"}),
        ({"bootstrap": method(0.05)}, "bootstrap-narrower", "", {"narrower": "a and b"}),
        ({"posterior": method(0.1, rhat=1.001)}, "posterior-agrees", "", {}),
        ({"posterior": method(0.1, 1.0, 3.0, rhat=1.001)}, "posterior-skewed", "", {}),
        ({"posterior": method(0.3, rhat=1.001)}, "posterior-disagrees", "a and b", {}),
        ({"posterior": method(0.1, rhat=1.2)}, "agreement-no-posterior", "", {}),
        ({"profile": of.MethodIntervals({"a": of.Interval(nan, nan, 1.4)})}, "profiles-open", "a", {}),
        ({"conditional": None}, "agreement-one-maneuver", "", {}),
    ):
        given = {name: one for name, one in {**agreeing, **methods}.items() if one}
        notices = {n.code: n for n in method_agreement(ONE, given)}
        assert code in notices, (methods, list(notices))
        assert subject in ("", notices[code].subject), code
        assert dict(notices[code].values) | values == notices[code].values, code
    parameters = ONE | {"c": ParameterEstimate(1.0, 5.0, identifiable=False)}
    *_, last = method_agreement(parameters, {"corrected": method(0.1), "cramer_rao": method(0.1)})
    assert (last.code, last.subject, method_agreement(ONE, {})) == ("no-interval-trusted", "c", ())
