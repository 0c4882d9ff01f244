"""Which files are tables, and what makes a log be read again."""

from __future__ import annotations

import json
import shutil
import uuid
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stoop.errors import StoopError
from stoop.fleet.logs import ABSENT, DATES, LogFigures, Reading, _require_own, gathered, is_table, plan, read
from stoop.fleet.table import LOGS, read_figures
from stoop.flight import Flight, from_columns
from stoop.vehicle.builtin import resolve_vehicle

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
    folder.mkdir(exist_ok=True)
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


def test_a_log_is_known_by_its_content_wherever_it_lies(tmp_path: Path) -> None:
    mapping = tmp_path / "m.toml"
    mapping.write_text('[variables]\np = { column = "p", unit = "rad/s" }\n[files]\nmocap = "track.csv"\n')
    places = [tmp_path / one for one in ("x", "y")]
    for place, name in zip(places, ("2026.01.01.csv", "b.csv"), strict=True):
        place.mkdir()
        (place / name).write_text("time,p\n0,1\n")
        shutil.copy(Path(__file__).parents[3] / "examples" / "crazyflie.toml", place / f"{name}.v.toml")

    def key(place: Path, flights: Path | None = None, vehicle: bool = True) -> str:
        (log,) = place.glob("[2b]*.csv")
        own = str(next(place.glob("*.v.toml"))) if vehicle else None
        (run,) = planned([log], own, mapping, flights).campaign.runs
        return run.identity

    first = key(places[0])
    assert key(places[1]) == first
    (places[1] / "track.csv").write_text("1")
    assert key(places[1]) != first, "a further file that the mapping names"
    flights = tmp_path / "flights.csv"
    flights.write_text("flight,mass\n2026.01.01,0.03\n")
    assert key(places[0], flights) != first
    assert key(places[0], flights, False) == key(places[0], None, False), "without a vehicle no mass is used"


@pytest.mark.parametrize("name", ["broken.csv", "broken.ulg"])
def test_what_is_said_of_a_broken_log_does_not_depend_on_where_it_lies(tmp_path: Path, name: str) -> None:
    results, paths = [], [tmp_path / name, tmp_path / "sub" / f"renamed-{name}"]
    paths[1].parent.mkdir()
    for path in paths:
        path.write_bytes(b"ULog\x01\x12\x35" if name == "broken.ulg" else b"time,p\n0,1\n")
        (run,) = planned([path]).campaign.runs
        results.append(read(json.loads(run.text), [None]))
    assert results[0] == results[1]
    reading = planned(paths[:1])
    (run,) = reading.campaign.runs
    with pytest.raises(StoopError, match="no log gave a figure") as error:
        gathered(reading, {run.key: results[0][0]}, tmp_path)
    assert str(tmp_path) not in str(error.value)
    assert ("save the lines below as LOG.toml beside it" in str(error.value)) == name.endswith(".csv")


def content(folder: Path) -> dict[str, bytes]:
    return {one: (folder / one).read_bytes() for one in (ABSENT, DATES, LOGS)}


def reasons(found: LogFigures) -> dict[str, str]:
    return {flight: reason for flight, group, reason in found.absent if group == "flight"}


@pytest.mark.parametrize("by_table", [False, True])
def test_a_copy_of_an_earlier_log_costs_its_own_row(tmp_path: Path, by_table: bool) -> None:
    flights = None
    if by_table:
        flights = tmp_path / "flights.csv"
        flights.write_text("flight,vehicle,time\na,v,2026-01-01\nb,v,2026-01-02\ncopy,v,2026-01-03\n")
    first = {"a": said(20000, 1), "b": said(20001, 2)}
    table_of(tmp_path, first, flights)
    before = (tmp_path / LOGS).read_bytes()
    copy = {"copy": {**said(20000, 1), "content": "a"}}
    for logs in (copy, {**first, **copy}, copy):
        found = table_of(tmp_path, logs, flights)
        assert found.table.flight == ("a", "b")
        assert reasons(found) == {"copy": "is the same log as flight a; leave it out"}
        assert (tmp_path / LOGS).read_bytes() == before
    exchanged = {"a": {**said(20001, 2), "content": "b"}, "b": {**said(20000, 1), "content": "a"}}
    assert not reasons(table_of(tmp_path, exchanged, flights)), "names that were exchanged"
    with pytest.raises(StoopError, match=r"copy.ulg: is the same log as .*a.ulg; leave one out"):
        table_of(tmp_path / "new", {**copy, "a": said(20000, 1)}, flights)


def test_a_flight_that_contradicts_earlier_ones_costs_itself_and_is_forgotten(tmp_path: Path) -> None:
    table_of(tmp_path, {"a": said(20000, 1), "b": said(20001, 2)})
    new = {"early": said(19000, 3), "twin": said(20001, 2), "next": said(20002, 4)}
    found = table_of(tmp_path, new)
    assert found.table.flight == ("a", "b", "next")
    assert set(reasons(found)) == {"early", "twin"}
    once = content(tmp_path)
    table_of(tmp_path, new)
    assert content(tmp_path) == once, "the same command, the same bytes"
    every = table_of(tmp_path, {"a": said(20000, 1), "b": said(20001, 2), **new})
    assert set(reasons(every)) == {"early", "twin"}, "flights that have not changed are earlier ones"
    later = table_of(tmp_path, {"later": said(19001, 0), "reset": said(20003, 1)})
    assert not reasons(later), "those that are out contradict nothing"


@given(st.permutations(range(5)))
@settings(max_examples=5, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
def test_the_order_of_the_logs_of_a_command_changes_no_byte(tmp_path: Path, order: list[int]) -> None:
    own = [said(20000, 1), said(20000, 1), said(20002, 1), said(19000, 9), said(20005, 2)]
    own[2]["header"].pop("density")
    folders = [tmp_path / uuid.uuid4().hex for _ in range(2)]
    for folder, places in zip(folders, (order, sorted(order)), strict=True):
        folder.mkdir()
        table_of(folder, {f"f{i}": own[i] for i in places})
    assert content(folders[0]) == content(folders[1])


def test_the_mass_of_a_flight_is_a_number_above_zero_and_no_condition(tmp_path: Path) -> None:
    flights = tmp_path / "flights.csv"
    flights.write_text("flight,mass,payload\na,1.5,1\nb,,2\n")
    found = table_of(tmp_path, {"a": said(20000, 1), "b": said(20001, 2)}, flights).table
    assert set(found.conditions) == {"density", "payload"}
    flights.write_text("flight,vehicle\na,v\na,w\n")
    with pytest.raises(StoopError, match="flight a stands there twice; keep one row"):
        planned([], None, None, flights)
    for wrong in ("0", "-1", "inf", "heavy"):
        flights.write_text(f"flight,mass\na,1.5\nb,{wrong}\n")
        with pytest.raises(StoopError, match="the mass of flight b is no number above zero; write it in kg"):
            planned([], None, None, flights)


def test_a_folder_of_logs_is_no_log_but_one_of_topics_is(tmp_path: Path) -> None:
    for name in ("a.ulg", "parts.csv"):
        (tmp_path / name).write_text("1")
    with pytest.raises(StoopError, match=r"not of one log; name its logs, such as stoop fleet .*/\*\.ulg"):
        planned([tmp_path])
    topics = tmp_path / "topics"
    topics.mkdir()
    (topics / "log_vehicle_attitude_0.csv").write_text("timestamp\n1")
    assert list(planned([topics]).runs) == ["topics"]


def test_a_flight_in_which_some_rotors_were_not_driven_is_of_another_vehicle() -> None:
    def flown(*channels: str) -> Flight:
        return from_columns("f", np.arange(0.0, 10.0, 0.1), {name: np.full(100, 0.5) for name in channels})

    hexa, plane = (resolve_vehicle(name) for name in ("hexa-x", "quadplane"))
    motors, rotors = ([r.channel for r in v.file.rotor.values()] for v in (hexa, plane))
    for channels, said in (
        (motors[:4], f"input '{motors[4]}', '{motors[5]}' is not in this flight"),
        (["p", "q"], "is not in this flight"),
    ):
        with pytest.raises(StoopError, match=said):
            _require_own(hexa, flown(*channels))
    _require_own(hexa, flown(*motors, "voltage"))
    _require_own(plane, flown(*rotors))  # surfaces that were not recorded
    _require_own(resolve_vehicle("twin-boom"), flown("elevator"))
