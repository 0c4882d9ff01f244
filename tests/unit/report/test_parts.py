"""Numbers, formulas, scales and words of the page."""

from __future__ import annotations

import dataclasses
import math
import tomllib
from importlib.resources import files
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.assessment.goodness_of_fit import join
from stoop.base.notices import as_notice, notice
from stoop.base.numbers import (
    clock,
    compact,
    count,
    factor_and_unit,
    listed,
    number,
    rounded_to_error,
    window,
)
from stoop.report.estimates import TITLES
from stoop.report.extensions import as_toml
from stoop.report.identification import reasons, verdict
from stoop.report.maneuvers import air_history, prediction_verdict
from stoop.report.series import spanning
from stoop.report.svg import Scale
from stoop.report.time_history import holes
from stoop.results.extensions import ExtensionTests
from stoop.results.result import (
    AirDataTrace,
    GoodnessOfFit,
    ManeuverResult,
    ParameterEstimate,
    Result,
    Whiteness,
)
from stoop.results.uncertainty import IdentifiabilityAnalysis, ParameterIdentifiability


def test_numbers_and_their_errors() -> None:
    for value, text in (
        (0.0, "0.000"), (1.0, "1.000"), (-12.3456, "−12.35"), (0.00123456, "0.001235"), (123456.7, "123457"),
        (1.5e7, "1.500×10⁷"), (-2.5e-6, "−2.500×10⁻⁶"), (math.nan, "–"), (math.inf, "∞"), (-math.inf, "−∞"),
    ):  # fmt: skip
        assert number(value) == text
    for value, error, texts in (
        (5.12345, 0.0123, ("5.123", "0.012")), (-0.5, 1.4, ("−0.5", "1.4")), (1234.5, 210.0, ("1234", "210")),
        (0.1, math.nan, ("0.1000", "–")), (0.1, math.inf, ("0.1000", "∞")), (0.1, 0.0, ("0.1000", "0.0")),
        (3.0e-9, 2.0e-10, ("3.00×10⁻⁹", "2.0×10⁻¹⁰")), (4.2e8, 1.1e7, ("4.20×10⁸", "1.1×10⁷")),
    ):  # fmt: skip
        assert rounded_to_error(value, error) == texts


@given(st.floats(), st.floats())
def test_any_number_can_be_written(value: float, error: float) -> None:
    assert number(value)
    assert all(rounded_to_error(value, abs(error)))
    assert clock(value)


def test_small_words() -> None:
    assert window(140.0, 168.3) == "140–168.3 s"
    assert count(1, "parameter") == "1 parameter"
    assert count(2, "parameter") == "2 parameters"
    assert listed(["a"]) == "a"
    assert listed(["a", "b", "c"]) == "a, b and c"
    assert listed([str(n) for n in range(12)], most=2) == "0, 1 and 10 more"
    assert listed([]) == "none"
    assert factor_and_unit("rad/s") == (pytest.approx(57.29578), "deg/s")
    assert factor_and_unit("m/s2") == (1.0, "m/s²")
    assert factor_and_unit("1/rad2") == (1.0, "1/rad²")
    assert factor_and_unit("1") == (1.0, "")
    assert [compact(value) for value in (1.0, -0.25, 120.0, 1e9)] == ["1", "−0.25", "120", "1.00×10⁹"]


@given(st.lists(st.floats(), max_size=5))
def test_an_axis_is_never_empty(values: list[float]) -> None:
    if any(abs(value) > 1e15 for value in values if math.isfinite(value)):
        return
    low, high = spanning([np.array(values)])
    assert low < high
    rounded = spanning([0.93 + 1e-12 * np.arange(50)])
    assert rounded[1] - rounded[0] > 0.05, "a curve that varies by rounding is drawn flat"
    assert math.isfinite(Scale(low, high, 0.0, 100.0).at(low))


def test_air_data_share_drawings_and_break_at_pauses(examples: ModuleType) -> None:
    whole = examples.example(("CL0",))
    time = np.concatenate([np.arange(0.0, 5.0, 0.1), np.arange(9.0, 12.0, 0.1)])
    names = ("speed_inertial", "pitot", "pitot_corrected", "V", "beta", "beta_from_force", "strange<b>")
    trace = AirDataTrace("f", time, {name: time + n for n, name in enumerate(names)})
    panels = air_history(whole, trace).panels
    assert [panel.title for panel in panels] == ["Airspeed", "Sideslip", "strange<b>"]
    ((airspeed,),) = [panel.strips for panel in panels[:1]]
    names = [one.name for one in airspeed.series]
    assert names == ["V", "pitot, corrected", "pitot as logged", "ground velocity minus wind"]
    assert all(np.isnan(one.x).sum() == 1 for one in airspeed.series)
    assert [panel.unit for panel in panels] == ["m/s", "deg", ""]
    assert holes(join([np.array([1.0, 2.0]), np.array([5.0, 6.0])])) == [(2.0, 5.0)]
    assert holes(np.array([1.0, 2.0])) == []


def good(examples: ModuleType) -> Result:
    whole: Result = examples.example(("CL0",)).result
    figures = {"p": GoodnessOfFit(0.1, 0.1, 0.9, 0.2)}
    maneuvers = (
        ManeuverResult("f", 0.0, 1.0, "fit", (), figures),
        ManeuverResult("f", 2.0, 3.0, "validation", (), figures),
        ManeuverResult("f", 4.0, 5.0, "fit", (), figures),
    )
    parameters, tests = {"CL0": ParameterEstimate(1.0, 0.1)}, ExtensionTests(100, 0.01)
    return dataclasses.replace(
        whole, parameters=parameters, maneuvers=maneuvers, notices=(), extensions=tests
    )


def sentences(result: Result) -> str:
    return " ".join(one for items in reasons(result).values() for one in items)


def test_a_good_verdict(examples: ModuleType) -> None:
    found, said = verdict(good(examples)), sentences(good(examples))
    assert found.level == "good"
    assert "known only in combination with others." in said
    assert "beats a trivial first-order lag in 2 of 2 comparisons" in said
    assert "None of 100 extensions of the model is significant." in found.supports
    assert found.against == ()


def test_a_channel_in_which_only_noise_is_left_is_not_lost(examples: ModuleType) -> None:
    """A window that does not move the yaw shows its noise, which no model matches; chance decides who is closer."""
    moved, whole = GoodnessOfFit(0.1, 0.1, 0.9, 0.2), good(examples)
    for left, level in (("white", "good"), ("colored", "caution"), ("", "caution")):
        still = GoodnessOfFit(0.1, 0.65, 0.0, 0.63, whiteness=Whiteness(verdict=left))
        channels = {"p": moved, "r": still}
        maneuvers = tuple(dataclasses.replace(m, channels=channels) for m in whole.maneuvers)
        result = dataclasses.replace(whole, maneuvers=maneuvers)
        assert verdict(result).level == level
        said = sentences(result)
        assert ("and leaves only noise in 2 more" in said) == (left == "white")
        assert ("not in r (0–1 s)" in said) == (left != "white")
    assert GoodnessOfFit(math.nan, math.nan, math.nan, 0.6).lost, "it diverged"


def test_how_many_parameters_are_known_only_together(examples: ModuleType) -> None:
    sights = {"CL0": ParameterIdentifiability(0.1, 3.5, 0.9996, ("CLalpha",), notice("known-in-combination"))}
    together = dataclasses.replace(good(examples), identifiability=IdentifiabilityAnalysis(parameters=sights))
    assert "estimated; 1 of them known only in combination with others." in sentences(together)
    alone = dataclasses.replace(good(examples), identifiability=IdentifiabilityAnalysis())
    assert "1 parameter estimated, all of them identifiable." in sentences(alone)


def test_verdicts(examples: ModuleType) -> None:
    whole, unknown = good(examples), ParameterEstimate(1.0, identifiable=False)
    bounded = {"a": ParameterEstimate(1.0, at_bound=True), "b": ParameterEstimate(1.0)}
    lost = dataclasses.replace(whole.maneuvers[1], channels={"r": GoodnessOfFit(0.1, 0.6, 0.1, 0.5)})
    fitted = whole.maneuvers[::2]
    cases: list[tuple[dict[str, Any], str, str]] = [
        ({"notices": (as_notice("pitot"),)}, "caution", ""),
        ({"notices": (as_notice("from the file", "info"),)}, "good", ""),
        ({"status": "budget"}, "bad", "used up its trajectories"),
        ({"status": "interrupted"}, "bad", "interrupted"),
        ({"status": "something new"}, "bad", "“something new”"),
        ({"cost": math.nan}, "bad", ""),
        ({"parameters": {"a": unknown}}, "bad", "1 of them is not identifiable (a)"),
        ({"parameters": bounded}, "caution", "1 lies at a bound (a)"),
        ({"advice": "widen the box"}, "good", "widen the box"),
        ({"maneuvers": (*fitted, lost)}, "bad", "not in r (2–3 s)"),
        ({"maneuvers": fitted}, "caution", "No window was held back"),
    ]
    for changes, level, said in cases:
        result = dataclasses.replace(whole, **changes)
        found = verdict(result)
        assert found.level == level, changes
        assert (found.level == "good") == (not found.against)
        assert len(found.against) <= 3 >= len(found.supports)
        assert said in sentences(result)


def test_a_refused_model_is_no_good_one_however_it_predicts(examples: ModuleType) -> None:
    maneuvers = good(examples).maneuvers
    assert prediction_verdict(maneuvers, ()).level == "good"
    refused = prediction_verdict(maneuvers, (), refused=True)
    assert refused.level == "bad"
    assert refused.headline.endswith("lag, but its identification says: do not use it.")


def test_every_method_of_uncertainty_has_a_color() -> None:
    style = files("stoop.report").joinpath("templates/style.css").read_text()
    for name in TITLES:
        assert f".method-{name} {{" in style
        assert f".method-{name}key {{" in style


def test_the_line_of_an_extension_can_be_pasted_into_a_vehicle_file() -> None:
    one = "[controls.aileron] lag = 0.035"
    assert tomllib.loads(as_toml(one)) == {"controls": {"aileron": {"lag": 0.035}}}
    three = "[controls.aileron] lag = 0.03; [controls.elevator] lag = { value = 0.03 }; [controls.aileron] delay = 0.1"
    lag = {"aileron": {"lag": 0.03, "delay": 0.1}, "elevator": {"lag": {"value": 0.03}}}
    assert tomllib.loads(as_toml(three)) == {"controls": lag}
