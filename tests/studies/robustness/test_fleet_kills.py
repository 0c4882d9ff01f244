"""`stoop fleet` over logs is killed again and again and started once more: its store is that of an undisturbed run, to the byte.

Half of the kills come at a random time, half right before the n-th change of a file. Two nights: the first begins a store, the
second adds logs to it, and one that has changed; an alarm is new then.
"""

from __future__ import annotations

import itertools
import math
import random
import shutil
import signal
from pathlib import Path

import numpy as np
import pytest
from studies.robustness.campaign import FACTOR
from studies.robustness.interruptions import Kill, differences, run_and_kill
from studies.robustness.small_runs import OUT, STORES, written

import stoop
from stoop.exporters.flight_logs import save_flight_as
from stoop.fleet.store import STATE
from stoop.flight import from_columns

KILLS = min(200, math.ceil(20 * FACTOR))  #: 200 with --hypothesis-profile=campaign
MOST = 4  #: kills of one night
LOGS, FIRST, CHANGED, WORN = 24, 10, 3, 8
ALARM = "a battery.resistance: step"
DONE = (0, 3)
OPTIONS = ("--flights", "flights.csv", "--parts", "parts.csv", "-o", OUT)
NIGHTS = (
    ("fleet", *(f"f{i}.csv" for i in range(FIRST)), *OPTIONS),
    ("fleet", f"second/f{CHANGED}.csv", *(f"f{i}.csv" for i in range(FIRST, LOGS)), *OPTIONS),
)


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with logs of two vehicles; the battery of `a` is worn from its ninth flight on."""
    folder = tmp_path_factory.mktemp("logs")
    rng, t, flights = np.random.default_rng(0), np.arange(0.0, 60.0, 0.2), ["flight,vehicle,time"]
    (folder / "second").mkdir()
    for i in (*range(LOGS), CHANGED):
        vehicle, flight = "ab"[i % 2], i // 2
        ohm = 0.07 if vehicle == "a" and flight >= WORN else 0.05
        current = 15.0 + 3.0 * rng.standard_normal(t.size)
        voltage = 16.8 - 0.006 * t - ohm * current + 0.05 * rng.standard_normal(t.size)
        again = len(flights) > LOGS
        place = folder / "second" if again else folder
        save_flight_as(
            from_columns(f"f{i}", t, {"voltage": voltage, "current": current}), place / f"f{i}.csv"
        )
        flights += [] if again else [f"f{i},{vehicle},2026-01-{1 + flight:02}T0{i % 2}:00"]
    (folder / "flights.csv").write_text("\n".join(flights))
    (folder / "parts.csv").write_text(
        "vehicle,part,serial,from,to\na,battery,B0,,2026-01-05\na,battery,B1,2026-01-05,"
    )
    return folder


@pytest.fixture(scope="module")
def undisturbed(logs: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, bytes], list[int]]:
    """Return the files after two nights in which nothing happens, and how many files each night changes."""
    folder, changes = scene(tmp_path_factory.mktemp("undisturbed"), logs), []
    for words in NIGHTS:
        assert run_and_kill(words, folder) in DONE, (folder / "stderr").read_text()
        changes.append(int((folder / "changes").read_text()))
    assert ALARM in (folder / "stdout").read_text()
    files = {name: x for name, x in written(folder / OUT).items() if not name.endswith(STORES)}
    assert {STATE, "fleet.html", "parts.csv", "absent.csv", "dates.csv", "figures/logs.parquet"} == set(files)
    return files, changes


def scene(folder: Path, logs: Path) -> Path:
    shutil.copytree(logs, folder, dirs_exist_ok=True)
    (folder / OUT).mkdir()
    return folder


def check_store(folder: Path) -> None:
    """What a killed command leaves is a fleet, or none yet."""
    if (folder / OUT / STATE).exists():
        stoop.open_fleet(folder / OUT)
    assert len([*(folder / OUT).glob(".stoop-unfinished-*")]) <= 1, "what is left over piles up"


@pytest.mark.parametrize("last", [1, 2, 3])
def test_a_store_survives_a_kill_before_each_of_its_files_is_moved(
    last: int, logs: Path, undisturbed: tuple[dict[str, bytes], list[int]], tmp_path: Path
) -> None:
    files, changes = undisturbed
    folder, told = scene(tmp_path, logs), ""
    for words, count in zip(NIGHTS, changes, strict=True):
        assert run_and_kill(words, folder, Kill(signal.SIGKILL, change=count - last)) == -signal.SIGKILL
        check_store(folder)
        assert run_and_kill(words, folder) in DONE
        told += (folder / "stdout").read_text()
    assert ALARM in told
    assert differences(files, folder / OUT) == ""


def test_kills_at_any_moment(
    logs: Path, undisturbed: tuple[dict[str, bytes], list[int]], tmp_path: Path
) -> None:
    files, changes = undisturbed
    rng, kills = random.Random(1), 0  # noqa: S311
    for number in itertools.count():
        if kills >= KILLS:
            break
        folder, told = scene(tmp_path / str(number), logs), ""
        for words, count in zip(NIGHTS, changes, strict=True):
            for _ in range(MOST):
                by_change = Kill(signal.SIGKILL, change=rng.randint(1, count))
                by_time = Kill(signal.SIGKILL, after=rng.uniform(0.0, 2.0))
                kill = by_change if rng.random() < 0.5 else by_time
                ending = run_and_kill(words, folder, kill)
                told += (folder / "stdout").read_text()
                assert ending in (-signal.SIGKILL, *DONE), (folder / "stderr").read_text()
                kills += ending == -signal.SIGKILL
                check_store(folder)
            assert run_and_kill(words, folder) in DONE, (folder / "stderr").read_text()
            told += (folder / "stdout").read_text()
        assert ALARM in told, "an alarm is told before the store takes it for told"
        assert differences(files, folder / OUT) == ""
        shutil.rmtree(folder)
