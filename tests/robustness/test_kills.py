import random
import shutil
import signal
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from robustness import small_runs
from robustness.kills import check_whole, differences, run_and_kill
from robustness.small_runs import COMMANDS, OUT, inputs, run, written
from robustness.trials import FACTOR, READ, REFUSED, Bounds, Child, check, lay_out

import stoop
from stoop.cli.main import INTERRUPTED
from stoop.flight import from_columns
from stoop_fleet.store import STATE
from stoop_plan.flight_logs import save_flight_as

LONG = ("identify", "search", "bootstrap", "compare", "verify")  #: verbs that save what they have
LOGS, FIRST, CHANGED, DONE = 24, 10, 3, (0, 3)
OPTIONS = ("--flights", "flights.csv", "--parts", "parts.csv", "-o", OUT)
NIGHTS = (
    ("fleet", *(f"f{i}.csv" for i in range(FIRST)), *OPTIONS),
    ("fleet", f"second/f{CHANGED}.csv", *(f"f{i}.csv" for i in range(FIRST, LOGS)), *OPTIONS),
)


def place(folder: Path) -> Path:
    lay_out(folder, inputs())
    (folder / OUT).mkdir()
    return folder


def again(words: tuple[str, ...], out: Path) -> tuple[str, ...]:
    if (out / "search.npz").exists():
        return (*words, "--resume")
    return (*words, "--overwrite") if (out / "result.json").exists() else words


def test_a_kill_before_files_are_moved_loses_nothing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    words = (*COMMANDS["table"], "--overwrite")
    lay_out(tmp_path, small_runs.files_of_a_flight())
    (tmp_path / OUT).mkdir()
    monkeypatch.chdir(tmp_path)
    assert run(words).code == 0  # here, so that copies of this process need import nothing
    expected = written(tmp_path / OUT)
    assert set(expected) == {"flight.csv", "flight.csv.toml"}
    assert run_and_kill(words, tmp_path) == 0
    changes = int((tmp_path / "changes").read_text())
    for change in range(changes - 3, changes + 1):
        assert run_and_kill(words, tmp_path, change) == -signal.SIGKILL
        there = {name: x for name, x in written(tmp_path / OUT).items() if not name.startswith(".")}
        assert there == expected, change
    assert run_and_kill(words, tmp_path) == 0
    assert written(tmp_path / OUT) == expected


@pytest.mark.parametrize("name", LONG)
def test_verbs_that_are_killed_leave_the_files_of_an_undisturbed_run(name: str, tmp_path: Path) -> None:
    words, rng = COMMANDS[name], random.Random(f"kills {name}")  # noqa: S311
    expected = small_runs.undisturbed(words)
    assert run_and_kill(words, place(tmp_path / "whole")) == 0
    changes = int((tmp_path / "whole" / "changes").read_text())
    for number in range(max(1, round(FACTOR))):
        folder = place(tmp_path / str(number))
        for _ in range(3):
            kind = rng.choice((signal.SIGKILL, signal.SIGKILL, signal.SIGTERM, signal.SIGINT))
            ending = run_and_kill(again(words, folder / OUT), folder, rng.randint(1, changes), kind)
            assert ending in (0, -kind, INTERRUPTED), (folder / "stderr").read_text()
            check_whole(folder / OUT)
        assert run_and_kill(again(words, folder / OUT), folder) == 0, (folder / "stderr").read_text()
        assert differences(expected, folder / OUT) == ""


def fleet_logs(folder: Path) -> Path:
    """Make logs of two vehicles; the battery of `a` is worn from its ninth flight on."""
    rng, t, flights = np.random.default_rng(0), np.arange(0.0, 60.0, 0.2), ["flight,vehicle,time"]
    (folder / "second").mkdir()
    for i in (*range(LOGS), CHANGED):
        vehicle, flight = "ab"[i % 2], i // 2
        ohm = 0.07 if vehicle == "a" and flight >= 8 else 0.05
        current = 15.0 + 3.0 * rng.standard_normal(t.size)
        voltage = 16.8 - 0.006 * t - ohm * current + 0.05 * rng.standard_normal(t.size)
        changed = len(flights) > LOGS
        target = folder / "second" if changed else folder
        flown = from_columns(f"f{i}", t, {"voltage": voltage, "current": current})
        save_flight_as(flown, target / f"f{i}.csv")
        flights += [] if changed else [f"f{i},{vehicle},2026-01-{1 + flight:02}T0{i % 2}:00"]
    (folder / "flights.csv").write_text("\n".join(flights))
    parts = ["vehicle,part,serial,from,to", "a,battery,B0,,2026-01-05", "a,battery,B1,2026-01-05,"]
    (folder / "parts.csv").write_text("\n".join(parts))
    return folder


def test_the_store_of_a_fleet_survives_kills(tmp_path: Path) -> None:
    """Two nights, each killed before each of its last moves: the store is that of undisturbed nights, the alarm told."""
    (tmp_path / "logs").mkdir()
    logs, changes = fleet_logs(tmp_path / "logs"), []
    whole, killed = (shutil.copytree(logs, tmp_path / name) for name in ("whole", "killed"))
    for folder in (whole, killed):
        (folder / OUT).mkdir()
    for words in NIGHTS:
        assert run_and_kill(words, whole) in DONE, (whole / "stderr").read_text()
        changes.append(int((whole / "changes").read_text()))
    alarm = "a battery.resistance: step"
    assert alarm in (whole / "stdout").read_text()
    expected = {name: x for name, x in written(whole / OUT).items() if not name.endswith(".sqlite")}
    files = {"fleet.html", "parts.csv", "absent.csv", "dates.csv", "figures/logs.parquet"}
    assert {*expected} == {STATE, *files}
    told = ""
    for words, count in zip(NIGHTS, changes, strict=True):
        for last in (2, 1):
            ending = run_and_kill(words, killed, count - last)
            assert ending in (-signal.SIGKILL, *DONE)
            told += (killed / "stdout").read_text()
            if (killed / OUT / STATE).exists():
                stoop.open_fleet(killed / OUT)
            assert len([*(killed / OUT).glob(".stoop-unfinished-*")]) <= 1, "what is left over piles up"
        assert run_and_kill(words, killed) in DONE
        told += (killed / "stdout").read_text()
    assert alarm in told
    assert differences(expected, killed / OUT) == ""


LIMITS = {"files of 4 kB": Bounds(60, file=2**12), "16 MiB of memory": Bounds(60, address_space=2**24)}


@pytest.mark.parametrize("kind", LIMITS)
def test_a_command_under_a_limit_ends_in_all_of_its_files_or_in_one_line(kind: str, tmp_path: Path) -> None:
    """As on a full disk: nothing half-written is left, and no input is lost."""

    def work(_: Path, name: str) -> str:
        small_runs.command(tmp_path / name, list(COMMANDS[name]))
        return READ

    for name in ("table", "state-space"):
        folder, expected = place(tmp_path / name), {*small_runs.undisturbed(COMMANDS[name])}
        with closing(Child(work, LIMITS[kind])) as child:
            ended = child(name)
        check("limits", kind, ended)
        assert all((folder / file).read_bytes() == content for file, content in inputs().items())
        there = {file for file in written(folder / OUT) if not file.startswith(".stoop-")}
        assert there == (set() if ended.outcome == REFUSED else expected)
