"""What the command line says of a campaign."""

import argparse
import re
from pathlib import Path

import pytest
from helpers.works import walks

from stoop.base.text import duration
from stoop.base.verbs import add_options, shared_options
from stoop.cli.progress import QUIET, Display, pool, run_campaign
from stoop.parallel import CampaignError, Dask, LocalProcesses, Tally


def parsed(*words: str) -> argparse.Namespace:
    parser = argparse.ArgumentParser(exit_on_error=False)
    shared = shared_options()
    add_options(parser, (shared["workers"], shared["scheduler"]))
    return parser.parse_args(words)


def test_where_the_runs_are_done() -> None:
    assert (pool(parsed("--workers", "3")), pool(parsed())) == (LocalProcesses(3), LocalProcesses())
    for address in ("tcp://a:1", "tcp://[::1]:8786", "tls://10.0.0.1:1", "tcp://node-3.cluster:65535"):
        assert pool(parsed("--scheduler", address)) == Dask(address)
    for words in (("--workers", "0"), ("--workers", "2", "--scheduler", "tcp://a:1")):
        with pytest.raises(argparse.ArgumentError):
            parsed(*words)
    for address in (
        "nonsense", "nonsense://x:1", "127.0.0.1:8786", "tcp://127.0.0.1", "tcp://:1", "tcp://a:0", "tcp://a:99999",
        "tcp://a b:1", "tcp://[::1:1", "tcp://a:1/", "",
    ):  # fmt: skip
        told = f"^scheduler {re.escape(repr(address))}: is no address; give tcp://"
        with pytest.raises(CampaignError, match=told):
            Dask(address)


def test_a_log_gets_a_line_now_and_then(capsys: pytest.CaptureFixture[str]) -> None:
    with Display("table1\x1b") as display:
        display.see(Tally(0, 10, 0, 0.0, None))
        display.see(Tally(1, 10, 0, 0.1, 0.9))
        for seconds in (0.2, 0.3):
            display.see(Tally(1, 10, 0, seconds, 0.9, "waiting for a worker"))
        display._printed -= QUIET
        display.see(Tally(5, 10, 2, 6.0, 5.6))
        display.see(Tally(10, 10, 2, 7.0, 0.0))
    said = ["0", "1 waiting for a worker", "5 2 from before, 0:06 left", "10 2 from before"]
    told = capsys.readouterr().err.replace(" of 10 runs", "").splitlines()
    lines = [line.replace(",", "", 1) for line in told]
    assert lines == [f"table1\\x1b: {words}" for words in said]
    texts = {0.4: "0:00", 59.6: "1:00", 750.0: "12:30", 11100.0: "3:05:00"}
    assert {seconds: duration(seconds) for seconds in texts} == texts


def test_ctrl_c(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    store, again = tmp_path / "runs.sqlite", "give the same command to"
    said = {
        n: f"; {what} safe in {store}: {again} do the others"
        for n, what in ((7, "7 runs are"), (1, "1 run is"))
    }
    for done, words in (said | {0: f" before any run was done; {again} begin again"}).items():

        def press(self: Display, tally: Tally, done: int = done) -> None:
            self.done = done
            raise KeyboardInterrupt

        monkeypatch.setattr(Display, "see", press)
        with pytest.raises(SystemExit) as leaving:
            run_campaign(parsed("--workers", "1"), walks(tmp_path / "log", 3), store)
        assert (leaving.value.code, capsys.readouterr().err) == (130, f"stoop: interrupted{words}\n")
