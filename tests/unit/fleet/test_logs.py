"""Which files are tables, and what makes a log be read again."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from stoop.errors import StoopError
from stoop.fleet.logs import ABSENT, DATES, LogFigures, Reading, gathered, is_table, plan
from stoop.fleet.table import LOGS, read_figures

HEAD = "flight,vehicle,time,figure,value,std_error"


def test_a_table_is_told_by_its_head_and_judged_by_its_reader(tmp_path: Path) -> None:
    table, log, other = tmp_path / "figures.csv", tmp_path / "log.csv", tmp_path / "log.ulg"
    table.write_text(f"\ufeff{HEAD}\nf,v,soon,drag,1,1\n", encoding="utf-8")
    log.write_text("time,p,q,r\n0,1,2,3\n")
    other.write_text(HEAD)
    assert [is_table(one) for one in (table, log, other, tmp_path, tmp_path / "none.csv")] == [True] + [
        False
    ] * 4
    with pytest.raises(StoopError, match="column time holds what is no date"):
        read_figures(table)


def planned(
    logs: list[Path], vehicle: str | None = None, mapping: Path | None = None, flights: Path | None = None
) -> Reading:
    """Plan as for a new store."""
    return plan(logs, vehicle, mapping, flights, Path("none"))


def test_a_log_is_read_again_when_it_or_what_its_reading_depends_on_changed(tmp_path: Path) -> None:
    log, mapping, vehicle = (tmp_path / name for name in ("a.csv", "m.toml", "v.toml"))
    template = Path(__file__).parents[3] / "examples" / "crazyflie.toml"
    beside = tmp_path / "a.csv.toml"
    for path in (log, mapping, beside):
        path.write_text("1")
    vehicle.write_text(template.read_text())

    def key() -> str:
        (run,) = planned([log], str(vehicle), mapping).campaign.runs
        return run.key

    keys = {key()}
    assert key() in keys
    for path in (log, mapping, beside, vehicle):
        path.write_text(path.read_text() + "\n")
        assert key() not in keys, path.name
        keys.add(key())


def said(day: int, count: float, vehicle: str = "uuid", hours: float = 0.5) -> dict[str, Any]:
    """Return what a run of a log returns, with a header."""
    begin = 86400.0 * day
    header = {
        "vehicle": vehicle,
        "time": begin,
        "end": begin + 3600.0 * hours,
        "count": count,
        "density": 1.2,
    }
    figures = [["az.bias", 0.1, 0.01, "imu", "m/s2"]]
    return {"figures": figures, "absent": {"rotors": "none"}, "header": header}


def table_of(folder: Path, logs: dict[str, dict[str, Any]], flights: Path | None = None) -> LogFigures:
    """Gather as a command does, and keep its files."""
    paths = [folder / f"{name}.ulg" for name in logs]
    for path in paths:
        path.write_text(str(logs[path.stem].get("content", path.stem)))
    reading = plan(paths, None, None, flights, folder)
    found = gathered(reading, {run.key: logs[f] for f, run in reading.runs.items()}, folder)
    for name, text in found.files.items():
        (folder / name).write_text(text)
    (folder / LOGS).parent.mkdir(exist_ok=True)
    found.table.frame().to_parquet(folder / LOGS)
    return found


def test_vehicle_and_time_come_from_the_log_unless_the_table_of_flights_says_else(tmp_path: Path) -> None:
    flights = tmp_path / "flights.csv"
    flights.write_text("flight,vehicle,time,software\nb,Lisa,,\nc,,2020-01-01,1.4\n")
    found = table_of(tmp_path, {"a": said(20000, 1), "b": said(20001, 2), "c": said(20002, 3)}, flights).table
    assert found.flight == ("c", "a", "b")
    assert found.vehicle == ("uuid", "uuid", "Lisa")
    assert found.software == ("1.4", "", "")
    assert (found.parts[0], found.unit[0]) == ("imu", "m/s2")
    assert found.time[1:].tolist() == [86400.0 * 20000, 86400.0 * 20001]
    assert found.conditions["density"].tolist() == [1.2] * 3
    assert set(found.conditions) == {"density"}


def test_a_flight_of_which_nothing_is_known_or_that_contradicts_others_costs_its_own_rows(
    tmp_path: Path,
) -> None:
    unknown = {**said(20003, 4), "header": {}}
    first = table_of(tmp_path, {"a": said(20000, 1), "b": said(20001, 2), "unknown": unknown})
    assert first.table.flight == ("a", "b")
    reasons = {flight: reason for flight, group, reason in first.absent if group == "flight"}
    assert reasons == {
        "unknown": "the log does not tell its vehicle and time; give a table of the flights with --flights"
    }
    second = table_of(tmp_path, {"c": said(19000, 3), "d": said(20004, 4), "e": said(20004, 5)})
    assert second.table.flight == ("a", "b"), "c is dated before a, d and e fly at once"
    absent = pd.read_csv(tmp_path / ABSENT)
    assert set(absent[absent.group == "flight"].flight) == {"unknown", "c", "d", "e"}, "those of before stay"
    assert set(pd.read_csv(tmp_path / DATES).flight) == {"a", "b"}, "what is out is no evidence"
    flights = tmp_path / "flights.csv"
    flights.write_text("flight,vehicle,time\nc,,2024-10-07\ne,other,\n")
    third = table_of(tmp_path, {"c": said(19000, 3), "d": said(20004, 4), "e": said(20004, 5)}, flights)
    assert set(third.table.flight) == {"a", "b", "c", "d", "e"}


def test_a_flight_twice_in_the_table_of_flights_is_named(tmp_path: Path) -> None:
    flights = tmp_path / "flights.csv"
    flights.write_text("flight,vehicle\na,v\na,w\n")
    with pytest.raises(StoopError, match="flight a stands there twice; keep one row"):
        table_of(tmp_path, {"a": said(20000, 1)}, flights)
