"""What the command line says of a campaign."""

from __future__ import annotations

import argparse
import io
import re
import sys
from pathlib import Path

import pytest
from unit.parallel.works import walks

from stoop.base.text import duration
from stoop.base.verbs import shared_options
from stoop.cli.options import add_options
from stoop.cli.progress import QUIET, Display, pool, run_campaign
from stoop.parallel import CampaignError, Dask, LocalProcesses, Tally


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
    for words in (("--workers", "0"), ("--workers", "2", "--scheduler", "tcp://a:1")):
        with pytest.raises(argparse.ArgumentError):
            parsed(*words)
    for address in ("tcp://[::1]:8786", "tls://10.0.0.1:1", "tcp://node-3.cluster:65535"):
        assert Dask(address).address == address
    for address in (
        "nonsense", "nonsense://x:1", "127.0.0.1:8786", "tcp://127.0.0.1", "tcp://:1", "tcp://a:0", "tcp://a:99999",
        "tcp://a b:1", "tcp://[::1:1", "tcp://a:1/", "",
    ):  # fmt: skip
        with pytest.raises(
            CampaignError, match=f"^scheduler {re.escape(repr(address))}: is no address; give tcp://"
        ):
            Dask(address)


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
    texts = {0.4: "0:00", 59.6: "1:00", 750.0: "12:30", 11100.0: "3:05:00"}
    assert {seconds: duration(seconds) for seconds in texts} == texts


def test_a_campaign_from_the_command_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    found = run_campaign(
        parsed("--workers", "1"), walks(tmp_path / "log", 3), tmp_path / "folder" / "runs.sqlite"
    )
    assert list(found) == ["000/None", "001/None", "002/None"]
    assert capsys.readouterr().err.startswith("walks: 0 of 3 runs\n")


def test_ctrl_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    store, again = tmp_path / "runs.sqlite", "give the same command to"
    for done, words in (
        (7, f"interrupted; 7 runs are safe in {store}: {again} do the others"),
        (1, f"interrupted; 1 run is safe in {store}: {again} do the others"),
        (0, f"interrupted before any run was done; {again} begin again"),
    ):

        def press(self: Display, tally: Tally, done: int = done) -> None:
            self.done = done
            raise KeyboardInterrupt

        monkeypatch.setattr(Display, "see", press)
        with pytest.raises(SystemExit) as leaving:
            run_campaign(parsed("--workers", "1"), walks(tmp_path / "log", 3), store)
        assert leaving.value.code == 130
        assert capsys.readouterr().err == f"stoop: {words}\n"
