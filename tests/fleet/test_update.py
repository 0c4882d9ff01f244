"""A fleet is updated from logs by the command and from Python alike; what cannot be used is told, and leaves nothing behind."""

import re
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import stoop
from stoop.cli.main import main
from stoop.errors import StoopError
from stoop.flight import from_columns
from stoop_plan.flight_logs import save_flight_as


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("logs")
    rng, t = np.random.default_rng(0), np.arange(0.0, 60.0, 0.2)
    for i in range(2):
        current = 15.0 + 3.0 * rng.standard_normal(t.size)
        columns = {"voltage": 16.8 - 0.05 * current, "current": current}
        save_flight_as(from_columns(f"f{i}", t, columns), folder / f"f{i}.csv")
    for i in range(12):
        (folder / f"broken{i:02}.ulg").write_bytes(b"ULog" + bytes([i]))
    (folder / "flights.csv").write_text("flight,vehicle,time\nf0,a,2026-01-01\nf1,a,2026-01-02\n")
    return folder


def copied(log: Path, to: Path) -> Path:
    shutil.copy(log.with_name(f"{log.name}.toml"), to.with_name(f"{to.name}.toml"))
    return Path(shutil.copy(log, to))


def files(store: Path) -> dict[str, bytes]:
    kept = (p for p in sorted(store.rglob("*")) if p.is_file() and p.suffix not in (".sqlite", ".html"))
    return {str(p.relative_to(store)): p.read_bytes() for p in kept}


def test_python_updates_a_fleet_as_the_command_does(logs: Path, tmp_path: Path) -> None:
    own = [logs / "f0.csv", logs / "f1.csv"]
    with ThreadPoolExecutor(1) as executor:
        update = stoop.update_fleet(tmp_path / "a", own, flights=str(logs / "flights.csv"), executor=executor)
        (tmp_path / "b").mkdir()
        for read in (tmp_path / "a").glob("*.sqlite"):  # for speed
            shutil.copy(read, tmp_path / "b")
        words = ["fleet", *map(str, own), "--flights", str(logs / "flights.csv")]
        assert main([*words, "-o", str(tmp_path / "b")]) == 0
        assert files(tmp_path / "a") == files(tmp_path / "b")
        assert (tmp_path / "a" / "fleet.html").exists()
        assert update.fleet.table.figures() == ("battery.resistance",)
        assert {group for _, group, _ in update.absent} >= {"rotors", "drag"}
        elsewhere = [copied(log, tmp_path / log.name) for log in own]
        before = files(tmp_path / "a")
        executor.shutdown()  # nothing is left to read
        stoop.update_fleet(tmp_path / "a", elsewhere, flights=logs / "flights.csv", executor=executor)
        assert files(tmp_path / "a") == before


def test_logs_of_no_use_are_told_one_by_one(logs: Path, tmp_path: Path, capsys: Any) -> None:
    (tmp_path / "parts.csv").write_text("vehicle,part,serial,from,to\na,batery,B1,,\nc,battery,B2,,\n")
    sources = [*sorted(logs.glob("*.ulg")), logs / "f0.csv", copied(logs / "f1.csv", tmp_path / "g.csv")]
    words = ["fleet", *map(str, sources), "--flights", str(logs / "flights.csv"), "--workers", "1"]
    assert main([*words, "--parts", str(tmp_path / "parts.csv"), "-o", str(tmp_path / "store")]) == 0
    told = capsys.readouterr().out.splitlines()
    unread = [line for line in told if line.startswith("not read: ")]
    assert (len(unread), unread[0][10:20]) == (11, "broken00: ")
    assert unread[-1].startswith("not read: 2 more flights (")
    (left,) = (line for line in told if line.startswith("left out: "))
    assert re.match("left out: g: .*has no row of flight g", left)
    parts = [line.partition(";")[0] for line in told if line.startswith("parts: ")]
    assert parts == ["parts: 1 vehicle without flights (c)", "parts: 1 place without figures (batery)"]


def test_nothing_is_left_of_a_store_that_no_log_could_begin(logs: Path, tmp_path: Path) -> None:
    store = tmp_path / "store"
    with ThreadPoolExecutor(1) as executor:
        unread = "no log gave a figure: broken00: "
        for sources, said in (([logs], "a folder, and not of one log"), ([logs / "broken00.ulg"], unread)):
            with pytest.raises(StoopError, match=said):
                stoop.update_fleet(store, sources, executor=executor)
            assert not store.exists()
        with pytest.raises(StoopError, match="give a table of the flights"):
            stoop.update_fleet(store, [logs / "f0.csv"], executor=executor)
    assert [one.suffix for one in store.iterdir()] == [".sqlite"], "what was read is not read again"
