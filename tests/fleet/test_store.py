"""The folder of a fleet and the verb: alarms are told once and withdrawn; an error loses nothing."""

import json
import re
from datetime import UTC, datetime
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from fleet.made_up import EXCHANGED, changed, fleet

import stoop
from stoop.base.files import only_writer
from stoop.cli.main import main
from stoop.errors import StoopError
from stoop_fleet.analysis import FleetAnalysis
from stoop_fleet.logs import LogFigures
from stoop_fleet.parts import Parts
from stoop_fleet.store import STATE, Fleet, ToldAlarm, updated_fleet
from stoop_fleet.table import FigureTable, read_figures

WHOLE, PARTS = fleet()
FEW = [v in ("v1", "v2", "v3") and int(f[3:]) < 28 for v, f in zip(WHOLE.vehicle, WHOLE.flight, strict=True)]
SOUND = WHOLE.rows(np.array(FEW))
WORN = changed(SOUND, "thrust", EXCHANGED, -0.15)
STEP = ("v3", "thrust", "step", f"v3-{EXCHANGED}")


def write(folder: Path, table: FigureTable, parts: Parts = PARTS, name: str = "figures") -> tuple[Path, Path]:
    def moment(seconds: float) -> str:
        return datetime.fromtimestamp(seconds, UTC).isoformat() if np.isfinite(seconds) else ""

    table.frame().to_csv(folder / f"{name}.csv", index=False)
    lines = [",".join((p.vehicle, p.part, p.serial, moment(p.begin), moment(p.end))) for p in parts.fittings]
    (folder / "parts.csv").write_text("\n".join(["vehicle,part,serial,from,to", *lines]))
    return folder / f"{name}.csv", folder / "parts.csv"


def update_fleet(*words: Any, **options: Any) -> tuple[Fleet, tuple[ToldAlarm, ...], FleetAnalysis]:
    with updated_fleet(*words, **options) as update:
        pass
    return update.fleet, update.fresh, update.analysis


def steps(one: Fleet) -> list[tuple[str, str, str, str]]:
    return [(a.vehicle, a.figure, a.kind, a.began) for a in one.standing()]


def content(folder: Path) -> dict[str, bytes]:
    return {str(p.relative_to(folder)): p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_an_alarm_is_told_once_and_withdrawn_when_nothing_shows_it(tmp_path: Path) -> None:
    (figures, parts), store = write(tmp_path, WORN), tmp_path / "store"
    first, fresh, _ = update_fleet(store, [figures], parts, 0.1)
    assert (steps(first), [a.causes[0].what for a in fresh]) == ([STEP], ["rotor_1: v3b for v3a"])
    before = content(store)
    again, fresh, _ = update_fleet(store, [figures])
    assert (steps(again), fresh) == ([STEP], ())
    assert content(store) == before, "the same tables, the same bytes"
    opened = stoop.open_fleet(store)
    assert (opened.alarms, opened.parts.fittings) == (again.alarms, first.parts.fittings)
    assert opened.analysis().threshold == opened.threshold
    write(tmp_path, SOUND)
    without, fresh, _ = update_fleet(store, [figures], alarms_a_year=0.05)
    assert (steps(without), fresh) == ([], ())
    assert [(a.figure, a.withdrawn) for a in without.alarms] == [("thrust", True)]
    write(tmp_path, WORN)
    back, fresh, _ = update_fleet(store, [figures])
    assert (back.alarms_a_year, steps(back)) == (0.05, [STEP])
    assert [a.began for a in fresh] == [STEP[3]], "what was withdrawn is told anew"


def test_an_error_changes_nothing(tmp_path: Path) -> None:
    (figures, parts), store = write(tmp_path, SOUND), tmp_path / "store"
    update_fleet(store, [figures], parts)
    before = content(store)
    same, _ = write(tmp_path, SOUND, name="again")
    (tmp_path / "sub").mkdir()
    twin, _ = write(tmp_path / "sub", SOUND)
    (tmp_path / "none.csv").write_text(figures.read_text().splitlines()[0])
    for sources, said in (
        ([same], "drag of flight v"), ([figures, twin], "two tables have one name"), ([store], "cannot be read"),
        ([tmp_path / "none.csv"], "none.csv: holds no row"), ([tmp_path / "absent.csv"], "cannot be read"),
    ):  # fmt: skip
        with pytest.raises(StoopError, match=said):
            update_fleet(store, sources)
        assert content(store) == before


def test_logs_are_gathered_while_no_other_command_writes(tmp_path: Path) -> None:
    (figures, _), store = write(tmp_path, SOUND), tmp_path / "store"

    def gather() -> LogFigures:
        with pytest.raises(StoopError, match="another command is writing there"), only_writer(store):
            pass
        return LogFigures(read_figures(figures), (), {"absent.csv": "flight\n"})

    found, *_ = update_fleet(store, [], logs=gather)
    assert found.table.flight == read_figures(figures).flight
    assert (store / "absent.csv").exists()


def test_an_alarm_that_could_not_be_kept_is_told_again(tmp_path: Path, capsys: Any, monkeypatch: Any) -> None:
    figures, parts = write(tmp_path, WORN)
    command = ["fleet", str(figures), "--parts", str(parts), "-o", str(tmp_path / "store")]

    with monkeypatch.context() as patched:
        patched.setattr("stoop_fleet.store.write_files", Mock(side_effect=StoopError("the disk is full")))
        assert main(command) == 2
    assert "v3 thrust: step" in capsys.readouterr().out
    assert not list((tmp_path / "store").iterdir())
    assert main(command) == 3
    assert "v3 thrust: step" in capsys.readouterr().out


def test_a_store_that_is_not_fit(tmp_path: Path) -> None:
    with pytest.raises(StoopError, match="holds no fleet; begin one"):
        stoop.open_fleet(tmp_path)
    whole = '{"schema": "stoop-fleet/1", "alarms_a_year": 1, "threshold": 9, "alarms": [{"x": 1}]}'
    newer = '{"schema": "stoop-fleet/9"}', "of schema stoop-fleet/9, not stoop-fleet/1"
    few = '{"schema": "stoop-fleet/1"}'
    for text, said in (newer, *((text, "damaged") for text in ("{", "[]", few, whole))):
        (tmp_path / STATE).write_text(text)
        with pytest.raises(StoopError, match=said):
            stoop.open_fleet(tmp_path)


def test_a_nightly_job(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    figures, parts = write(tmp_path, WORN)
    show = ["fleet", str(tmp_path / "store")]
    command = ["fleet", str(figures), "--output", show[1]]
    assert main([*command, "--parts", str(parts), "--alarms-a-year", "0.1"]) == 3
    head, told, unused, page = capsys.readouterr().out.splitlines()
    assert unused.startswith("parts: 5 vehicles without flights (v0, v4, v5, v6, v7)")
    assert head == "3 vehicles, 84 flights, 2 figures; 0.1 false alarms a year"
    assert page == f"page: {tmp_path / 'store' / 'fleet.html'}"
    assert re.search(r"v3 thrust: step of -0\.1.*since flight v3-20 \(1970-.*rotor_1: v3b for v3a \(9", told)
    for words, code, said in (
        (command, 0, "no new alarm; 1 earlier one"), (show, 0, told), ([*show, "--since", "1970-01-01"], 3, told),
        ([*show, "--since", "2026-01-01"], 0, ""),
    ):  # fmt: skip
        assert main(words) == code
        assert said in capsys.readouterr().out
    assert main([*show, "--json"]) == 0
    text = capsys.readouterr().out
    alarm, *_ = json.loads(text[text.index("{") :])["alarms"]
    assert (alarm["vehicle"], alarm["began"], alarm["new"]) == ("v3", "v3-20", False)
    for wrong, said in (
        ([*show, "--since", "soon"], "is no date"), ([*show, "--alarms-a-year", "2"], "name its folder with -o"),
        (["fleet", str(tmp_path)], "holds no fleet"), ([*command, "--flights", str(parts)], "are for logs, and no log was named"),
    ):  # fmt: skip
        assert main(wrong) == 2
        assert said in capsys.readouterr().err
