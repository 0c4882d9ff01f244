"""Other simulators fly the exports as the kernel does, and a lost axis shows in the statistics (full tier)."""

import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.errors import SimulationError, StoopError
from stoop.simulation import Trim, trim
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text, builtin_vehicle
from stoop.vehicle.document import with_entries
from stoop_export import exporter, fmu, fmu_target, rotorpy_flight, rotorpy_model
from stoop_export.agreement import AXES, Compared, agreement_table, loads_along, omission, omitted_shares
from stoop_export.exporter import ModelData
from stoop_export.gazebo import fly_gazebo, gazebo_loads
from stoop_export.gazebo_model import gazebo_model
from stoop_export.jsbsim_flight import relative_differences
from stoop_export.mujoco_flight import MuJoCo
from stoop_export.reference_flight import ReferenceFlight, reference_flight
from stoop_export.targets import export

SECONDS = 3  #: of the flight that the tests repeat; the page shows 30


def flight_of(vehicle: Vehicle) -> ReferenceFlight:
    return reference_flight(vehicle, trim(vehicle))


def test_a_lost_side_force_is_visible_in_gazebo() -> None:
    """The hexacopter without the drag of its rotors: velocities hardly tell, the table and its sentence do."""
    vehicle = load_vehicle(Path(__file__).parents[2] / "examples/hexacopter.toml")
    flight, model = flight_of(vehicle), gazebo_model(vehicle, trim(vehicle))
    ours = loads_along(flight)
    whole = Compared("Gazebo", flight.title, tuple(AXES), ours, gazebo_loads(model, flight))
    assert whole.statistics["correlation"][1] > 0.999
    bare = replace(model, motors=tuple(replace(m, drag=0.0) for m in model.motors), damping=None)
    theirs = np.hstack([gazebo_loads(bare, flight), fly_gazebo(bare, flight)])
    names, both = (*AXES, *rotorpy_flight.CHANNELS), np.hstack([ours, rotorpy_flight.motion(flight)])
    lost = Compared("Gazebo", flight.title, names, both, theirs)
    found = lost.statistics
    for statistic, x in (("slope", 0.0), ("correlation", 0.0), ("share", 1.0)):
        assert found[statistic][1] == pytest.approx(x, abs=0.01), statistic
    assert found["correlation"][names.index("ve")] > 0.95
    assert "lowest correlation 0 (Fx)" in str(lost)
    assert agreement_table(lost).rows[1][3:] == ("100 %", "0.00", "0.00")


def test_a_longitudinal_fit_is_exported_whole_to_gazebo() -> None:
    found = export(ModelData(builtin_vehicle("twin-boom").reduced("longitudinal")), "gazebo")
    assert any("longitudinal" in note and "six degrees of freedom" in note for note in found.notes)
    assert any("CQV" in note and "% of Fy" in note for note in found.notes)
    assert b"<Clp>" not in found.files[found.main]
    assert b"<Cellp>-0.4" in found.files[found.main]


def rotorpy_script(vehicle: Vehicle, folder: Path, **lost: float) -> Any:
    pytest.importorskip("rotorpy")
    made = rotorpy_model.rotorpy_model(vehicle, trim(vehicle))
    for name, text in made.texts.items():
        for key, x in lost.items():
            text = text.replace(f'"{key}": {made.parameters["quad_params"][key]}', f'"{key}": {x}')
        (folder / name).write_text(text)
    return exporter.load_script(folder / f"{made.name}_rotorpy.py")


def rotorpy_differences(vehicle: Vehicle, folder: Path, stock: bool) -> dict[str, float]:
    """Return the relative differences of the first seconds of the reference flight, states held in between."""
    whole, n = flight_of(vehicle), SECONDS * 100 + 1
    parts = {k: getattr(whole, k)[:n] for k in ("time", "inputs", "states", "readings")}
    flight = replace(whole, **parts, restarts=whole.restarts[:SECONDS])
    ours = rotorpy_flight.motion(rotorpy_flight.held_flight(flight))
    theirs = rotorpy_flight.fly_rotorpy(rotorpy_script(vehicle, folder), flight, stock=stock)
    return relative_differences(rotorpy_flight.CHANNELS, ours, theirs)


def test_rotorpy_flies_the_identified_equations(tmp_path: Path) -> None:
    found = rotorpy_differences(builtin_vehicle("quad-x"), tmp_path, stock=False)
    moving = [n for n in found if n not in ("r", "psi", "vd", "fy", "p", "phi", "ve")]  # others rest yet
    assert max(found[n] for n in moving) < 1e-3


def test_a_lost_side_force_is_visible_in_rotorpy(tmp_path: Path) -> None:
    vehicle = builtin_vehicle("quad-x")
    flight, script = flight_of(vehicle), rotorpy_script(vehicle, tmp_path, k_d=0.0)
    both = (rotorpy_flight.rotorpy_loads(script, flight, stock=stock) for stock in (False, True))
    own, bare = (Compared("", "", tuple(AXES), loads_along(flight), loads) for loads in both)
    assert own.statistics["share"].max() < 1e-5, "equations printed from the same expressions"
    assert bare.statistics["share"][:2].min() > 0.5, "side force without the drag of rotors"
    assert bare.statistics["share"][2:].max() < 0.2


def test_rotorpys_own_model_holds_a_vehicle_of_its_own_terms(tmp_path: Path) -> None:
    """Speeds of rotation, thrust and torque by their squares, drag and inflow: only the torque of inflow is lost."""
    text = builtin_text("quad-x").replace("torque_ratio = 0.016", "Q2 = 1.4e-7")
    numbers = {"gain": 1000.0, "T1": 0.0, "T2": 8.5e-6, "inflow": 2.5e-4, "drag": 8e-5}
    entries = {("rotors", name): x for name, x in numbers.items()} | {
        ("rotors", "drive"): "speed", ("environment", "density"): 1.225, ("body_drag", "quadratic"): [0.0, 0.0, 0.0],
    }  # fmt: skip
    vehicle = with_entries(parse_vehicle(text, "quad"), entries)
    made = rotorpy_model.rotorpy_model(vehicle, trim(vehicle)).parameters["quad_params"]
    numbers = {"k_eta": 8.5e-6, "k_m": 1.4e-7, "k_d": 8e-5, "k_z": 2.5e-4}
    assert {n: made[n] for n in numbers} == pytest.approx(numbers, rel=1e-6)
    assert made["rotor_directions"] == [-1, -1, 1, 1]
    assert made["rotor_pos"]["m1"] == [0.177, -0.177, 0.03]
    found = rotorpy_differences(vehicle, tmp_path, stock=True)
    assert max(found[n] for n in ("vn", "q", "theta", "fz")) < 1e-3
    assert rotorpy_model.limits(vehicle) == {}
    with pytest.raises(SimulationError, match="flies vehicles of 4 rotors"):
        rotorpy_model.rotorpy_model(builtin_vehicle("hexa-x"), trim(builtin_vehicle("hexa-x")))


def test_omitted_damping_is_measured_in_shares_of_each_axis() -> None:
    vehicle = with_entries(builtin_vehicle("quad-x"), {("body_drag", "rotation"): [0.01, 0.0, 0.0]})
    flight = flight_of(vehicle)
    ((lost, shares),) = omitted_shares(flight, rotorpy_model.limits(vehicle)).items()
    assert lost == "body_drag.rotation.x"
    p, q, r = (flight.states[:, vehicle.states.index(n)] for n in "pqr")
    # rolling moment by hand: -0.01 p of Ixx pdot + (Izz - Iyy) q r
    rows = np.repeat(vehicle.values[:, None], len(p), axis=1)
    rates = vehicle.kernel().evaluate(rows, flight.states.T.copy(), flight.inputs.T.copy())[0]
    xx, yy, zz = (vehicle.value(f"mass.inertia.{a}") for a in ("xx", "yy", "zz"))
    rolling = xx * rates[vehicle.states.index("p")] + (zz - yy) * q * r
    assert shares[3] == pytest.approx(np.sqrt(np.mean((0.01 * p) ** 2)) / rolling.std(), rel=1e-9)
    assert np.nan_to_num(np.delete(shares, 3)) == pytest.approx(0.0, abs=1e-12)
    assert ", 0 % of My, 0 % of Mz (rms" in omission("A tool", "this", shares), "rounding prints as 0"


def test_a_draw_flies_in_mujoco_beside_callbacks_of_the_user(square: Vehicle, tmp_path: Path) -> None:
    mujoco, quad = pytest.importorskip("mujoco"), square
    changes = {"rotors.T2": 9.0, "mass.mass": 1.7, "mass.inertia.yy": 0.035, "rotors.lag": 0.08}
    for place, content in MuJoCo(ModelData(quad)).files().files.items():
        (tmp_path / place).write_bytes(content)
    script = exporter.load_script(tmp_path / "quadrotor_x_1_5_kg_mujoco.py")
    flown, channels = script.Vehicle(changes), np.array([0.7, 0.6, 0.65, 0.5])
    flown.reset()
    flown.command(channels)
    flown.forward()
    point = trim(quad)
    states = quad.initial_states(point.start, quad.parameter_rows(), point.inputs)
    rates, _ = quad.kernel().evaluate(quad.parameter_rows(changes), states, channels[:, None].copy())
    ours = dict(zip(quad.states, rates[:, 0], strict=True))
    assert -flown.data.qacc[2] == pytest.approx(ours["w"], abs=1e-9)
    assert flown.data.qacc[3:] == pytest.approx([ours["p"], -ours["q"], -ours["r"]], abs=1e-9)
    assert flown.data.act_dot == pytest.approx([ours[f"m{i}.lag"] for i in range(1, 5)], abs=1e-9)

    flown, own = script.Vehicle(), lambda model, data: None  # a callback of the user
    flown.forward()
    free, force = flown.data.qacc.copy(), 0.3
    flown.data.qfrc_applied[flown.velocity] = [force, 0.0, 0.0]
    mujoco.set_mjcb_control(own)
    try:
        flown.forward()
        pushed = flown.data.qacc - free
        flown.step(flown.channels)
        assert mujoco.get_mjcb_control() is own
    finally:
        mujoco.set_mjcb_control(None)
    assert pushed == pytest.approx([force / quad.value("mass.mass"), 0.0, 0.0, 0.0, 0.0, 0.0], abs=1e-9)


@pytest.mark.parametrize("version", fmu.VERSIONS)
@pytest.mark.parametrize("name", ["twin-boom", "quad-x"])
def test_fmpy_flies_as_the_kernel_does(name: str, version: str, tmp_path: Path) -> None:
    pytest.importorskip("fmpy")
    from fmpy.validation import validate_fmu

    vehicle, place = builtin_vehicle(name), tmp_path / "unit.fmu"
    flight = flight_of(vehicle)
    assert np.ptp(flight.readings, axis=0).min() > 0.02  # every channel moves
    place.write_bytes(fmu.unit_bytes(fmu.make_unit(vehicle, trim(vehicle)), version, fmu.find_compiler()))
    assert validate_fmu(str(place)) == []
    assert max(flight.differences(fmu_target.fly_unit(place, flight)).values()) < 1e-11


def test_numbers_and_starts_of_a_unit_can_be_set(twin_boom: Vehicle, steady: Trim, tmp_path: Path) -> None:
    """The kernel with the same number and start gives the same flight; level flight is due north."""
    fmpy = pytest.importorskip("fmpy")
    place = tmp_path / "three.fmu"
    place.write_bytes(fmu.unit_bytes(fmu.make_unit(twin_boom, steady), "3.0", fmu.find_compiler()))
    found = fmpy.simulate_fmu(str(place), stop_time=10.0, step_size=0.1, output=["north", "east"])
    angle = steady.start["theta"] - steady.start["alpha"]
    assert found["north"][-1] == pytest.approx(350.0 * np.cos(angle), rel=1e-3)
    assert abs(found["east"][-1]) < 10.0, "but for a little sideslip"
    changed = twin_boom.parameter_rows({**steady.changes, "Cmq": -30.0})
    states = twin_boom.initial_states(steady.start, changed, steady.inputs)
    states[twin_boom.states.index("q")] = 0.1
    ours = twin_boom.kernel().trajectories(changed, states, np.tile(steady.inputs, (201, 1)), 0.01)[0]
    theirs = fmpy.simulate_fmu(str(place), stop_time=2.0, step_size=0.1, output_interval=0.1, output=list(twin_boom.outputs),
                               start_values={"Cmq": -30.0, "start.q": 0.1})  # fmt: skip
    for i, name in enumerate(twin_boom.outputs):
        assert theirs[name] == pytest.approx(ours[::10, i], rel=1e-10, abs=1e-12)


def test_a_unit_without_library_is_compiled_by_fmpy(twin_boom: Vehicle, steady: Trim, tmp_path: Path) -> None:
    fmpy = pytest.importorskip("fmpy")
    from fmpy.build import build_platform_binary

    made, place = fmu.make_unit(twin_boom, steady), tmp_path / "unit.fmu"
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
