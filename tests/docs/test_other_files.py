"""The references of mapping files, variables, units and maneuver files are the code's."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from pydantic import BaseModel

from docs.pages import DOCS, blocks, commands, run_python, table, tables
from stoop.base.units import FACTORS
from stoop.base.variables import NUMBERED
from stoop.flight import OUTPUTS, VARIABLES, load, save
from stoop.flight.alignment import QUANTITIES
from stoop.flight.conversion import MIXERS
from stoop.flight.mapping import READY, GroupTable, SourceTable, TimeUnit, VariableTable, read_flight_mapping
from stoop.simulation import maneuver
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle.builtin import resolve_vehicle

INPUTS = [
    maneuver.Steps,
    maneuver.Levels,
    maneuver.Pulse,
    maneuver.Multisine,
    maneuver.Harmonics,
    maneuver.Sweep,
]
FLIGHTS, MANEUVERS = DOCS / "flight-files.md", DOCS / "maneuver-file.md"


def test_variables() -> None:
    """Variables that are numbered share one row, which tells how many there are."""
    numbered = {row[0].format(n=1): (size, row[0]) for size, row in NUMBERED}
    more = {name.format(n=n) for size, name in numbered.values() for n in range(2, size + 1)}
    code = []
    for v in VARIABLES.values():
        size, name = numbered.get(v.name, (0, ""))
        span = f"`{v.name}` to `{name.format(n=size)}`"
        first = (span, v.unit, v.frame, v.sign, f"{v.meaning} ...") if size else None
        code += [first or (v.name, v.unit, v.frame, v.sign, v.meaning)] if v.name not in more else []
    assert list(table(FLIGHTS, "Variables", "variable").rows) == code


def test_units_of_mappings() -> None:
    text = FLIGHTS.read_text(encoding="utf-8")
    line = next(line for line in text.splitlines() if line.startswith("Units: "))
    assert line.removeprefix("Units: ").rstrip(".").replace("`", "").split(", ") == list(FACTORS)
    assert all(f"`{unit}`" in text for unit in get_args(TimeUnit))


def test_mapping_of_the_page(tmp_path: Path) -> None:
    path = tmp_path / "mapping.toml"
    path.write_text(blocks(FLIGHTS, "toml")[0], encoding="utf-8")
    mapping = read_flight_mapping(path)
    assert mapping.clock is not None
    assert (mapping.clock.column, mapping.clock.factor) == ("t_ms", 1e-3)
    az = next(source for source in mapping.sources if source.variables == ("az",))
    assert (az.factors, az.offsets) == ((-9.80665,), (0.0,))


@pytest.mark.parametrize("text", blocks(FLIGHTS, "toml"))
def test_every_mapping_of_the_page_can_be_read(tmp_path: Path, text: str) -> None:
    (tmp_path / "m.toml").write_text(text, encoding="utf-8")
    assert read_flight_mapping(tmp_path / "m.toml").groups


def test_keys_of_mappings() -> None:
    def keys(heading: str, first: str, column: str) -> set[str]:
        cells = table(FLIGHTS, heading, first).column(column)
        return {word for cell in cells for word in cell.replace("`", "").replace(" or ", ", ").split(", ")}

    assert keys("Mapping files", "table", "key") == set(VariableTable.model_fields)
    assert keys("Groups of sources", "key", "key") == {*SourceTable.model_fields, *GroupTable.model_fields}
    assert keys("Groups of sources", "ready mapping", "ready mapping") == set(READY.values())
    told = table(FLIGHTS, "Streams with clocks of their own", "quantity").rows
    assert {row[0].strip("`"): row[1] for row in told} == QUANTITIES
    assert keys("Servo outputs and surfaces", "mixer", "mixer") == set(MIXERS)
    text = FLIGHTS.read_text(encoding="utf-8")
    assert all(f'"{frame}"' in text for frame in ("flu", "enu", "nwu"))


def test_a_drafted_mapping_can_be_read(tmp_path: Path) -> None:
    """The page's own commands, in a shell."""
    t = np.arange(300) * 0.02
    rows = np.column_stack([t, 0.1 * np.sin(t), np.cos(t)])
    log = tmp_path / "flight.csv"
    np.savetxt(log, rows, delimiter=",", header="time,q,elevator", comments="")
    for command in commands(FLIGHTS):
        line = command.replace("stoop", f"{sys.executable} -m stoop")
        subprocess.run(line, shell=True, cwd=tmp_path, capture_output=True, check=True)  # noqa: S602
    assert {"q", "elevator"} <= {str(name) for name in load(log).data.data_vars}


def test_python_of_the_page(tmp_path: Path) -> None:
    flight = simulate_flight(resolve_vehicle("twin-boom"), parse_maneuver("duration = 2.0", "two seconds"))
    save(flight, tmp_path / "flight.nc")
    assert "simulated flight" in run_python(FLIGHTS, tmp_path)
    assert (tmp_path / "copy.nc").exists()


@pytest.mark.parametrize(
    ("heading", "models"),
    [("Top level", [maneuver.Maneuver]), ("[[input]]", INPUTS)],
)
def test_keys_of_maneuver_files(heading: str, models: list[type[BaseModel]]) -> None:
    page = table(MANEUVERS, heading, "key")
    fields = {name: field for model in models for name, field in model.model_fields.items()}
    assert set(page.column("key")) == set(fields)
    for key, said in zip(page.column("key"), page.column("default"), strict=True):
        default = None if fields[key].is_required() else fields[key].get_default(call_default_factory=True)
        if fields[key].is_required():
            assert said == "required", key
        elif isinstance(default, str | float | int):
            assert said.strip('"') == str(default), key


def test_shapes_of_maneuver_files() -> None:
    rows = table(MANEUVERS, "[[input]]", "key").rows
    known = {shape for model in INPUTS for shape in shapes(model)}
    written = next(row[2] for row in rows if row[0] == "shape")
    assert all(f'`"{shape}"`' in written for shape in known)


def shapes(model: type[BaseModel]) -> tuple[str, ...]:
    return get_args(model.model_fields["shape"].annotation)


def test_maneuver_of_the_page() -> None:
    flown = parse_maneuver(blocks(MANEUVERS, "toml")[0], "page")
    assert set(flown.deflections()) == {"rudder", "aileron"}
    assert "noise" in flown.model_fields_set


def test_channels_of_the_pages() -> None:
    channels = ", ".join(OUTPUTS)
    assert channels in FLIGHTS.read_text(encoding="utf-8").replace("\n", " ")
    assert channels in MANEUVERS.read_text(encoding="utf-8")
    assert tables(FLIGHTS)
