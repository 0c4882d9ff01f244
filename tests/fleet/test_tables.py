"""Tables of parts and of figures from elsewhere, and what is wrong with one."""

from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from fleet.made_up import fleet

from stoop.errors import StoopError
from stoop_fleet.parts import Parts, read_parts
from stoop_fleet.table import read_figures

HEAD = "vehicle,part,serial,from,to\n"
TABLE = HEAD + ("A,rotor_1,P1,,2026-03-01\nA,rotor_1,P2,2026-03-01,\nB, rotor_1, P1, 2026-04-01T12:00, \n"
                "A,battery,1,2026-01-01T00:00+01:00,\n")  # fmt: skip


def parts_of(folder: Path, text: str) -> Parts:
    path = folder / "parts.csv"
    path.write_text(text, encoding="utf-8")
    return read_parts(path)


def test_a_part_moves_between_vehicles(tmp_path: Path) -> None:
    parts = parts_of(tmp_path, TABLE)
    assert parts.places() == ("battery", "rotor_1")
    for part, vehicle, date, serial in (
        ("rotor_1", "A", (2026, 2, 28, 23), "P1"), ("rotor_1", "A", (2026, 3, 1), "P2"), ("rotor_1", "B", (2026, 4, 1, 11), None),
        ("rotor_1", "B", (2026, 4, 1, 12), "P1"), ("rotor_1", "A", (2025, 1, 1), "P1"),
        ("battery", "A", (2025, 12, 31, 22), None), ("battery", "A", (2025, 12, 31, 23), "1"),
    ):  # fmt: skip
        moment = datetime(*date, tzinfo=UTC).timestamp()  # type: ignore[arg-type, misc]
        assert parts.serials(part, [vehicle], np.array([moment])) == [serial], date
    assert [(one.part, one.serial) for _, one in parts.exchanges("A")] == [("rotor_1", "P2")]
    assert parts.exchanges("B") == ()


def test_what_fits_no_flight_or_figure_is_named() -> None:
    table, parts = fleet()
    assert parts.unused(table) == ()
    wrong = [replace(parts.fittings[0], vehicle=f"w{i}") for i in range(7)]
    wrong.append(replace(parts.fittings[0], part="rotr_1"))
    lost = "7 vehicles without flights (w0, w1, w2, w3, w4)", "1 place without figures (rotr_1)"
    assert Parts((*parts.fittings, *wrong)).unused(table) == tuple(f"{one}; correct the name" for one in lost)
    nowhere = replace(table, parts=("",) * len(table.parts))
    assert parts.unused(nowhere) == (), "such a table names no places"


def test_contradictions_are_named(tmp_path: Path) -> None:
    for rows, said in (
        ("A,rotor_1,P1,,\nA,rotor_1,P2,2026-03-01,\n", "A has P1 and P2 as rotor_1 on 2026-03-01"),
        ("A,rotor_1,P1,,\nB,rotor_2,P1,2026-03-01,\n", "P1 is rotor_1 of A and rotor_2 of B on 2026-03-01"),
        ("A,rotor_1,P1,yesterday,\n", "line 2: 'yesterday' is no date; write 2026-05-31"),
        ("A,rotor_1,P1,2026-03-02,2026-03-01\n", "line 2: P1 leaves rotor_1 before it comes"),
        ("A,rotor_1,,,\n", "line 2 names no vehicle, part or serial"), ("A,rotor_1\n", "line 2 has no serial"),
    ):  # fmt: skip
        with pytest.raises(StoopError, match=said):
            parts_of(tmp_path, HEAD + rows)
    two = parts_of(tmp_path, HEAD + "A,battery,1,,\nA,rotor_1,1,,\nB,rotor_1,2,,\n")
    assert len(two.fittings) == 3, "one serial of different kinds are two parts"
    for content in (b"a,b\n1,2\n", b"\xff\xfe\x00"):
        (tmp_path / "parts.csv").write_bytes(content)
        with pytest.raises(StoopError, match=r"^[^\n]*parts.csv[^\n]*$"):
            read_parts(tmp_path / "parts.csv")


ROWS = pd.DataFrame({
    "flight": ["f2", "f1", "f1"], "vehicle": ["A", "A", "A"], "time": ["2026-01-02", "1970-01-01T00:01", "1970-01-01T00:01"],
    "figure": ["drag", "thrust", "drag"], "value": [2.0, 3, 1], "std_error": [0.1, 0.2, 0.3],
    "software": ["1.1", None, None], "density": [1.1, 1.2, 1.2], "pilot": ["x", "y", "y"],
})  # fmt: skip


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_rows_come_in_order(tmp_path: Path, ending: str) -> None:
    path = tmp_path / f"figures.{ending}"
    ROWS.to_csv(path, index=False) if ending == "csv" else ROWS.to_parquet(path)
    table = read_figures(path)
    rows = [*zip(table.flight, table.figure, table.software, table.time, table.value, strict=True)]
    first = [("f1", "drag", "", 60.0, 1.0), ("f1", "thrust", "", 60.0, 3.0)]
    assert rows == [*first, ("f2", "drag", "1.1", 1767312000.0, 2.0)]
    assert (list(table.conditions), table.figures()) == (["density"], ("drag", "thrust"))
    assert table.of("drag").std_error.tolist() == [0.3, 0.1]
    if ending == "csv":
        ROWS.assign(vehicle="NA", software=["null", "", "1"]).to_csv(path, index=False)
        table = read_figures(path)
        assert (table.vehicle, table.software) == (("NA",) * 3, ("1", "", "null")), "no blanks"


def test_what_is_wrong_is_named(tmp_path: Path) -> None:
    path = tmp_path / "figures.csv"
    for change, said in (
        ({"value": ["a", "b", "c"]}, "column value holds what is no number"),
        ({"std_error": [0.1, 0.0, 0.2]}, "1 rows, first that of flight f1, lack a value"),
        ({"time": ["soon", "late", "now"]}, "column time holds what is no date"),
        ({"figure": ["drag", "drag", "drag"]}, "drag of flight f1 stands there twice"),
        ({"vehicle": ["", "A", "A"]}, "1 rows, first that of flight f2, lack "),
    ):
        ROWS.assign(**change).to_csv(path, index=False)
        with pytest.raises(StoopError, match=said):
            read_figures(path)
    ROWS.drop(columns="vehicle").to_csv(tmp_path / "few.csv", index=False)
    (tmp_path / "bad.parquet").write_bytes(b"PAR1PAR1")
    (tmp_path / "bad.csv").write_bytes(b"\xff\x00\n" * 9)
    for name in ("few.csv", "bad.parquet", "bad.csv", "none.csv"):
        with pytest.raises(StoopError, match=rf"^[^\n]*{name}[^\n]*$"):
            read_figures(tmp_path / name)
