"""Tables of parts: what stood where, when, and what contradicts itself."""

from __future__ import annotations

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pytest
from unit.fleet.made_up import fleet

from stoop.errors import StoopError
from stoop.fleet.parts import Parts, read_parts

HEAD = "vehicle,part,serial,from,to\n"
TABLE = HEAD + (
    "A,rotor_1,P1,,2026-03-01\nA,rotor_1,P2,2026-03-01,\nB, rotor_1, P1, 2026-04-01T12:00, \n"
    "A,battery,1,2026-01-01T00:00+01:00,\n"
)


def read(folder: Path, text: str) -> Parts:
    path = folder / "parts.csv"
    path.write_text(text, encoding="utf-8")
    return read_parts(path)


def day(*date: int) -> float:
    return datetime(*date, tzinfo=UTC).timestamp()  # type: ignore[arg-type, misc]


def test_a_part_moves_between_vehicles(tmp_path: Path) -> None:
    parts = read(tmp_path, TABLE)
    assert parts.places() == ("battery", "rotor_1")
    times = np.array(
        [day(2026, 2, 28, 23), day(2026, 3, 1), day(2026, 4, 1, 11), day(2026, 4, 1, 12), day(2025, 1, 1)]
    )
    assert parts.serials("rotor_1", ["A", "A", "B", "B", "A"], times) == ["P1", "P2", None, "P1", "P1"]
    assert parts.serials("battery", ["A", "A"], np.array([day(2025, 12, 31, 22), day(2025, 12, 31, 23)])) == [
        None,
        "1",
    ]
    assert [(one.part, one.serial) for _, one in parts.exchanges("A")] == [("rotor_1", "P2")]
    assert parts.exchanges("B") == ()


def test_what_fits_no_flight_or_figure_is_named() -> None:
    table, parts = fleet()
    assert parts.unused(table) == ()
    wrong = [replace(parts.fittings[0], vehicle=f"w{i}") for i in range(7)]
    wrong += [replace(parts.fittings[0], part="rotr_1")]
    assert Parts((*parts.fittings, *wrong)).unused(table) == (
        "7 vehicles without flights (w0, w1, w2, w3, w4); correct the name",
        "1 place without figures (rotr_1); correct the name",
    )
    nowhere = replace(table, parts=("",) * len(table.parts))
    assert parts.unused(nowhere) == (), "such a table names no places"


def test_contradictions_are_named(tmp_path: Path) -> None:
    for rows, said in (
        ("A,rotor_1,P1,,\nA,rotor_1,P2,2026-03-01,\n", "A has P1 and P2 as rotor_1 on 2026-03-01"),
        ("A,rotor_1,P1,,\nB,rotor_2,P1,2026-03-01,\n", "P1 is rotor_1 of A and rotor_2 of B on 2026-03-01"),
        ("A,rotor_1,P1,yesterday,\n", "line 2: 'yesterday' is no date; write 2026-05-31"),
        ("A,rotor_1,P1,2026-03-02,2026-03-01\n", "line 2: P1 leaves rotor_1 before it comes"),
        ("A,rotor_1,,,\n", "line 2 names no vehicle, part or serial"),
        ("A,rotor_1\n", "line 2 has no serial"),
    ):
        with pytest.raises(StoopError) as error:
            read(tmp_path, HEAD + rows)
        assert said in str(error.value)
        assert "\n" not in str(error.value)
    two = read(tmp_path, HEAD + "A,battery,1,,\nA,rotor_1,1,,\nB,rotor_1,2,,\n")
    assert len(two.fittings) == 3, "one serial of different kinds are two parts"
    for content in (b"a,b\n1,2\n", b"\xff\xfe\x00"):
        (tmp_path / "parts.csv").write_bytes(content)
        with pytest.raises(StoopError) as error:
            read_parts(tmp_path / "parts.csv")
        assert "\n" not in str(error.value)
