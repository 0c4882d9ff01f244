"""Live lines: what is done, how long it has taken, how long it will take; plain lines elsewhere."""

from __future__ import annotations

import io
import sys
import time
from types import SimpleNamespace

import pytest

from stoop.base.text import duration, remaining
from stoop.cli.progress import LiveLine, Timed, Watch
from stoop.report.propagation import shown


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
    """Return what a search tells after a generation."""
    kind = SimpleNamespace(kind="refinement")
    return SimpleNamespace(
        state=SimpleNamespace(generation=generation), trajectories=trajectories, cost=2.0, event=kind
    )


def test_a_terminal_shows_the_time_that_a_search_may_still_take(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    monkeypatch.setenv("TERM", "xterm")
    with Watch() as watch:
        watch.count_from(0.0, budget=1000.0)
        watch._began = time.perf_counter() - 30.0
        watch.see(event(3, 250.0))  # type: ignore[arg-type]
    assert "at most 1:30 left" in terminal.getvalue()


def test_speed_is_of_this_run_alone(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
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


def test_speeds_of_rotors_are_shown_in_rpm() -> None:
    for group, unit, factor, text in (
        ("Hover", "rad/s", 9.549297, "rpm"),
        ("Hover", "1", 1.0, ""),
        ("Control authority", "rad/s", 57.29578, "deg/s"),
    ):
        assert shown(SimpleNamespace(group=group, unit=unit)) == (pytest.approx(factor), text)  # type: ignore[arg-type]
