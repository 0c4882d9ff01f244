"""Numbers, formulas, scales and words of pages and of results in a few lines."""

import math
import tomllib
from dataclasses import replace
from importlib.resources import files
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from naive.identification import example

from stoop.assessment.goodness_of_fit import join
from stoop.base import numbers
from stoop.base.notices import as_notice, notice
from stoop.base.numbers import clock, compact, count, factor_and_unit, number, rounded_to_error
from stoop.base.text import enumerated
from stoop.report.estimates import TITLES
from stoop.report.extensions import as_toml
from stoop.report.identification import reasons, verdict
from stoop.report.maneuvers import air_history, prediction_verdict
from stoop.report.series import spanning
from stoop.report.svg import Scale
from stoop.report.time_history import holes
from stoop.results import result as results
from stoop.results.extensions import ExtensionTests
from stoop.results.result import BaselineFit, GoodnessOfFit, ManeuverResult, ParameterEstimate, Result
from stoop.results.text import determined, estimate_blocks, undetermined_lines, window_line, with_error
from stoop.results.uncertainty import IdentifiabilityAnalysis, ParameterIdentifiability
from stoop.results.verdict import shortened


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
    assert numbers.window(140.0, 168.3) == "140–168.3 s"
    assert [count(n, "parameter") for n in (1, 2)] == ["1 parameter", "2 parameters"]
    assert [enumerated(names) for names in ([], ["a"], ["a", "b", "c"])] == ["none", "a", "a, b and c"]
    assert enumerated([str(n) for n in range(12)], most=2) == "0, 1 and 10 more"
    for unit, found in {"rad/s": (pytest.approx(57.29578), "deg/s"), "m/s2": (1.0, "m/s²"),
                        "1/rad2": (1.0, "1/rad²"), "1": (1.0, "")}.items():  # fmt: skip
        assert factor_and_unit(unit) == found
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


def test_air_data_share_drawings_and_break_at_pauses() -> None:
    time = np.concatenate([np.arange(0.0, 5.0, 0.1), np.arange(9.0, 12.0, 0.1)])
    names = ("speed_inertial", "pitot", "pitot_corrected", "V", "beta", "beta_from_force", "strange<b>")
    trace = results.AirDataTrace("f", time, {name: time + n for n, name in enumerate(names)})
    panels = air_history(example(("CL0",)), trace).panels
    titles = [("Airspeed", "m/s"), ("Sideslip", "deg"), ("strange<b>", "")]
    assert [(panel.title, panel.unit) for panel in panels] == titles
    (airspeed,) = panels[0].strips
    shown = ["V", "pitot, corrected", "pitot as logged", "ground velocity minus wind"]
    assert [one.name for one in airspeed.series] == shown
    assert all(np.isnan(one.x).sum() == 1 for one in airspeed.series)
    assert holes(join([np.array([1.0, 2.0]), np.array([5.0, 6.0])])) == [(2.0, 5.0)]
    assert holes(np.array([1.0, 2.0])) == []


def good() -> Result:
    whole: Result = example(("CL0",)).result
    figures = {"p": GoodnessOfFit(0.1, 0.1, 0.9, 0.2)}
    uses = ((0.0, "fit"), (2.0, "validation"), (4.0, "fit"))
    maneuvers = tuple(ManeuverResult("f", start, start + 1.0, use, (), figures) for start, use in uses)
    parameters, tests = {"CL0": ParameterEstimate(1.0, 0.1)}, ExtensionTests(100, 0.01)
    return replace(whole, parameters=parameters, maneuvers=maneuvers, notices=(), extensions=tests)


def sentences(result: Result) -> str:
    return " ".join(one for items in reasons(result).values() for one in items)


def test_a_good_verdict() -> None:
    found, said = verdict(good()), sentences(good())
    assert (found.level, found.against) == ("good", ())
    assert "known only in combination with others." in said
    assert "beats a trivial first-order lag in 2 of 2 comparisons" in said
    assert "None of 100 extensions of the model is significant." in found.supports
    sights = {"CL0": ParameterIdentifiability(0.1, 3.5, 0.9996, ("CLalpha",), notice("known-in-combination"))}
    for seen, words in ((sights, "estimated; 1 of them known only in combination with others."),
                        ({}, "1 parameter estimated, all of them identifiable.")):  # fmt: skip
        assert words in sentences(replace(good(), identifiability=IdentifiabilityAnalysis(parameters=seen)))


def test_a_channel_in_which_only_noise_is_left_is_not_lost() -> None:
    """A window that does not move the yaw shows its noise, which no model matches; chance decides who is closer."""
    moved, whole = GoodnessOfFit(0.1, 0.1, 0.9, 0.2), good()
    for left, level in (("white", "good"), ("colored", "caution"), ("", "caution")):
        still = GoodnessOfFit(0.1, 0.65, 0.0, 0.63, whiteness=results.Whiteness(verdict=left))
        maneuvers = tuple(replace(m, channels={"p": moved, "r": still}) for m in whole.maneuvers)
        result = replace(whole, maneuvers=maneuvers)
        assert verdict(result).level == level
        said = sentences(result)
        assert ("and leaves only noise in 2 more" in said) == (left == "white")
        assert ("not in r (0–1 s)" in said) == (left != "white")
    assert GoodnessOfFit(math.nan, math.nan, math.nan, 0.6).lost, "it diverged"


def test_verdicts() -> None:
    whole, unknown = good(), ParameterEstimate(1.0, identifiable=False)
    bounded = {"a": ParameterEstimate(1.0, at_bound=True), "b": ParameterEstimate(1.0)}
    lost = replace(whole.maneuvers[1], channels={"r": GoodnessOfFit(0.1, 0.6, 0.1, 0.5)})
    fitted = whole.maneuvers[::2]
    cases: list[tuple[dict[str, Any], str, str]] = [
        ({"notices": (as_notice("pitot"),)}, "caution", ""), ({"cost": math.nan}, "bad", ""),
        ({"notices": (as_notice("from the file", "info"),)}, "good", ""), ({"status": "interrupted"}, "bad", "interrupted"),
        ({"status": "budget"}, "bad", "used up its trajectories"), ({"status": "something new"}, "bad", "“something new”"),
        ({"parameters": {"a": unknown}}, "bad", "1 of them is not identifiable (a)"),
        ({"parameters": bounded}, "caution", "1 lies at a bound (a)"), ({"advice": "widen the box"}, "good", "widen the box"),
        ({"maneuvers": (*fitted, lost)}, "bad", "not in r (2–3 s)"),
        ({"maneuvers": fitted}, "caution", "No window was held back"),
    ]  # fmt: skip
    for changes, level, said in cases:
        result = replace(whole, **changes)
        found = verdict(result)
        assert found.level == level, changes
        assert (found.level == "good") == (not found.against)
        assert len(found.against) <= 3 >= len(found.supports)
        assert said in sentences(result)


def test_a_refused_model_is_no_good_one_however_it_predicts() -> None:
    maneuvers = good().maneuvers
    assert prediction_verdict(maneuvers, refused=False).level == "good"
    refused = prediction_verdict(maneuvers, refused=True)
    assert refused.level == "bad"
    assert refused.headline.endswith("lag, but its identification says: do not use it.")


def test_every_method_of_uncertainty_has_a_color() -> None:
    style = files("stoop.report").joinpath("templates/style.css").read_text()
    assert all(f".method-{name}{key} {{" in style for name in TITLES for key in ("", "key"))


def test_the_line_of_an_extension_can_be_pasted_into_a_vehicle_file() -> None:
    one = "[controls.aileron] lag = 0.035"
    assert tomllib.loads(as_toml(one)) == {"controls": {"aileron": {"lag": 0.035}}}
    three = "[controls.aileron] lag = 0.03; [controls.elevator] lag = { value = 0.03 }; [controls.aileron] delay = 0.1"
    lag = {"aileron": {"lag": 0.03, "delay": 0.1}, "elevator": {"lag": {"value": 0.03}}}
    assert tomllib.loads(as_toml(three)) == {"controls": lag}


def test_an_estimate_has_the_digits_of_its_error() -> None:
    for value, error, shown in (
        (1.18416, 0.19634, "1.18 +- 0.20"), (-14.28, 6.31, "-14.3 +- 6.3"), (0.0357, 0.3602, "0.04 +- 0.36"),
        (0.0006045, 0.0009853, "0.00060 +- 0.00099"), (-0.001256, 0.00091, "-0.00126 +- 0.00091"),
        (12345.6, 1234.5, "12346 +- 1234"), (-0.000005, 0.00019, "-0.00001 +- 0.00019"), (0.0, 0.1, "0.00 +- 0.10"),
        (5.0, math.nan, "5.000"),
    ):  # fmt: skip
        assert with_error(value, error) == shown


def test_a_group_of_coefficients_is_a_block() -> None:
    names = ["CL0", "CLalpha", "CLq", "Cl0", "Clp", "propulsion.CT0", "controls.elevator.lag"]
    lines = estimate_blocks(dict.fromkeys(names, (1.0, 0.1)), width=60)
    first = [line.split()[0] for line in lines]
    assert first == ["CL0", "CLq", "Cl0", "propulsion.CT0", "controls.elevator.lag"]
    assert max(map(len, lines)) <= 60
    assert lines[2].index("Clp") == lines[0].index("CLalpha") - len("CLalpha") + len("Clp")


def test_what_the_data_do_not_determine_is_one_line_and_so_is_a_window() -> None:
    result = example().result
    lines = undetermined_lines(result.parameters)
    named = {name for line in lines for name in line.partition(": ")[2].replace(" and ", ", ").split(", ")}
    assert named == set(result.parameters) - set(determined(result.parameters))
    assert [line.partition(":")[0] for line in lines] == ["not identifiable", "at a bound"]
    for m in result.maneuvers:
        assert "\n" not in window_line(m)
        assert window_line(m).startswith(m.window)


def test_long_lists_are_counted() -> None:
    names = tuple("abcdef")
    assert "a, b, c and 3 more" in str(shortened(notice("at-zero", parameters=names, count=6)))
    few = notice("at-zero", parameters=names[:4], count=4)
    assert shortened(few) == few


def test_channels_that_are_not_judged_are_named() -> None:
    good, lost, hidden = (
        GoodnessOfFit(1.0, theil, 0.5, 0.2, baseline=BaselineFit(rmse=0.5), noise=0.1, signal_to_noise=ratio)
        for theil, ratio in ((0.1, 9.0), (0.4, 9.0), (0.4, 0.5))
    )
    channels = {"q": good, "alpha": lost, "V": hidden}
    line = window_line(ManeuverResult("flight", 0.0, 1.0, "validation", (), channels))
    assert "better than a first-order lag in 1 of 2 channels (not in alpha; not judged: V)" in line
