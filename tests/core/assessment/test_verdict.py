"""The verdict: what refuses a result, what each use needs, and what is trusted."""

import dataclasses
import json
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest

from stoop.assessment.verdict import Limits, uses, verdict
from stoop.base.notices import as_notice, notice
from stoop.results import result as results
from stoop.results import uncertainty as of
from stoop.results.extensions import ExtensionTest, ExtensionTests, ResponseMisfit
from stoop.results.result import GoodnessOfFit, InnovationFigures, ParameterEstimate, Result, Whiteness
from stoop.results.verdict import Need, Use, Verdict, grouped
from stoop.vehicle.builtin import load_vehicle

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
#: moves less than the noise, matched worse than by a lag
STILL = dataclasses.replace(LOST, r2=-3.0, signal_to_noise=0.7)
USED = ("control design", "simulation", "performance")
REFUSED: tuple[str, ...] = ()
LAG = ExtensionTest("controls.aileron.lag", "lag", 0.04, 0.004, "s", 10.0, 1e-9, 50.0, "line")


def maneuver(start: float, role: Any, **channels: GoodnessOfFit) -> results.ManeuverResult:
    return results.ManeuverResult("f", start, start + 5.0, role, (), {"p": MATCHED, "V": MATCHED} | channels)


def result(**changes: Any) -> Result:
    """Return a result that is trusted."""
    parameters = {"Clp": ParameterEstimate(-0.5, 0.01), "CD0": ParameterEstimate(0.03, 0.001)}
    parameters = changes.get("parameters", parameters)
    variances = [p.std_error**2 for p in parameters.values()]
    whole = Result(
        parameters=parameters,
        covariance=results.Covariance(tuple(parameters), np.diag(variances)),
        noise_covariance=results.NoiseCovariance(("p", "V"), np.eye(2)),
        initial_states=(), biases=(), wind=(),
        maneuvers=(maneuver(0.0, "fit"), maneuver(5.0, "fit"), maneuver(10.0, "validation")),
        cost=1.0, trajectories=10.0, seconds=1.0, seed=0, optimizer="lm", status="converged",
        extensions=ExtensionTests(100, 0.01),
    )  # fmt: skip
    return dataclasses.replace(whole, **changes)


def codes(found: Verdict) -> list[str]:
    return [one.code for one in found.against]


def held_back(*, fitted: Mapping[str, GoodnessOfFit] | None = None, **channels: GoodnessOfFit) -> Result:
    first = [maneuver(start, "fit", **fitted or {}) for start in (0.0, 5.0)]
    return result(maneuvers=(*first, maneuver(10.0, "validation", **channels)))


def twice(given: Result) -> Result:
    return dataclasses.replace(given, maneuvers=(*given.maneuvers, given.maneuvers[-1]))


def lacking(statistic: float = 50.0, beside: float | None = None, **changes: Any) -> Result:
    """Return a result in which a lag is significant; with `beside` another extension, which moves nothing, is stronger."""
    own = dataclasses.replace(LAG, statistic=statistic, **changes)
    first = dataclasses.replace(own, name="sensors.r.scale", moves={}, statistic=20.0)
    found = (own,) if beside is None else (first, dataclasses.replace(own, beside=beside))
    return result(extensions=ExtensionTests(100, 0.01, found))


def contradicted(name: str, change: float) -> Result:
    found = dataclasses.replace(LAG, name=name, kind="number", value=2.0 + change, change=change)
    return result(extensions=ExtensionTests(100, 0.01, (found,)))


def in_gusts(figures: InnovationFigures) -> Result:
    """Return a result whose simulation of the held-back window lost to a lag and left its band."""
    lost = dataclasses.replace(LOST, inside=0.3, innovations=figures)
    return held_back(p=lost, V=lost)


def scattering(count: int) -> Result:
    each = {
        f"C{i}": of.ParameterRepeatability((), chi_square=1.0, degrees=1, verdict="scatter" if i < count else "agree")
        for i in range(20)
    }  # fmt: skip
    return result(repeatability=of.Repeatability((0, 1), each))


def known(correlation: float = 0.0, **parameters: ParameterEstimate) -> Result:
    sigma = np.array([p.std_error for p in parameters.values()])
    related = np.eye(len(sigma))
    related[0, 1] = related[1, 0] = correlation
    covariance = results.Covariance(tuple(parameters), related * np.outer(sigma, sigma))
    return result(parameters=parameters, covariance=covariance)


def missed(least: float) -> Result:
    return result(response_misfits=(ResponseMisfit("aileron", "p", 3.0, 30.0, 0.9, least + 0.1, least),))


def cases() -> Iterator[tuple[str, Result, tuple[Use, ...], str, tuple[str, ...], set[str]]]:
    """Yield a subject, a result, uses, the grade, the uses that it justifies, and notices against the result."""
    no, some, simulate, performance = "do not use", "usable", ("simulation", "performance"), ("performance",)
    unknown = {n: ParameterEstimate(1.0, identifiable=False) for n in ("Clp", "CD0")}
    diverged, slight = GoodnessOfFit(1e131, 1.0, -1e99), dataclasses.replace(MATCHED, signal_to_noise=2.0)
    fault = notice("sensor-fault", "f", fault="p has the wrong sign")
    whole, CD0, worse = result(), ParameterEstimate(0.03, 0.001), {"p": LOST, "V": LOST}
    for subject, given, grade, justified, against in (
        ("no reservation", whole, "trusted", USED, set()),
        ("the search did not end", result(status="budget"), no, REFUSED, {"no-confirmed-optimum"}),
        ("no cost", result(cost=math.nan), no, REFUSED, {"verdict-no-cost"}),
        ("a faulty sensor", result(notices=(fault,)), no, REFUSED, {"sensor-fault"}),
        ("a lag moves Clp by 11.8 errors", lacking(moves={"Clp": -11.8}), no, REFUSED, {"verdict-form"}),
        ("a held number is contradicted", contradicted("mass.inertia.xx", 0.3), no, REFUSED, {"verdict-form-number"}),
        ("lost to a lag", held_back(**worse), no, REFUSED, {"verdict-trivial"}),
        ("a prediction diverges", held_back(V=diverged), no, REFUSED, {"simulation-diverges"}),
        ("nothing identifiable", result(parameters=unknown), no, REFUSED, {"verdict-unknown"}),
        ("a lag moves what no use needs", lacking(moves={"Clr": -11.8}), some, USED, {"verdict-lacks"}),
        ("it moves little", lacking(moves={"Clp": 0.9 * Limits.moved_errors}), some, USED, {"verdict-lacks"}),
        ("4 % of a held number", contradicted("mass.inertia.xx", 0.08), some, USED, {"verdict-lacks"}),
        ("a sensor's scale", contradicted("sensors.az.scale", 0.3), some, USED, {"verdict-lacks"}),
        ("not tested", result(extensions=ExtensionTests()), some, USED, {"verdict-not-tested"}),
        ("nothing held back", result(maneuvers=whole.maneuvers[:2]), some, USED, {"verdict-no-held-back"}),
        ("one maneuver", result(maneuvers=whole.maneuvers[1:]), some, USED, {"verdict-one-maneuver"}),
        ("outside of its band", held_back(V=OUTSIDE), some, USED, {"verdict-outside"}),
        ("a warning", result(notices=(as_notice("the pitot reads zero"),)), some, USED, {"verdict-warnings"}),
        # what stays significant beside the strongest extension is judged, too; what the first explains is not
        ("a second lag", lacking(50.0, 6.0, moves={"Clp": -8.0}), no, REFUSED, {"verdict-form", "verdict-lacks"}),
        ("explained by the first", lacking(50.0, 2.0, moves={"Clp": -8.0}), some, USED, {"verdict-lacks"}),
        # a filter is judged by its innovations and not by a simulation in gusts
        ("white innovations", in_gusts(WHITE), "trusted", USED, set()),
        ("colored innovations", in_gusts(COLORED), some, USED, {"verdict-innovations"}),
        ("large innovations", in_gusts(dataclasses.replace(COLORED, rms=5.0, inside=0.4)), no, REFUSED,
         {"verdict-trivial", "verdict-outside", "verdict-innovations"}),
        ("lost in the gusts found", result(maneuvers=held_back(fitted=worse).maneuvers[:2],
         process_noise=results.ProcessNoise("steady")), some, USED, {"verdict-no-held-back"}),
        ("lost without gusts", result(maneuvers=held_back(fitted=worse).maneuvers[:2]), no, REFUSED, {"verdict-trivial"}),
        # channels count where they moved: in the windows held back, or else in those fitted
        ("V is lost", held_back(V=LOST), some, ("control design",), {"verdict-channels"}),
        ("only noise is left", held_back(V=dataclasses.replace(LOST, whiteness=Whiteness(verdict="white"))),
         "trusted", USED, set()),
        ("p is still", held_back(p=STILL), some, USED, {"verdict-not-held-back"}),
        ("p is lost, V still", held_back(p=LOST, V=STILL), no, REFUSED, {"verdict-trivial"}),
        ("p is still, lost before", held_back(fitted={"p": LOST}, p=STILL), some, performance, {"verdict-channels"}),
        ("p moves a little, lost before", twice(held_back(fitted={"p": LOST}, p=slight)), some, USED, set()),
        ("p rests twice, lost before", twice(held_back(fitted={"p": LOST}, p=STILL)), some, performance, set()),
        ("all is still", held_back(fitted={"p": STILL, "V": STILL}, p=STILL, V=STILL), no, REFUSED, {"verdict-still"}),
        ("ailerons rest", result(notices=(notice("control-still", "aileron"),)), some, simulate, {"control-still"}),
        ("1 of 20 scatters", scattering(1), "trusted", USED, set()),
        ("the error of Clp is not known", known(Clp=ParameterEstimate(-0.5, math.nan), CD0=CD0), "trusted", simulate,
         {"verdict-need-inaccurate"}),
        ("5 of 20 scatter", scattering(5), some, USED, {"verdict-scatter"}),
        ("a response is missed", missed(1.1 * Limits.error), "trusted", simulate, {"verdict-response"}),
        ("a response is met", missed(0.9 * Limits.error), "trusted", USED, set()),
        ("error bars hold it", dataclasses.replace(lacking(moves={"Clp": 2.9}), parameters={
         "Clp": ParameterEstimate(-0.5, 0.1), "CD0": CD0}), some, USED, {"verdict-lacks"}),
    ):  # fmt: skip
        yield subject, given, USES, grade, justified, against
    # both are known within 30 % only, their ratio within 2 %: that is what turns the aircraft; or priors alone tell the parts
    for std, prior, correlation, grade in (
        (0.15, math.nan, -0.998, "trusted"), (0.15, math.nan, 0.0, no), (0.05, 0.05, -0.995, some), (0.05, 0.05, 0.0, no)
    ):  # fmt: skip
        inertia = ParameterEstimate(1.0, 2.0 * std, prior_std=2.0 * prior)
        own = ParameterEstimate(-0.5, std, identifiable=math.isnan(prior), prior_std=prior)
        justified = USED[:1] if correlation else REFUSED
        given = known(correlation, Clp=own, **{"mass.inertia.xx": inertia})
        yield f"a ratio, {std}, {correlation}", given, USES[:1], grade, justified, set()
    # Clp is 0.001 of the value at which it would be the largest effect: its own error of 400 % is no doubt
    need = dataclasses.replace(USES[0].needs[0], sizes=(1.0,))
    sized = (dataclasses.replace(USES[0], needs=(need,)), *USES[1:])
    for error, moved, asked, grade, against in (
        (0.004, None, USES, "trusted", {"verdict-need-inaccurate"}), (0.004, None, sized, "trusted", set()),
        (0.004, 5.0, sized, no, {"verdict-form"}), (0.004, 3.5, sized, no, {"verdict-form"}),
        (0.001, 4.0, sized, some, {"verdict-lacks"}),
    ):  # fmt: skip
        given = known(Clp=ParameterEstimate(-0.001, error), CD0=CD0)
        if moved:
            given = dataclasses.replace(given, extensions=lacking(moves={"Clp": moved}).extensions)
        justified = REFUSED if grade == no else simulate if asked is USES else USED
        yield f"Clp near zero, {error}, {moved}", given, asked, grade, justified, against
    # of several effects that with the largest one must be known, not that whose number is largest
    yaw = Need("control effectiveness in yaw", ("Cn1", "Cn2"), (100.0, 0.2), "mass.inertia.zz")
    given = known(Cn1=ParameterEstimate(2.0, 1.9), Cn2=ParameterEstimate(0.1, 0.001))
    yield "a small effect is unknown", given, (Use(USED[0], ("p",), (yaw,)),), "trusted", USED[:1], set()
    roll = Need("control effectiveness in roll", ("Claileron", "Clelevator"))
    large, small = ParameterEstimate(0.3, 0.3, identifiable=False), ParameterEstimate(0.06, 0.003)
    given, one = known(Claileron=large, Clelevator=small), (Use(USED[0], ("p",), (roll,)),)
    yield "the large effect is unknown", given, one, no, REFUSED, {"verdict-need-unknown"}


def test_what_a_result_shows_decides_its_grade_its_uses_and_the_notices_against_it() -> None:
    for subject, given, asked, grade, justified, against in cases():
        found = verdict(given, asked)
        assert (found.grade, found.justified) == (grade, justified), (subject, codes(found))
        assert against <= set(codes(found)), (subject, codes(found))
        assert against or found.grade != "trusted" or found.justified != USED or not found.against, subject


def test_reasons_name_what_they_are_of() -> None:
    trusted = verdict(result(), USES)
    assert [n.code for n in trusted.reasons] == ["verdict-form-holds", "verdict-predicted", "verdict-agree"]
    assert str(trusted.headline) == "Trusted for control design, simulation and performance"
    assert str(verdict(result(status="budget"), USES).headline) == "Do not use this model"
    refused = verdict(held_back(fitted={"p": LOST}, p=STILL), USES).against
    assert [n.subject for n in refused if n.code == "verdict-channels"] == ["control design", "simulation"]
    assert codes(verdict(held_back(p=STILL), USES)) == ["verdict-not-held-back"]
    strongest = verdict(lacking(50.0, 6.0, moves={"Clp": -8.0}), USES).against[0]
    assert (strongest.code, strongest.subject) == ("verdict-form", "controls.aileron.lag")
    tests = dataclasses.replace(result().extensions, unresolved=("mass.mass",))
    for given, code, values in (
        (missed(0.5), "verdict-response", {"share": 0.6}),
        (result(extensions=tests), "verdict-unresolved", {"numbers": ("mass.mass",)}),
    ):
        (told,) = (n for n in verdict(given, USES).reasons if n.code.startswith(code))
        assert dict(told.values) | values == told.values, code


def test_a_use_needs_its_parameters() -> None:
    known = {"CD0": of.ParameterIdentifiability(0.01, 0.02, 0.9, advice=(notice("advice-ground"),))}
    poor = {**result().parameters, "CD0": ParameterEstimate(0.03, 0.02)}
    given = result(parameters=poor, identifiability=of.IdentifiabilityAnalysis(parameters=known))
    found = verdict(given, USES)
    assert found.justified == ("control design", "simulation")
    assert found.grade == "trusted", "what is known is right; the drag is not known well enough to use"
    (one,) = found.against
    assert (one.code, one.values["parameter"]) == ("verdict-need-inaccurate", "CD0")
    assert one.values["error"] == pytest.approx(2.0 / 3.0)
    (told,) = found.advice
    assert str(told) == "To determine CD0: Measure it on the ground, and fix it or narrow its prior"
    assert str(found.headline) == "Trusted for control design and simulation; not for performance"


def test_needs_of_an_aircraft_and_of_a_multirotor() -> None:
    twin, quad = load_vehicle("twin-boom"), load_vehicle("quad-x")
    control, simulation, performance = uses(twin)
    needs = {need.subject: need.parameters for need in (*control.needs, *performance.needs)}
    assert (needs["damping in roll"], needs["static stability in pitch"]) == (("Clp",), ("Cmalpha",))
    assert set(needs["control effectiveness in yaw"]) >= {"Cnrudder", "Cnaileron"}
    assert (needs["lift slope"], needs["drag at the reference condition"]) == (("CLalpha",), ("CD0",))
    assert "inertia in roll" not in needs, "it counts in the ratio of each moment to it"
    assert control.channels == ("p", "q", "r")
    assert (len(simulation.channels), simulation.needs) == (12, ())
    # adverse yaw of the ailerons is no control about the yaw axis
    held = twin.with_numbers({"Cnrudder": {"free": False}, "Clrudder": {"free": False}})
    left = {need.subject for need in uses(held)[0].needs}
    assert {"control effectiveness in roll", "control effectiveness in pitch"} <= left
    assert "control effectiveness in yaw" not in left
    control, _, performance = uses(quad)
    assert all(need.parameters for use in (control, performance) for need in use.needs)
    assert performance.channels == ("vn", "ve", "vd", "ax", "ay", "az")
    free = quad.with_numbers({"mass.inertia.xx": {"free": True}})
    assert "inertia in roll" in {need.subject for need in uses(free)[0].needs}


def test_json() -> None:
    given = lacking(moves={"Clp": -11.8})
    whole = dataclasses.replace(given, verdict=verdict(given, USES))
    read = results.from_json(results.to_json(whole)).verdict
    assert read.grade == whole.verdict.grade
    assert [str(one) for one in read.reasons] == [str(one) for one in whole.verdict.reasons]
    assert verdict(given, read.uses) == verdict(given, USES), "it can be made again from what the file holds"
    assert results.from_json(results.to_json(result()).replace('"verdict"', '"unknown"')).verdict == Verdict()
    old = json.loads(results.to_json(in_gusts(WHITE)))  # of a version without innovations
    for channel in (c for one in old["maneuvers"] for c in one["channels"].values()):
        del channel["innovations"]
    assert verdict(results.from_json(json.dumps(old)), USES).grade == "do not use"


def test_findings_of_one_kind_are_told_together() -> None:
    of = {"use": "control design"}
    needs = [
        notice("verdict-need-inaccurate", "damping in roll", parameter="Clp", error=0.23, **of),
        notice("verdict-need-unknown", "inertia in roll", parameters=("mass.inertia.xx",), **of),
        notice("verdict-need-inaccurate", "thrust", use="performance", parameter="CT1", error=0.31),
    ]
    lost, others = ("V", "ax"), ("simulation", "performance")
    channels = [notice("verdict-channels", use, channels=lost) for use in others]
    lacks = [notice("verdict-lacks", n, statistic=-5.0, line=f"{n} = 1") for n in ("CQalphar", "ClV")]
    figures = {"effects": ("p (...)",), "parameters": ("Clp",), "variables": ("p", "q")}
    doubt, single = notice("contribution-in-doubt", **figures, aim=0.1), notice("verdict-no-held-back")
    told = grouped([doubt, *needs, channels[0], single, channels[1], *lacks])
    assert [one.code for one in told] == [
        "verdict-contributions", "verdict-needs", "verdict-need-inaccurate", "verdict-channels-of-uses",
        "verdict-no-held-back", "verdict-lacks-several",
    ]  # fmt: skip
    damping, inertia = told[1].values["needs"]
    assert damping == "damping in roll (Clp +- 23%)"
    assert inertia == "inertia in roll (mass.inertia.xx not identifiable or at a bound)"
    assert told[2] is needs[2]
    assert "simulation in V and ax and performance in V and ax" in str(told[3])
    assert "CQalphar = 1; ClV = 1" in str(told[5])
