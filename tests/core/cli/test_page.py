"""The same words on a terminal and in a pipe; nothing from a file is markup; numbers and columns of text."""

import argparse
import io
import json
import math
import os
import sys
import time
from pathlib import Path
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.console import Console

from stoop.base.text import duration, printable, remaining
from stoop.base.verbs import page_path
from stoop.cli import page as pages
from stoop.cli.page import Page, alike, blocks, fit, fixed, number, numbers, plain, points, to_json, words
from stoop.cli.progress import LiveLine, Timed, Watch

NUMBERS = st.floats(-1e300, 1e300)
TEXTS = st.text(st.characters(codec="utf-8"), max_size=30)
WIDTHS = st.lists(st.integers(1, 20), min_size=1, max_size=12)


def terminal(width: int = 80) -> tuple[Page, io.StringIO]:
    written = io.StringIO()
    plainly = {"markup": False, "highlight": False, "emoji": False, "color_system": None}
    return Page(Console(file=written, width=width, force_terminal=True, **plainly)), written  # type: ignore[arg-type]


def test_a_terminal_wraps_notes_and_tables_but_no_command() -> None:
    out, written = terminal(30)
    out.bullets(["a note that is much longer than thirty characters"])
    lines = [line.rstrip() for line in written.getvalue().splitlines()]
    assert lines[0].startswith("- a note")
    assert all(line.startswith("  ") for line in lines[1:])
    assert all(len(line) <= 30 for line in lines)
    out, written = terminal(30)
    out.command("next: ", ["stoop", "info", "a file with blanks and a long name.nc", "--json"])
    assert written.getvalue().strip() == "next: stoop info 'a file with blanks and a long name.nc' --json"
    out, written = terminal(60)
    out.table(words("name", ["x" * 20]), numbers("value", [1.25]), words("meaning", ["words " * 20]))
    lines = written.getvalue().splitlines()
    assert all(len(line) <= 60 for line in lines)
    assert lines[1].endswith("...")
    assert pages.page().width == pages.UNLIMITED, "of a pipe"


def test_json_is_strict() -> None:
    text = to_json({"nan": math.nan, "deep": [{"inf": (math.inf, 1.0)}], "text": "\x1b\udcff"})
    assert json.loads(text) == {"nan": None, "deep": [{"inf": [None, 1.0]}], "text": "\x1b\udcff"}
    assert text.isascii()


def test_a_page_has_the_ending_of_a_page(tmp_path: Path) -> None:
    for given_path, path in (("a.HTM", "a.HTM"), ("out", "out.html"), ("a/out.htm", "a/out.htm"),
                             (str(tmp_path), str(tmp_path)), (os.devnull, os.devnull)):  # fmt: skip
        assert page_path(given_path) == Path(path)
    with pytest.raises(argparse.ArgumentTypeError, match=r"^a\.pdf: a page is written as \.html; name it so"):
        page_path("a.pdf")


def test_number() -> None:
    for value, text in (
        (0.0, "0"), (-0.0, "0"), (1.0, "1.000"), (1.0 - 1e-16, "1.000"), (0.99999, "1.000"), (-2.5, "-2.500"),
        (0.00012344, "0.0001234"), (1.2e-5, "1.200e-05"), (100138.99, "100139"), (1e7, "1.000e+07"), (math.nan, "-"),
        (math.inf, "inf"),
    ):  # fmt: skip
        assert number(value) == text


@given(st.lists(NUMBERS, min_size=1, max_size=8))
def test_numbers_keep_four_digits_and_points_stand_below_each_other(values: list[float]) -> None:
    for value in values:
        assert float(number(value)) == pytest.approx(value, rel=5.001e-4, abs=1e-320)
    texts = points("", [number(v) for v in values]).cells
    assert len({len(text) - (text.index(".") if "." in text else len(text.rstrip())) for text in texts}) == 1


@given(st.lists(st.floats(1e-3, 1e6) | st.floats(-1e6, -1e-3), min_size=1, max_size=5))
def test_alike_gives_one_number_of_decimals(values: list[float]) -> None:
    texts = alike(values)
    assert len({len(text.partition(".")[2]) for text in texts}) == 1
    worst = max(map(abs, values))
    for text, value in zip(texts, values, strict=True):
        assert abs(float(text) - value) <= 5.001e-4 * worst


def test_tables_of_text() -> None:
    assert fixed("x", [-1e-9], 3).cells == ("0.000",), "what rounds to zero has no sign"
    assert alike([-1e-9, 1.0]) == ["0.000", "1.000"]
    text = plain([words("name", ["a", "bcd"]), numbers("value", [1.5, -20.0]), words("unit", ["m", ""])])
    assert text.splitlines() == ["name    value  unit", "a       1.500  m", "bcd   -20.00"]
    label, text = words("", ["1", "2"]), words("text", ["one two three four five six", "seven"], wraps=True)
    folded = fit([label, text], 20)
    assert " ".join(folded[1].cells).split() == "one two three four five six seven".split()  # noqa: SIM905
    assert [c for c in folded[0].cells if c] == ["1", "2"]
    columns = [pages.Column("", ("x" * 70,)), words("meaning", ["a long explanation of it all"])]
    assert fit(columns, 80) == columns[:1], "the stump of a column is left out"
    assert fit(columns, 100) == columns


@given(st.lists(TEXTS, min_size=1, max_size=5), WIDTHS, st.integers(25, 80))
def test_tables_and_blocks_are_as_wide_as_the_page(cells: list[str], widths: list[int], width: int) -> None:
    label = words("", [str(i) for i in range(len(cells))])
    for wraps in (False, True):
        for line in plain(fit([label, words("text", cells, wraps=wraps)], width)).splitlines():
            assert len(line) <= width
    label, columns = words("A", ["row"]), [words(str(i), ["x" * w]) for i, w in enumerate(widths)]
    parts = blocks(label, columns, width)
    assert [c for part in parts for c in part[1:]] == columns
    assert all(part[0] is label for part in parts)
    assert all(len(line) <= width for part in parts for line in plain(part).splitlines())


def test_printable() -> None:
    for text, printed in (
        ("plain [red]text[/red]", "plain [red]text[/red]"), ("two\nlines", "two lines"), ("å 飛", "å 飛"),
        ("\x1b]0;title\x07", "\\x1b]0;title\\x07"), ("right\u202eleft", "right\\u202eleft"),
        ("lost byte \udcff", "lost byte \\udcff"),
    ):  # fmt: skip
        assert printable(text) == printed


class Terminal(io.StringIO):
    def isatty(self) -> bool:
        return True


def test_durations() -> None:
    assert [duration(s) for s in (7.2, 750.0, 11100.0)] == ["0:07", "12:30", "3:05:00"]
    assert remaining(10.0, 5, 20) == ", 0:30 left"
    assert remaining(10.0, 0, 20) == remaining(10.0, 20, 20) == ""


def test_the_time_of_a_live_line_goes_on_by_itself(monkeypatch: pytest.MonkeyPatch) -> None:
    now = [100.0]
    monkeypatch.setattr(time, "perf_counter", lambda: now[0])
    line = Timed("reading\x1b[31m", 95.0)
    assert line.__rich__().plain == "reading\\x1b[31m  [0:05]"
    now[0] = 160.0
    assert line.__rich__().plain.endswith("[1:05]")


def event(generation: int, trajectories: float) -> SimpleNamespace:
    state, kind = SimpleNamespace(generation=generation), SimpleNamespace(kind="refinement")
    return SimpleNamespace(state=state, trajectories=trajectories, cost=2.0, event=kind)


def test_a_terminal_shows_the_time_that_a_search_may_still_take(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with Watch() as watch:
        watch.count_from(0.0, budget=1000.0)
        watch._began = time.perf_counter() - 30.0
        watch.see(event(3, 250.0))  # type: ignore[arg-type]
    assert "at most 1:30 left" in terminal.getvalue()


def test_speed_is_of_this_run(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    now = iter([100.0, 110.0])
    monkeypatch.setattr(time, "perf_counter", lambda: next(now))
    watch = Watch()
    watch.count_from(5000.0)
    watch.see(event(7, 5200.0))  # type: ignore[arg-type]
    assert "5200 trajectories  20/s" in capsys.readouterr().err


def test_a_dumb_terminal_and_a_pipe_see_plain_lines(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "dumb")
    with LiveLine("drawing") as line:
        line.turn_to("more")
        line.warn("look")
    assert terminal.getvalue() == "stoop: look\n"
