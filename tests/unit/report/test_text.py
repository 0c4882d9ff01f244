"""Results in a few lines: estimates by group, short lists, windows."""

from __future__ import annotations

import math
from types import ModuleType

import pytest

from stoop.base.notices import notice
from stoop.results.text import (
    determined,
    estimate_blocks,
    undetermined_lines,
    window_line,
    with_error,
)
from stoop.results.verdict import shortened


@pytest.mark.parametrize(
    ("value", "error", "shown"),
    [
        (1.18416, 0.19634, "1.18 +- 0.20"),
        (-14.28, 6.31, "-14.3 +- 6.3"),
        (0.0006045, 0.0009853, "0.00060 +- 0.00099"),
        (0.0357, 0.3602, "0.04 +- 0.36"),
        (-0.001256, 0.00091, "-0.00126 +- 0.00091"),
        (12345.6, 1234.5, "12346 +- 1234"),
        (-0.000005, 0.00019, "-0.00001 +- 0.00019"),
        (0.0, 0.1, "0.00 +- 0.10"),
        (5.0, math.nan, "5.000"),
    ],
)
def test_an_estimate_has_the_digits_of_its_error(value: float, error: float, shown: str) -> None:
    assert with_error(value, error) == shown


def test_a_group_of_coefficients_is_a_block() -> None:
    names = ["CL0", "CLalpha", "CLq", "Cl0", "Clp", "propulsion.CT0", "controls.elevator.lag"]
    lines = estimate_blocks(dict.fromkeys(names, (1.0, 0.1)), width=60)
    assert [line.split()[0] for line in lines] == [
        "CL0",
        "CLq",
        "Cl0",
        "propulsion.CT0",
        "controls.elevator.lag",
    ]
    assert max(map(len, lines)) <= 60
    assert lines[2].index("Clp") == lines[0].index("CLalpha") - len("CLalpha") + len("Clp")


def test_what_the_data_do_not_determine_is_one_line(examples: ModuleType) -> None:
    found = examples.example().result.parameters
    lines = undetermined_lines(found)
    named = {name for line in lines for name in line.partition(": ")[2].replace(" and ", ", ").split(", ")}
    assert named == set(found) - set(determined(found))
    assert [line.partition(":")[0] for line in lines] == ["not identifiable", "at a bound"]


def test_long_lists_are_counted() -> None:
    names = tuple("abcdef")
    found = notice("at-zero", parameters=names, count=6)
    assert "a, b, c and 3 more" in str(shortened(found))
    few = notice("at-zero", parameters=names[:4], count=4)
    assert shortened(few) == few


def test_a_window_is_one_line(examples: ModuleType) -> None:
    maneuvers = examples.example().result.maneuvers
    assert all("\n" not in window_line(m) and window_line(m).startswith(m.window) for m in maneuvers)
