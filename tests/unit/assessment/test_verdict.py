"""The verdict: what refuses a result, what each use needs, and what is trusted."""

from __future__ import annotations

import dataclasses
import json
import math
from typing import Any

import numpy as np
import pytest

from stoop.assessment.verdict import LIMITS, uses, verdict
from stoop.base.notices import as_notice, notice
from stoop.results.extensions import ExtensionTest, ExtensionTests
from stoop.results.response_misfit import ResponseMisfit
from stoop.results.result import (
    Covariance,
    GoodnessOfFit,
    InnovationFigures,
    ManeuverResult,
    NoiseCovariance,
    ParameterEstimate,
    ProcessNoise,
    Result,
    Whiteness,
    from_json,
    to_json,
)
from stoop.results.uncertainty import (
    IdentifiabilityAnalysis,
    ParameterIdentifiability,
    ParameterRepeatability,
    Repeatability,
)
from stoop.results.verdict import Need, Use, Verdict, grouped
from stoop.vehicle.builtin import resolve_vehicle

USES = (
    Use("control design", ("p",), (Need("damping in roll", ("Clp",), inertia="mass.inertia.xx"),)),
    Use("simulation", ("p", "V")),
    Use("performance", ("V",), (Need("drag at the reference condition", ("CD0",)),)),
)
MATCHED, LOST = GoodnessOfFit(0.1, 0.1, 0.9, 0.2), GoodnessOfFit(0.5, 0.5, 0.1, 0.2)

WHITE, COLORED = (
    InnovationFigures(1.0, 0.95, Whiteness(0.0, 20.0, 20, p, "white" if p > 0.05 else "colored"))
    for p in (0.5, 1e-6)
)
OUTSIDE = dataclasses.replace(MATCHED, inside=0.4)


def maneuver(start: float, role: Any, **channels: GoodnessOfFit) -> ManeuverResult:
    return ManeuverResult("f", start, start + 5.0, role, (), {"p": MATCHED, "V": MATCHED} | channels)


def result(**changes: Any) -> Result:
    """Return a result that is trusted."""
    parameters = {"Clp": ParameterEstimate(-0.5, 0.01), "CD0": ParameterEstimate(0.03, 0.001)}
    parameters = changes.get("parameters", parameters)
    variances = [p.std_error**2 for p in parameters.values()]
    whole = Result(
        parameters=parameters,
        covariance=Covariance(tuple(parameters), np.diag(variances)),
        noise_covariance=NoiseCovariance(("p", "V"), np.eye(2)),
        initial_states=(), biases=(), wind=(),
        maneuvers=(maneuver(0.0, "fit"), maneuver(5.0, "fit"), maneuver(10.0, "validation")),
        cost=1.0, trajectories=10.0, seconds=1.0, seed=0, optimizer="lm", status="converged",
        extensions=ExtensionTests(100, 0.01),
    )  # fmt: skip
    return dataclasses.replace(whole, **changes)


def lacking(shift: float, name: str = "Clp") -> ExtensionTests:
    found = ExtensionTest(
        "controls.aileron.lag", "lag", 0.04, 0.004, "s", 10.0, 1e-9, 50.0, "[controls.aileron] lag = 0.04",
        moves={name: shift},
    )  # fmt: skip
    return ExtensionTests(100, 0.01, (found,))


def beside_a_harmless_one(statistic: float) -> ExtensionTests:
    """Return tests of which the strongest moves nothing, and the second moves Clp, with a statistic beside the first."""
    (second,) = lacking(-8.0).found
    first = dataclasses.replace(second, name="sensors.r.scale", moves={}, statistic=20.0)
    return ExtensionTests(100, 0.01, (first, dataclasses.replace(second, beside=statistic)))


def test_more_defects_are_judged_no_better() -> None:
    """What stays significant beside the strongest extension is judged, too; what the first explains is not."""
    found = verdict(result(extensions=beside_a_harmless_one(6.0)), USES)
    assert found.grade == "do not use"
    assert codes(found)[:2] == ["verdict-form", "verdict-lacks"]
    assert found.against[0].subject == "controls.aileron.lag"
    found = verdict(result(extensions=beside_a_harmless_one(2.0)), USES)
    assert found.grade == "usable"
    assert [one.subject for one in found.against] == ["sensors.r.scale"]


def test_numbers_that_the_data_cannot_contradict_are_named() -> None:
    tests = dataclasses.replace(result().extensions, unresolved=("mass.mass",))
    found = verdict(result(extensions=tests), USES)
    assert found.grade == "trusted"
    assert [one.values["numbers"] for one in found.reasons if one.code == "verdict-unresolved"] == [
        ("mass.mass",)
    ]


USED = ("control design", "simulation", "performance")


def contradicted(name: str, change: float) -> ExtensionTests:
    """Return tests of which one contradicts a fixed number of 2 and moves nothing else."""
    found = ExtensionTest(
        name, "number", 2.0 + change, 0.01, "kg m2", 10.0, 1e-9, 50.0, "line", change=change
    )
    return ExtensionTests(100, 0.01, (found,))


def codes(found: Verdict) -> list[str]:
    return [one.code for one in found.against]


def test_trusted() -> None:
    found = verdict(result(), USES)
    assert found.grade == "trusted"
    assert found.justified == USED
    assert [one.code for one in found.reasons] == ["verdict-form-holds", "verdict-predicted", "verdict-agree"]
    assert str(found.headline) == "Trusted for control design, simulation and performance"


def in_gusts(figures: InnovationFigures) -> Result:
    """Return a result whose simulation of the held-back window lost to a lag and left its band."""
    lost = dataclasses.replace(LOST, inside=0.3, innovations=figures)
    held_back = maneuver(10.0, "validation", p=lost, V=lost)
    return result(maneuvers=(*result().maneuvers[:2], held_back))


def test_a_filter_is_judged_by_its_innovations_and_not_by_a_simulation_in_gusts() -> None:
    assert verdict(in_gusts(WHITE), USES).grade == "trusted"
    found = verdict(in_gusts(COLORED), USES)
    assert found.grade == "usable"
    assert codes(found) == ["verdict-innovations"]
    found = verdict(in_gusts(dataclasses.replace(COLORED, rms=5.0, inside=0.4)), USES)
    assert found.grade == "do not use"
    assert {"verdict-trivial", "verdict-outside", "verdict-innovations"} <= set(codes(found))
    old = json.loads(to_json(in_gusts(WHITE)))
    for one in old["maneuvers"]:
        for channel in one["channels"].values():
            del channel["innovations"]
    assert verdict(from_json(json.dumps(old)), USES).grade == "do not use"


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"status": "budget"}, "no-confirmed-optimum"),
        ({"cost": math.nan}, "verdict-no-cost"),
        ({"notices": (notice("sensor-fault", "f", fault="p has the wrong sign"),)}, "sensor-fault"),
        ({"extensions": lacking(-11.8)}, "verdict-form"),
        ({"extensions": contradicted("mass.inertia.xx", 0.3)}, "verdict-form-number"),
        (
            {"maneuvers": (*result().maneuvers[:2], maneuver(10.0, "validation", p=LOST, V=LOST))},
            "verdict-trivial",
        ),
        (
            {"maneuvers": (*result().maneuvers[:2], maneuver(10.0, "validation", V=GoodnessOfFit(1e131, 1.0, -1e99)))},
            "simulation-diverges",
        ),
        (
            {"parameters": {n: ParameterEstimate(1.0, identifiable=False) for n in ("Clp", "CD0")}},
            "verdict-unknown",
        ),
    ],
)  # fmt: skip
def test_refused(changes: dict[str, Any], code: str) -> None:
    found = verdict(result(**changes), USES)
    assert found.grade == "do not use"
    assert found.justified == ()
    assert code in codes(found)
    assert str(found.headline) == "Do not use this model"


@pytest.mark.parametrize(
    ("least", "justified"),
    [(1.1 * LIMITS.error, ("simulation", "performance")), (0.9 * LIMITS.error, USED)],
)
def test_a_response_that_the_model_misses_speaks_against_control_design(
    least: float, justified: tuple[str, ...]
) -> None:
    missed = ResponseMisfit("aileron", "p", 3.0, 30.0, 0.9, least + 0.1, least)
    found = verdict(result(response_misfits=(missed,)), USES)
    assert found.justified == justified
    of_responses = [one for one in found.reasons if one.code.startswith("verdict-response")]
    assert [one.code for one in of_responses] == [
        "verdict-response" if len(justified) < len(USED) else "verdict-responses"
    ]
    assert of_responses[0].values["share"] == missed.share


@pytest.mark.parametrize(
    ("changes", "code"),
    [
        ({"extensions": lacking(-11.8, "Clr")}, "verdict-lacks"),
        ({"extensions": lacking(0.9 * LIMITS.moved_errors)}, "verdict-lacks"),
        ({"extensions": contradicted("mass.inertia.xx", 0.08)}, "verdict-lacks"),
        ({"extensions": contradicted("sensors.az.scale", 0.3)}, "verdict-lacks"),
        ({"extensions": ExtensionTests()}, "verdict-not-tested"),
        ({"maneuvers": result().maneuvers[:2]}, "verdict-no-held-back"),
        ({"maneuvers": result().maneuvers[1:]}, "verdict-one-maneuver"),
        (
            {"maneuvers": (*result().maneuvers[:2], maneuver(10.0, "validation", V=OUTSIDE))},
            "verdict-outside",
        ),
        ({"notices": (as_notice("the pitot reads zero"),)}, "verdict-warnings"),
    ],
)
def test_reservations(changes: dict[str, Any], code: str) -> None:
    found = verdict(result(**changes), USES)
    assert found.grade == "usable"
    assert found.justified == USED
    assert code in codes(found)


def test_a_use_needs_its_parameters() -> None:
    advice = (notice("advice-ground"),)
    known = {"CD0": ParameterIdentifiability(0.01, 0.02, 0.9, advice=advice)}
    poor = {**result().parameters, "CD0": ParameterEstimate(0.03, 0.02)}
    given = result(parameters=poor, identifiability=IdentifiabilityAnalysis(parameters=known))
    found = verdict(given, USES)
    assert found.justified == ("control design", "simulation")
    assert found.grade == "trusted", "what is known is right; the drag is not known well enough to use"
    (one,) = found.against
    assert (one.code, one.values["parameter"]) == ("verdict-need-inaccurate", "CD0")
    assert one.values["error"] == pytest.approx(2.0 / 3.0)
    assert [str(one) for one in found.advice] == [
        "To determine CD0: Measure it on the ground, and fix it or narrow its prior"
    ]
    assert str(found.headline) == "Trusted for control design and simulation; not for performance"


def test_a_moment_is_judged_over_the_moment_of_inertia() -> None:
    """Both are known within 30 % only, their ratio within 2 %: that is what turns the aircraft."""
    sigma = np.array([0.15, 0.3])
    errors = {"Clp": ParameterEstimate(-0.5, 0.15), "mass.inertia.xx": ParameterEstimate(1.0, 0.3)}
    for correlation, good in ((-0.998, True), (0.0, False)):
        matrix = np.outer(sigma, sigma) * np.array([[1.0, correlation], [correlation, 1.0]])
        covariance = Covariance(tuple(errors), matrix)
        found = verdict(result(parameters=errors, covariance=covariance), USES[:1])
        assert (found.justified == ("control design",)) == good
        assert good or "of Clp over mass.inertia.xx is" in str(found.against[0])


def test_a_ratio_that_the_flight_shows_is_known_though_its_parts_come_from_priors() -> None:
    """Of Clp and of the inertia the flight adds nothing to priors of 10 %, of their ratio it knows 1 %, or nothing either."""
    given = {
        "Clp": ParameterEstimate(-0.5, 0.05, identifiable=False, prior_std=0.05),
        "mass.inertia.xx": ParameterEstimate(1.0, 0.1, prior_std=0.1),
    }
    sigma = np.array([0.05, 0.1])
    for correlation, good in ((-0.995, True), (0.0, False)):
        matrix = np.outer(sigma, sigma) * np.array([[1.0, correlation], [correlation, 1.0]])
        found = verdict(result(parameters=given, covariance=Covariance(tuple(given), matrix)), USES[:1])
        assert (found.justified == ("control design",)) == good


def test_a_derivative_near_zero_is_judged_by_what_matters_on_its_axis() -> None:
    """Clp is 0.001 of the value at which it would be the largest effect: its own error of 400 % is no doubt."""
    small = {**result().parameters, "Clp": ParameterEstimate(-0.001, 0.004)}
    given = result(parameters=small)
    assert "verdict-need-inaccurate" in codes(verdict(given, USES))
    need = dataclasses.replace(USES[0].needs[0], sizes=(1.0,))
    sized = (dataclasses.replace(USES[0], needs=(need,)), *USES[1:])
    assert verdict(given, sized).grade == "trusted"
    assert verdict(dataclasses.replace(given, extensions=lacking(5.0)), USES).grade == "do not use"
    assert verdict(dataclasses.replace(given, extensions=lacking(5.0)), sized).grade == "do not use", (
        "20 % of its size"
    )
    assert verdict(dataclasses.replace(given, extensions=lacking(3.5)), sized).grade == "do not use"
    finer = {**small, "Clp": ParameterEstimate(-0.001, 0.001)}
    assert verdict(result(parameters=finer, extensions=lacking(4.0)), sized).grade == "usable", (
        "4 % of its size"
    )


def test_what_error_bars_hold_does_not_contradict_the_form() -> None:
    """The extension moves Clp by 8 standard errors of the model as it is, of which the stated one holds ten."""
    for std, grade in ((0.01, "do not use"), (0.1, "usable")):
        stated = {**result().parameters, "Clp": ParameterEstimate(-0.5, std)}
        found = result(parameters=stated, covariance=result().covariance, extensions=lacking(8.0))
        assert verdict(found, USES).grade == grade


def test_the_strongest_of_several_effects_must_be_known() -> None:
    """Not the one whose number is largest: Cn1 acts on little motion."""
    parameters = {"Cn1": ParameterEstimate(2.0, 1.9), "Cn2": ParameterEstimate(0.1, 0.001)}
    need = Need("control effectiveness in yaw", ("Cn1", "Cn2"), (100.0, 0.2), "mass.inertia.zz")
    found = verdict(result(parameters=parameters), (Use("control design", ("p",), (need,)),))
    assert found.grade == "trusted"


def test_a_use_needs_its_channels() -> None:
    worse = (*result().maneuvers[:2], maneuver(10.0, "validation", V=LOST))
    found = verdict(result(maneuvers=worse), USES)
    assert (found.grade, found.justified) == ("usable", ("control design",))
    noise = dataclasses.replace(LOST, whiteness=Whiteness(verdict="white"))
    calm = (*result().maneuvers[:2], maneuver(10.0, "validation", V=noise))
    assert verdict(result(maneuvers=calm), USES).grade == "trusted", "only noise is left"


STILL = dataclasses.replace(
    LOST, r2=-3.0, signal_to_noise=0.7
)  #: moves less than the noise, matched worse than by a lag


def held_back(**channels: GoodnessOfFit) -> Result:
    """Return a result of two fitted maneuvers in which all moves, and of one held back."""
    return result(maneuvers=(*result().maneuvers[:2], maneuver(10.0, "validation", **channels)))


def test_a_still_channel_of_a_window_held_back_judges_nothing() -> None:
    """An elevator doublet is predicted: roll, which it does not move, is judged where it moved, by the fitted maneuvers."""
    found = verdict(held_back(p=STILL), USES)
    assert found.grade == "usable"
    assert found.justified == USED
    assert codes(found) == ["verdict-not-held-back"]
    assert found.against[0].values["channels"] == ("p",)


def test_a_model_that_fails_where_it_moved_is_refused() -> None:
    """In the window held back, or, of channels that are still there, in those fitted."""
    assert verdict(held_back(p=LOST, V=STILL), USES).grade == "do not use"
    worse = tuple(dataclasses.replace(m, channels=m.channels | {"p": LOST}) for m in result().maneuvers[:2])
    found = verdict(result(maneuvers=(*worse, maneuver(10.0, "validation", p=STILL))), USES)
    assert found.justified == ("performance",)
    assert [one.subject for one in found.against if one.code == "verdict-channels"] == [
        "control design",
        "simulation",
    ]


def test_slight_motion_that_is_predicted_counts_beside_what_was_fitted() -> None:
    """Where no window held back moves a channel far beyond its noise, those that move it a little judge with the fitted ones."""
    worse = tuple(dataclasses.replace(m, channels=m.channels | {"p": LOST}) for m in result().maneuvers[:2])
    for slight, justified in (
        (STILL, ("performance",)),
        (dataclasses.replace(MATCHED, signal_to_noise=2.0), USED),
    ):
        ahead = [maneuver(start, "validation", p=slight) for start in (10.0, 20.0)]
        assert verdict(result(maneuvers=(*worse, *ahead)), USES).justified == justified


def test_a_model_whose_channels_nothing_moves_is_not_justified() -> None:
    """Neither model nor lag explain what moves there: nothing shows that the model is right."""
    calm = tuple(
        dataclasses.replace(m, channels=dict.fromkeys(m.channels, STILL)) for m in result().maneuvers
    )
    found = verdict(result(maneuvers=calm), USES)
    assert found.grade == "do not use"
    assert codes(found) == ["verdict-still"] * 3


def test_curves_without_the_gusts_that_a_filter_found_judge_nothing() -> None:
    fitted = (maneuver(0.0, "fit", p=LOST, V=LOST), maneuver(5.0, "fit", p=LOST, V=LOST))
    assert verdict(result(maneuvers=fitted), USES).grade == "do not use"
    gusty = verdict(result(maneuvers=fitted, process_noise=ProcessNoise("steady")), USES)
    assert gusty.grade == "usable"
    assert set(gusty.justified) == {use.name for use in USES}


def test_what_was_not_excited_speaks_against_a_use() -> None:
    still = notice("control-still", "aileron")
    found = verdict(result(notices=(still,)), USES)
    assert found.justified == ("simulation", "performance")
    assert still in found.against


@pytest.mark.parametrize(("scatter", "grade"), [(1, "trusted"), (5, "usable")])
def test_maneuvers_agree_but_for_chance(scatter: int, grade: str) -> None:
    each = {
        f"C{i}": ParameterRepeatability((), chi_square=1.0, degrees=1, verdict="scatter" if i < scatter else "agree")
        for i in range(20)
    }  # fmt: skip
    found = verdict(result(repeatability=Repeatability((0, 1), each)), USES)
    assert found.grade == grade
    assert ("verdict-scatter" in codes(found)) == (grade == "usable")


def test_needs_of_an_aircraft() -> None:
    control, simulation, performance = uses(resolve_vehicle("twin-boom"))
    needs = {need.subject: need.parameters for need in (*control.needs, *performance.needs)}
    assert needs["damping in roll"] == ("Clp",)
    assert needs["static stability in pitch"] == ("Cmalpha",)
    assert set(needs["control effectiveness in yaw"]) >= {"Cnrudder", "Cnaileron"}
    assert needs["lift slope"] == ("CLalpha",)
    assert needs["drag at the reference condition"] == ("CD0",)
    assert "inertia in roll" not in needs, "it counts in the ratio of each moment to it"
    assert control.channels == ("p", "q", "r")
    assert len(simulation.channels) == 12
    assert not simulation.needs


def test_adverse_yaw_is_no_control_about_an_axis() -> None:
    """Without a rudder's yawing moment only the ailerons' is left, which is smaller than their rolling moment."""
    vehicle = resolve_vehicle("twin-boom")
    held = vehicle.with_numbers({"Cnrudder": {"free": False}, "Clrudder": {"free": False}})
    needs = {need.subject for need in uses(held)[0].needs}
    assert "control effectiveness in roll" in needs
    assert "control effectiveness in pitch" in needs
    assert "control effectiveness in yaw" not in needs


def test_needs_of_a_multirotor() -> None:
    control, _, performance = uses(resolve_vehicle("quad-x"))
    assert control.needs
    assert performance.needs
    free = resolve_vehicle("quad-x").with_numbers({"mass.inertia.xx": {"free": True}})
    assert "inertia in roll" in {need.subject for need in uses(free)[0].needs}
    assert all(need.parameters for use in (control, performance) for need in use.needs)
    assert performance.channels == ("vn", "ve", "vd", "ax", "ay", "az")


def test_of_several_the_one_with_the_largest_effect_must_be_known() -> None:
    """A well-known small effect does not stand in for a large one that the flight does not tell."""
    roll = Need("control effectiveness in roll", ("Claileron", "Clelevator"))
    given = {
        "Claileron": ParameterEstimate(0.3, 0.3, identifiable=False),
        "Clelevator": ParameterEstimate(0.06, 0.003),
    }
    whole = result(parameters=given, covariance=Covariance(tuple(given), np.diag([0.09, 9e-6])))
    (unknown,) = verdict(whole, (Use("control design", ("p",), (roll,)),)).uses[0].against
    assert (unknown.code, unknown.values["parameters"]) == ("verdict-need-unknown", ("Claileron",))


def test_json() -> None:
    given = result(extensions=lacking(-11.8))
    whole = dataclasses.replace(given, verdict=verdict(given, USES))
    read = from_json(to_json(whole)).verdict
    assert read.grade == whole.verdict.grade
    assert [str(one) for one in read.reasons] == [str(one) for one in whole.verdict.reasons]
    assert verdict(given, read.uses) == verdict(given, USES), "it can be made again from what the file holds"


def test_an_older_file_has_no_verdict() -> None:
    text = to_json(result()).replace('"verdict"', '"unknown"')
    assert from_json(text).verdict == Verdict()


def test_findings_of_one_kind_are_told_together() -> None:
    needs = [
        notice(
            "verdict-need-inaccurate", "damping in roll", use="control design", parameter="Clp", error=0.23
        ),
        notice(
            "verdict-need-unknown", "inertia in roll", use="control design", parameters=("mass.inertia.xx",)
        ),
        notice("verdict-need-inaccurate", "thrust", use="performance", parameter="CT1", error=0.31),
    ]
    channels = [
        notice("verdict-channels", use, channels=("V", "ax")) for use in ("simulation", "performance")
    ]
    lacks = [
        notice("verdict-lacks", name, statistic=-5.0, line=f"{name} = 1") for name in ("CQalphar", "ClV")
    ]
    doubt = notice(
        "contribution-in-doubt", effects=("p (...)",), parameters=("Clp",), variables=("p", "q"), aim=0.1
    )
    single = notice("verdict-no-held-back")
    told = grouped([doubt, *needs, channels[0], single, channels[1], *lacks])
    assert [one.code for one in told] == [
        "verdict-contributions", "verdict-needs", "verdict-need-inaccurate", "verdict-channels-of-uses",
        "verdict-no-held-back", "verdict-lacks-several",
    ]  # fmt: skip
    assert told[1].values["needs"] == (
        "damping in roll (Clp +- 23%)",
        "inertia in roll (mass.inertia.xx not identifiable or at a bound)",
    )
    assert told[2] is needs[2]
    assert "simulation in V and ax and performance in V and ax" in str(told[3])
    assert "CQalphar = 1; ClV = 1" in str(told[5])
