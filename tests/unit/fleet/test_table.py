"""Tables of figures from elsewhere: CSV and Parquet, and what is wrong with one."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest

from stoop.errors import StoopError
from stoop.fleet.table import read_figures

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
    assert table.flight == ("f1", "f1", "f2")
    assert table.figure == ("drag", "thrust", "drag")
    assert table.software == ("", "", "1.1")
    assert table.time.tolist() == [60.0, 60.0, 1767312000.0]
    assert table.value.tolist() == [1.0, 3.0, 2.0]
    assert list(table.conditions) == ["density"]
    assert table.of("drag").std_error.tolist() == [0.3, 0.1]
    assert table.figures() == ("drag", "thrust")


def test_a_vehicle_called_na_is_one(tmp_path: Path) -> None:
    path = tmp_path / "figures.csv"
    ROWS.assign(vehicle="NA", software=["null", "", "1"]).to_csv(path, index=False)
    table = read_figures(path)
    assert table.vehicle == ("NA",) * 3
    assert table.software == ("1", "", "null")


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
    for name, said in (
        ("few.csv", "no column vehicle"),
        ("bad.parquet", ""),
        ("bad.csv", ""),
        ("none.csv", ""),
    ):
        with pytest.raises(StoopError, match=said) as error:
            read_figures(tmp_path / name)
        assert "\n" not in str(error.value)
