"""What the command line says of a campaign."""

from __future__ import annotations

import argparse
import io
import sys
from pathlib import Path

import pytest
from unit.parallel.works import walks

from stoop.base.text import duration
from stoop.base.verbs import shared_options
from stoop.cli.options import add_options
from stoop.cli.progress import QUIET, Display, pool, run_campaign
from stoop.parallel import Dask, LocalProcesses, Tally


class Terminal(io.StringIO):
    """A stream that says it is a terminal."""

    def isatty(self) -> bool:
        return True


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(exit_on_error=False)
    shared = shared_options()
    add_options(parser, (shared["workers"], shared["scheduler"]))
    return parser.parse_args(words)


def test_where_the_runs_are_done() -> None:
    assert pool(parsed("--workers", "3")) == LocalProcesses(3)
    assert pool(parsed()) == LocalProcesses()
    assert pool(parsed("--scheduler", "tcp://a:1")) == Dask("tcp://a:1")


@pytest.mark.parametrize("words", [("--workers", "0"), ("--workers", "2", "--scheduler", "tcp://a:1")])
def test_options_that_make_no_sense(words: tuple[str, ...]) -> None:
    with pytest.raises(argparse.ArgumentError):
        parsed(*words)


def test_a_log_gets_a_line_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    display = Display("table1")
    with display:
        display.see(Tally(0, 10, 0, 0.0, None))
        display.see(Tally(1, 10, 0, 0.1, 0.9))
        display.see(Tally(1, 10, 0, 0.2, 0.9, "waiting for a worker"))
        display.see(Tally(1, 10, 0, 0.3, 0.9, "waiting for a worker"))
        display._printed -= QUIET
        display.see(Tally(5, 10, 2, 6.0, 5.6))
        display.see(Tally(10, 10, 2, 7.0, 0.0))
    assert capsys.readouterr().err.splitlines() == [
        "table1: 0 of 10 runs",
        "table1: 1 of 10 runs, waiting for a worker",
        "table1: 5 of 10 runs, 2 from before, 0:06 left",
        "table1: 10 of 10 runs, 2 from before",
    ]
    assert display.done == 10


def test_a_terminal_gets_a_live_line(monkeypatch: pytest.MonkeyPatch) -> None:
    terminal = Terminal()
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setattr(sys, "stderr", terminal)
    display = Display("[bold]\x1b")
    with display:
        display.see(Tally(3, 10, 0, 1.0, 5000.0))
        display._status._live.refresh()
    assert "[bold]\\x1b: 3 of 10 runs, 1:23:20 left" in terminal.getvalue()


@pytest.mark.parametrize(
    ("seconds", "text"), [(0.4, "0:00"), (59.6, "1:00"), (750.0, "12:30"), (11100.0, "3:05:00")]
)
def test_duration(seconds: float, text: str) -> None:
    assert duration(seconds) == text


def test_a_campaign_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run_campaign(
        parsed("--workers", "1"), walks(tmp_path / "log", 3), tmp_path / "folder" / "runs.sqlite"
    )
    assert list(found) == ["000/None", "001/None", "002/None"]
    assert capsys.readouterr().err.startswith("walks: 0 of 3 runs\n")


@pytest.mark.parametrize(
    ("done", "words"),
    [
        (7, "interrupted; 7 runs are safe in {}: give the same command to do the others"),
        (1, "interrupted; 1 run is safe in {}: give the same command to do the others"),
        (0, "interrupted before any run was done; give the same command to begin again"),
    ],
)
def test_ctrl_c(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    done: int,
    words: str,
) -> None:
    def press(self: Display, tally: Tally) -> None:
        self.done = done
        raise KeyboardInterrupt

    monkeypatch.setattr(Display, "see", press)
    store = tmp_path / "runs.sqlite"
    with pytest.raises(SystemExit) as leaving:
        run_campaign(parsed("--workers", "1"), walks(tmp_path / "log", 3), store)
    assert leaving.value.code == 130
    assert capsys.readouterr().err == f"stoop: {words.format(store)}\n"
