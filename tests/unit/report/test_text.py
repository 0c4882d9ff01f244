"""Results in a few lines: estimates by group, short lists, windows; where the information of proposed windows is drawn."""

from __future__ import annotations

import math
from types import ModuleType

import numpy as np
import pytest

from stoop.base.notices import notice
from stoop.input_design.windows import Proposed
from stoop.report.design import information_strip
from stoop.results.result import BaselineFit, GoodnessOfFit, ManeuverResult
from stoop.results.text import determined, estimate_blocks, undetermined_lines, window_line, with_error
from stoop.results.verdict import shortened


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


def test_what_the_data_do_not_determine_is_one_line_and_so_is_a_window(examples: ModuleType) -> None:
    result = examples.example().result
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


def test_information_is_drawn_over_its_windows_alone() -> None:
    windows = [
        Proposed("f", start, stop, "roll", "why", information, 0.0, True, "fit")
        for start, stop, information in ((1.0, 3.0, 2.0), (3.0, 8.0, 0.5))
    ]
    strip = information_strip(windows)
    (series,) = strip.series
    assert series.x == pytest.approx(np.array([1.0, 3.0, np.nan, 3.0, 8.0, np.nan]), nan_ok=True)
    assert series.y == pytest.approx(np.array([2.0, 2.0, np.nan, 0.5, 0.5, np.nan]), nan_ok=True)
    assert strip.zero
