"""Numbers and columns of text."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from stoop.base.text import printable
from stoop.cli.page import Column, alike, blocks, fit, fixed, number, numbers, plain, points, words

NUMBERS = st.floats(-1e300, 1e300)
TEXTS = st.text(st.characters(codec="utf-8"), max_size=30)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (-0.0, "0"),
        (1.0, "1.000"),
        (1.0 - 1e-16, "1.000"),
        (0.99999, "1.000"),
        (-2.5, "-2.500"),
        (0.00012344, "0.0001234"),
        (1.2e-5, "1.200e-05"),
        (100138.99, "100139"),
        (1e7, "1.000e+07"),
        (math.nan, "-"),
        (math.inf, "inf"),
    ],
)
def test_number(value: float, text: str) -> None:
    assert number(value) == text


@given(NUMBERS)
def test_number_keeps_four_digits(value: float) -> None:
    assert float(number(value)) == pytest.approx(value, rel=5.001e-4, abs=1e-320)


@given(st.lists(NUMBERS, min_size=1, max_size=8))
def test_points_stand_below_each_other(values: list[float]) -> None:
    texts = points("", [number(v) for v in values]).cells
    tails = {len(text) - (text.index(".") if "." in text else len(text.rstrip())) for text in texts}
    assert len(tails) == 1


@given(st.lists(st.floats(1e-3, 1e6) | st.floats(-1e6, -1e-3), min_size=1, max_size=5))
def test_alike_gives_one_number_of_decimals(values: list[float]) -> None:
    texts = alike(values)
    assert len({len(text.partition(".")[2]) for text in texts}) == 1
    worst = max(map(abs, values))
    for text, value in zip(texts, values, strict=True):
        assert abs(float(text) - value) <= 5.001e-4 * worst


def test_what_rounds_to_zero_has_no_sign() -> None:
    assert fixed("x", [-1e-9], 3).cells == ("0.000",)
    assert alike([-1e-9, 1.0]) == ["0.000", "1.000"]


def test_plain_table_lines_up() -> None:
    text = plain([words("name", ["a", "bcd"]), numbers("value", [1.5, -20.0]), words("unit", ["m", ""])])
    assert text.splitlines() == [
        "name    value  unit",
        "a       1.500  m",
        "bcd   -20.00",
    ]


@given(st.lists(TEXTS, min_size=1, max_size=5), st.integers(20, 60))
def test_fitted_table_is_no_wider_than_the_page(cells: list[str], width: int) -> None:
    label = words("", [str(i) for i in range(len(cells))])
    for wraps in (False, True):
        for line in plain(fit([label, words("text", cells, wraps=wraps)], width)).splitlines():
            assert len(line) <= width


def test_folded_column_loses_no_word() -> None:
    label, text = words("", ["1", "2"]), words("text", ["one two three four five six", "seven"], wraps=True)
    folded = fit([label, text], 20)
    assert " ".join(folded[1].cells).split() == "one two three four five six seven".split()  # noqa: SIM905
    assert [c for c in folded[0].cells if c] == ["1", "2"]


def test_stump_of_a_column_is_left_out() -> None:
    columns = [Column("", ("x" * 70,)), words("meaning", ["a long explanation of it all"])]
    assert fit(columns, 80) == columns[:1]
    assert fit(columns, 100) == columns


@given(st.lists(st.integers(1, 20), min_size=1, max_size=12), st.integers(25, 80))
def test_blocks_hold_every_column_once(widths: list[int], width: int) -> None:
    label = words("A", ["row"])
    columns = [words(str(i), ["x" * w]) for i, w in enumerate(widths)]
    parts = blocks(label, columns, width)
    assert [c for part in parts for c in part[1:]] == columns
    assert all(part[0] is label for part in parts)
    assert all(len(line) <= width for part in parts for line in plain(part).splitlines())


@given(st.text(max_size=40))
def test_printable_is_one_harmless_line(text: str) -> None:
    out = printable(text)
    assert out.isprintable()
    assert printable(out) == out


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain [red]text[/red]", "plain [red]text[/red]"),
        ("two\nlines", "two lines"),
        ("\x1b]0;title\x07", "\\x1b]0;title\\x07"),
        ("right\u202eleft", "right\\u202eleft"),
        ("lost byte \udcff", "lost byte \\udcff"),
        ("å 飛", "å 飛"),
    ],
)
def test_printable(text: str, shown: str) -> None:
    assert printable(text) == shown
