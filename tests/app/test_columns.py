"""The columns of a log: rows and edits of a mapping, corrections, files that an editor changes, and the table in a browser."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from app.conftest import Tab
from stoop.app import columns
from stoop.app.columns import edited, rows_of, units_of
from stoop.app.folder import BEFORE, MAPPING, ChangedError, Project, version
from stoop.base.units import FACTORS, KINDS
from stoop.base.variables import VARIABLES
from stoop.errors import LogError, StoopError
from stoop.flight.log_columns import columns_of, read_unmapped
from stoop.flight.mapping_draft import draft
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import resolve_vehicle

OVERFLOW = "document.documentElement.scrollHeight - innerHeight"
MANEUVER = """
duration = 24.0
rate = 50.0
[[input]]
control = "elevator"
shape = "3-2-1-1"
start = 2.0
step = 0.4
amplitude = 0.08
[[input]]
control = "aileron"
shape = "3-2-1-1"
start = 12.0
step = 0.4
amplitude = 0.08
"""
#: column -> variable, and the unit and sign in which it is recorded
RECORDED = {
    "gyro_x": ("p", "deg/s", 1), "gyro_y": ("q", "deg/s", 1), "gyro_z": ("r", "deg/s", 1), "acc_x": ("ax", "m/s2", 1),
    "acc_y": ("ay", "m/s2", 1), "acc_z": ("az", "m/s2", 1), "roll_deg": ("phi", "deg", 1), "pitch_deg": ("theta", "deg", 1),
    "yaw_deg": ("psi", "deg", 1), "tas_kt": ("V", "kt", 1), "aoa_deg": ("alpha", "deg", 1), "h_ft": ("altitude", "ft", 1),
    "stick": ("elevator", "deg", 1), "wheel": ("aileron", "deg", 1),
}  # fmt: skip


@pytest.fixture(scope="session")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of an airplane as a table, two columns of which have names that nobody knows."""
    flight = simulate_flight(resolve_vehicle("twin-boom"), parse_maneuver(MANEUVER, "m"), 0, name="m")
    data = {name: flight.data[name].values for name in flight.data} | {"t": flight.data["time"].values}
    w, x, y, z = (data[f"q{i}"] for i in range(4))
    data["phi"] = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    data["theta"] = np.arcsin(2 * (w * y - z * x))
    data["psi"] = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    log = tmp_path_factory.mktemp("table") / "mine.csv"
    kept = {"time_s": data["t"]} | {c: s * data[v] / FACTORS[u] for c, (v, u, s) in RECORDED.items()}
    np.savetxt(
        log,
        np.column_stack([*kept.values()]),
        delimiter=",",
        header=",".join(kept),
        comments="",
        fmt="%.7g",
    )
    return log


@pytest.fixture
def project(tmp_path: Path, table: Path) -> Project:
    """Return a project with that log, whose columns are listed."""
    made = Project(tmp_path / "project")
    made.open_log(table)
    settled(made)
    return made


def settled(project: Project) -> None:
    """Do what the page does until nothing more happens."""
    while True:
        running = any(s.running for kind in ("map", "info", "corrections") for s in project.steps(kind))
        before = project.signature
        project.tend()
        if not running and project.signature == before:
            return
        time.sleep(0.02)


def row_of(rows: list[columns.Row], column: str) -> columns.Row:
    return next(row for row in rows if row.column == column)


def test_every_column_has_a_row_with_what_the_draft_made_of_it(table: Path) -> None:
    rows = rows_of(draft(table).text, [*columns_of(read_unmapped(table))])
    assert {row.column for row in rows} == {"time_s", *RECORDED}
    for column, (variable, unit, _) in RECORDED.items():
        row = row_of(rows, column)
        if column in ("stick", "wheel"):
            assert (row.variable, row.doubt) == ("", columns.UNKNOWN)
        else:
            assert (row.variable, row.unit) == (variable, unit), column
    assert row_of(rows, "time_s").doubt == columns.CLOCK
    assert row_of(rows, "h_ft").values.count(",") == 2


def test_edits_are_written_into_their_lines_and_the_rest_stays(table: Path) -> None:
    text, listed = draft(table).text, [*columns_of(read_unmapped(table))]
    rows = rows_of(text, listed)
    stick, p, h = (row_of(rows, name) for name in ("stick", "gyro_x", "h_ft"))
    with pytest.raises(
        StoopError, match="stick: choose the unit in which it was recorded, one of rad, mrad, deg"
    ):
        edited(text, [(stick, {"variable": "elevator"})])
    with pytest.raises(StoopError, match="p is read from two columns"):
        edited(text, [(stick, {"variable": "p", "unit": "deg/s"})])
    with pytest.raises(LogError, match="is an angle"):
        edited(text, [(stick, {"variable": "elevator", "unit": "kt"})])
    with pytest.raises(LogError, match="it names no variable"):
        edited(text, [(row, {"variable": ""}) for row in rows if row.line])
    changes = [
        (stick, {"variable": "elevator", "unit": "deg", "scale": -2.0}),
        (p, {"scale": -1.0}),
        (h, {"variable": ""}),
    ]
    changed = edited(text, changes)
    after = rows_of(changed, listed)
    elevator = row_of(after, "stick")
    assert (elevator.variable, elevator.unit, elevator.scale) == ("elevator", "deg", -2.0)
    assert (row_of(after, "gyro_x").scale, row_of(after, "h_ft").variable) == (-1.0, "")
    kept = [line for line in text.splitlines() if not line.startswith(("p =", "altitude ="))]
    assert [line for line in changed.splitlines() if line in kept] == kept
    swapped = edited(text, [(p, {"variable": "q"}), (row_of(rows, "gyro_y"), {"variable": "p"})])
    assert row_of(rows_of(swapped, listed), "gyro_x").variable == "q"


def test_each_variable_offers_units_of_its_kind() -> None:
    for name, units in units_of().items():
        kind = "a time" if name.startswith("pwm_") else KINDS[VARIABLES[name].unit]
        assert {KINDS[unit] for unit in units} == {kind}, name
        assert columns.meaning(name).startswith(f"{name}: ")


def test_corrections_are_taken_once_and_a_mapping_that_an_editor_changed_is_read(project: Project) -> None:
    assert project.listing is not None
    text = project.listing.text(MAPPING)
    wrong = edited(text, [(row_of(rows_of(text, listed_columns(project)), "gyro_y"), {"scale": -1.0})])
    project.save_mapping(wrong, version(text))
    settled(project)
    assert project.info["channels"]
    project.correct_mapping()
    settled(project)
    corrected = project.mapping
    assert row_of(rows_of(corrected, listed_columns(project)), "gyro_y").scale == 1.0
    assert project.corrections is not None
    assert project.corrections.text(BEFORE) == wrong
    assert project.flight is not None
    assert project.flight.text(MAPPING) == corrected, "the log is read by it"
    project.take_mapping(wrong)  # undone
    settled(project)
    assert project.mapping == wrong, "what was undone is not done again"
    # In an editor.
    place = project.root / MAPPING
    place.write_text(corrected, "utf-8")
    readings = len(project.steps("info"))
    settled(project)
    assert len(project.steps("info")) == readings + 1
    assert project.flight.text(MAPPING) == corrected
    with pytest.raises(ChangedError, match="Your edits are kept"):
        project.save_mapping(text, version(wrong))
    place.write_text("no mapping", "utf-8")
    settled(project)
    assert project.reading is not None
    assert project.reading.state == "failed"
    assert project.lacking == "The log is not read yet"


def listed_columns(project: Project) -> list[dict[str, object]]:
    return [*columns_of(read_unmapped(project.log_file))]


def cell(tab: Tab, column: str, field: str):
    row = tab.page.locator(".tabulator-row", has=tab.page.get_by_text(column, exact=True)).first
    return row.locator(f'.tabulator-cell[tabulator-field="{field}"]')


def choose(tab: Tab, column: str, variable: str, unit: str) -> None:
    cell(tab, column, "variable").click()
    cell(tab, column, "variable").locator("input").fill(variable)
    tab.page.locator(".tabulator-edit-list-item").get_by_text(f"{variable}: ").first.click()
    cell(tab, column, "variable").get_by_text(variable, exact=True).wait_for()
    cell(tab, column, "unit").click()
    tab.page.locator(".tabulator-edit-list-item").get_by_text(unit, exact=True).first.click()


def test_unknown_columns_are_named_in_the_table_and_corrections_undone(app, tab, table: Path) -> None:
    running = app(str(table))
    page = tab(running)
    page.click("Next: the columns")
    page.wait("2 without a variable")
    choose(page, "stick", "elevator", "deg")
    choose(page, "wheel", "aileron", "deg")
    scale = cell(page, "gyro_y", "scale")
    scale.click()
    scale.locator("input").fill("-1")
    scale.locator("input").press("Enter")
    page.wait("5 edits not saved")
    page.picture("columns")
    page.click("Use these columns")
    page.wait("the sign of q contradicts")
    page.page.locator("iframe").wait_for()
    assert page.page.evaluate(OVERFLOW) == 0, "the frame scrolls alone"
    assert 'elevator = {column = "stick", unit = "deg"}' in (running.folder / MAPPING).read_text("utf-8")
    page.click("7 Use")
    page.click("2 Columns")  # from any step
    page.click("Apply corrections")
    page.wait("corrections applied: 1, each confirmed by the log")
    page.click("Undo the corrections")
    page.page.get_by_text("corrections applied").first.wait_for(state="hidden")
    # An editor.
    before = (running.folder / MAPPING).read_text("utf-8")
    (running.folder / MAPPING).write_text(
        before.replace('"wheel", unit = "deg"', '"wheel", unit = "rad"'), "utf-8"
    )
    cell(page, "wheel", "unit").get_by_text("rad", exact=True).wait_for()
    page.picture("columns_again")
