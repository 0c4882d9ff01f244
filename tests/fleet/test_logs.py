"""Which files are tables, and what makes a log be read again."""

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
from stoop.flight import Flight, from_columns
from stoop.vehicle.builtin import load_vehicle
from stoop_fleet.logs import ABSENT, DATES, LogFigures, Reading, _require_own, gathered, is_table, plan, read
from stoop_fleet.table import LOGS, read_figures

HEAD = "flight,vehicle,time,figure,value,std_error"


def test_a_table_is_told_by_its_head_and_judged_by_its_reader(tmp_path: Path) -> None:
    table, log, other = (tmp_path / name for name in ("figures.csv", "log.csv", "log.ulg"))
    table.write_text(f"\ufeff{HEAD}\nf,v,soon,drag,1,1\n", encoding="utf-8")
    log.write_text("time,p,q,r\n0,1,2,3\n")
    other.write_text(HEAD)
    assert is_table(table)
    assert not any(is_table(one) for one in (log, other, tmp_path, tmp_path / "none.csv"))
    with pytest.raises(StoopError, match="column time holds what is no date"):
        read_figures(table)


def planned(logs: list[Path], *options: Any) -> Reading:
    """Plan as for a new store: by a vehicle, a mapping, and a table of flights."""
    vehicle, mapping, flights = (*options, None, None, None)[:3]
    return plan(logs, vehicle, mapping, flights, Path("none"))


def said(day: int, count: float, vehicle: str = "uuid") -> dict[str, Any]:
    begin = 86400.0 * day
    header = {"vehicle": vehicle, "time": begin, "end": begin + 1800.0, "count": count, "density": 1.2}
    figures = [["az.bias", 0.1, 0.01, "imu", "m/s2"]]
    return {"figures": figures, "absent": {"rotors": "none"}, "header": header}


def table_of(folder: Path, logs: dict[str, dict[str, Any]], flights: Path | None = None) -> LogFigures:
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
    assert (found.flight, found.vehicle) == (("c", "a", "b"), ("uuid", "uuid", "Lisa"))
    assert (found.software, found.parts[0], found.unit[0]) == (("1.4", "", ""), "imu", "m/s2")
    assert found.time[1:].tolist() == [86400.0 * 20000, 86400.0 * 20001]
    assert {name: x.tolist() for name, x in found.conditions.items()} == {"density": [1.2] * 3}


def content(folder: Path) -> dict[str, bytes]:
    return {one: (folder / one).read_bytes() for one in (ABSENT, DATES, LOGS)}


def reasons(found: LogFigures) -> dict[str, str]:
    return {flight: reason for flight, group, reason in found.absent if group == "flight"}


def test_a_flight_that_tells_nothing_or_contradicts_others_costs_itself(tmp_path: Path) -> None:
    old = {"a": said(20000, 1), "b": said(20001, 2)}
    first = table_of(tmp_path, old | {"unknown": {**said(20003, 4), "header": {}}})
    assert first.table.flight == ("a", "b")
    assert list(reasons(first)) == ["unknown"]
    assert "give a table of the flights with --flights" in reasons(first)["unknown"]
    new = {"early": said(19000, 3), "twin": said(20001, 2), "next": said(20002, 3)}
    new |= {"d": said(20004, 4), "e": said(20004, 5)}
    out = {"early", "twin", "d", "e"}  # early is dated before a, twin flies while b does, d and e fly at once
    found = table_of(tmp_path, new)
    assert found.table.flight == ("a", "b", "next")
    assert set(reasons(found)) == out
    once, absent = content(tmp_path), pd.read_csv(tmp_path / ABSENT)
    assert set(absent[absent.group == "flight"].flight) == {"unknown", *out}, "those of before stay"
    assert set(pd.read_csv(tmp_path / DATES).flight) == {"a", "b", "next"}, "what is out is no evidence"
    table_of(tmp_path, new)
    assert content(tmp_path) == once, "the same command, the same bytes"
    assert set(reasons(table_of(tmp_path, old | new))) == out, "unchanged flights are earlier ones"
    later = table_of(tmp_path, {"later": said(19001, 0), "reset": said(20003, 1)})
    assert not reasons(later), "those that are out contradict nothing"
    flights = tmp_path / "flights.csv"
    flights.write_text("flight,vehicle,time\nearly,,2024-10-08\ntwin,other,\ne,other,\n")
    assert not reasons(table_of(tmp_path, new, flights))


def test_a_log_is_read_again_when_its_reading_would_change_and_not_for_its_place(tmp_path: Path) -> None:
    mapping, vehicle = tmp_path / "m.toml", tmp_path / "v.toml"
    mapping.write_text('[variables]\np = { column = "p", unit = "rad/s" }\n[files]\nmocap = "track.csv"\n')
    shutil.copy(Path(__file__).parents[2] / "examples" / "crazyflie.toml", vehicle)
    logs, flights = [tmp_path / "x" / "2026.01.01.csv", tmp_path / "y" / "b.csv"], tmp_path / "flights.csv"
    for log in logs:
        log.parent.mkdir()
        log.write_text("time,p\n0,1\n")

    def identity(log: Path, flights: Path | None = None, own: str | None = str(vehicle)) -> str:
        (run,) = planned([log], own, mapping, flights).campaign.runs
        return run.identity

    first = identity(logs[0])
    assert identity(logs[1]) == first
    flights.write_text("flight,mass\n2026.01.01,0.03\n")
    assert identity(logs[0], flights) != first
    assert identity(logs[0], flights, None) == identity(logs[0], None, None), "no vehicle, no mass"
    keys = {first}
    beside = (logs[0].with_name(name) for name in ("2026.01.01.csv.toml", "track.csv"))
    for path in (logs[0], mapping, vehicle, *beside):
        path.write_text(f"{path.read_text()}\n" if path.exists() else "1")
        keys.add(identity(logs[0]))
    assert len(keys) == 6


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
    masses = ((f"flight,mass\na,1.5\nb,{x}\n", "mass of flight b is no") for x in ("0", "-1", "inf", "heavy"))
    for text, said_of in (*masses, ("flight,vehicle\na,v\na,w\n", "flight a stands there twice; keep")):
        flights.write_text(text)
        with pytest.raises(StoopError, match=said_of):
            planned([], None, None, flights)


def test_a_folder_of_logs_is_no_log_but_one_of_topics_is(tmp_path: Path) -> None:
    for name in ("a.ulg", "parts.csv"):
        (tmp_path / name).write_text("1")
    with pytest.raises(StoopError, match=r"not of one log; name its logs, such as stoop fleet .*/\*\.ulg"):
        planned([tmp_path])
    (tmp_path / "topics").mkdir()
    (tmp_path / "topics" / "log_vehicle_attitude_0.csv").write_text("timestamp\n1")
    assert list(planned([tmp_path / "topics"]).runs) == ["topics"]


def test_a_flight_in_which_some_rotors_were_not_driven_is_of_another_vehicle() -> None:
    def flown(*channels: str) -> Flight:
        return from_columns("f", np.arange(0.0, 10.0, 0.1), {name: np.full(100, 0.5) for name in channels})

    hexa, plane = (load_vehicle(name) for name in ("hexa-x", "quadplane"))
    motors, rotors = ([r.channel for r in v.file.rotor.values()] for v in (hexa, plane))
    for channels, lost in ((motors[:4], f"input '{motors[4]}', '{motors[5]}'"), (["p", "q"], "")):
        with pytest.raises(StoopError, match=f"{lost} is not in this flight"):
            _require_own(hexa, flown(*channels))
    _require_own(hexa, flown(*motors, "voltage"))
    _require_own(plane, flown(*rotors))  # surfaces that were not recorded
    _require_own(load_vehicle("twin-boom"), flown("elevator"))
