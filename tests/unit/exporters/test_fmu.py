"""Units: what is in them, and that FMPy flies them as the kernel does, with inputs, numbers and starts of its own."""

from __future__ import annotations

import io
import zipfile
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from stoop.errors import StoopError
from stoop.exporters import fmu, fmu_target
from stoop.exporters.reference_flight import reference_flight
from stoop.simulation import Trim, initial_states, parameter_rows, trim
from stoop.simulation.derivatives import ParameterCovariance
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop_studies.verify.export import load

fmpy = pytest.importorskip("fmpy")


@pytest.fixture(scope="module")
def made(twin_boom: Vehicle, steady: Trim) -> fmu.Unit:
    return fmu.make_unit(twin_boom, steady)


@pytest.fixture(scope="module")
def place(made: fmu.Unit, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("units") / "three.fmu"
    out.write_bytes(fmu.unit_bytes(made, "3.0", fmu.find_compiler()))
    return out


@pytest.mark.parametrize("version", fmu.VERSIONS)
@pytest.mark.parametrize("name", ["twin-boom", "quad-x"])
def test_it_flies_as_the_kernel_does(name: str, version: str, tmp_path: Path) -> None:
    from fmpy.validation import validate_fmu

    vehicle = builtin_vehicle(name)
    point = trim(vehicle)
    flight = reference_flight(vehicle, point)
    assert flight is not None
    assert np.ptp(flight.readings, axis=0).min() > 0.02  # every channel moves
    place = tmp_path / "unit.fmu"
    place.write_bytes(fmu.unit_bytes(fmu.make_unit(vehicle, point), version, fmu.find_compiler()))
    assert validate_fmu(str(place)) == []
    assert max(flight.differences(fmu_target.fly_unit(place, flight)).values()) < 1e-11


def test_numbers_and_starts_can_be_set(twin_boom: Vehicle, steady: Trim, place: Path) -> None:
    """The kernel with the same number and start gives the same flight; inputs are held where no rate is given."""
    changed = parameter_rows(twin_boom, {**steady.changes, "Cmq": -30.0})
    states = initial_states(twin_boom, steady.start, changed, steady.inputs)
    states[twin_boom.states.index("q")] = 0.1
    ours = twin_boom.kernel().trajectories(changed, states, np.tile(steady.inputs, (201, 1)), 0.01)[0]
    theirs = fmpy.simulate_fmu(
        str(place), stop_time=2.0, step_size=0.1, output_interval=0.1, output=list(twin_boom.outputs),
        start_values={"Cmq": -30.0, "start.q": 0.1},
    )  # fmt: skip
    for i, name in enumerate(twin_boom.outputs):
        assert theirs[name] == pytest.approx(ours[::10, i], rel=1e-10, abs=1e-12)


def test_the_position_is_the_path_over_ground(steady: Trim, place: Path) -> None:
    found = fmpy.simulate_fmu(str(place), stop_time=10.0, step_size=0.1, output=["north", "east"])
    angle = steady.start["theta"] - steady.start["alpha"]  # level flight, due north but for a little sideslip
    assert found["north"][-1] == pytest.approx(350.0 * np.cos(angle), rel=1e-3)
    assert abs(found["east"][-1]) < 10.0


def test_a_unit_without_library_is_compiled_by_fmpy(made: fmu.Unit, tmp_path: Path) -> None:
    from fmpy.build import build_platform_binary

    place = tmp_path / "unit.fmu"
    place.write_bytes(fmu.unit_bytes(made, "2.0"))
    with zipfile.ZipFile(place) as archive:
        assert not [n for n in archive.namelist() if n.startswith("binaries")]
        archive.extractall(tmp_path / "open")
    (tmp_path / "build").mkdir()
    build_platform_binary(tmp_path / "open", tmp_path / "build")
    found = fmpy.simulate_fmu(str(tmp_path / "open"), stop_time=1.0, output=["V"])
    assert found["V"] == pytest.approx(35.0, abs=1e-6)
    with pytest.raises(StoopError, match="/bin/false: cannot compile"):
        fmu.unit_bytes(made, "3.0", "/bin/false")


def test_delays_are_left_out_and_actuator_numbers_with_them() -> None:
    vehicle = load("crooked")
    made = fmu.make_unit(vehicle, trim(vehicle, None, 200.0))
    names = {q.name for q in made.quantities}
    assert {"CLa", "CLV"} <= names
    assert not [n for n in names if n.endswith((".delay", ".rate_limit", ".dead_zone", ".sigma"))]
    assert all(np.isfinite(q.start) for q in made.quantities)


def test_no_text_of_the_vehicle_reaches_the_source(steady: Trim, twin_boom: Vehicle) -> None:
    odd = replace(twin_boom, file=twin_boom.file.model_copy(update={"name": '*/ "<&>\\'}))
    made = fmu.make_unit(odd, steady)
    content = fmu.unit_bytes(made, "3.0")
    assert content == fmu.unit_bytes(made, "3.0")  # no date
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))  # noqa: S314
        assert root.attrib["modelName"] == '*/ "<&>\\'
        assert b"<&>" not in archive.read(f"sources/{made.name}.c")


def test_parameters_say_what_is_known_of_them(twin_boom: Vehicle, steady: Trim) -> None:
    known = ParameterCovariance(("CLalpha", "Cmq"), np.diag([0.01, np.inf]))
    made = fmu.make_unit(twin_boom, steady, known)
    said = {q.name: q.description for q in made.quantities}
    assert said["CLalpha"] == "standard error 0.1"
    assert said["Cmq"] == "not identified by the flight"
    assert said["Clp"] == ""
    assert b'description="not identified by the flight"' in fmu.description(made, "2.0")
