"""Which files are tables, and what makes a log be read again."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop.errors import StoopError
from stoop.fleet.logs import is_table, plan
from stoop.fleet.table import read_figures

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


def test_a_log_is_read_again_when_it_or_what_its_reading_depends_on_changed(tmp_path: Path) -> None:
    log, mapping, vehicle = (tmp_path / name for name in ("a.csv", "m.toml", "v.toml"))
    template = Path(__file__).parents[3] / "examples" / "crazyflie.toml"
    beside = tmp_path / "a.csv.toml"
    for path in (log, mapping, beside):
        path.write_text("1")
    vehicle.write_text(template.read_text())

    def key() -> str:
        (run,) = plan([log], str(vehicle), mapping).runs
        return run.key

    keys = {key()}
    assert key() in keys
    for path in (log, mapping, beside, vehicle):
        path.write_text(path.read_text() + "\n")
        assert key() not in keys, path.name
        keys.add(key())
