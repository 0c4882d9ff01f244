"""Files of learning simulators as their own readers take them, and parameter sets that keep the correlations of the draws."""

import ast
import io
import json
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import yaml

import stoop
from stoop.errors import SimulationError, StoopError
from stoop.simulation import trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries
from stoop_export.bullet_and_isaac import GymPyBulletDrones, Isaac
from stoop_export.crazyflow import Crazyflow
from stoop_export.exporter import Exported, Exporter, ModelData
from stoop_export.mujoco_flight import MuJoCo
from stoop_export.pyflyt import PyFlyt
from stoop_export.targets import TARGETS, export

FULL_THRUST = 8.5  #: N, of a rotor of the quadrotor
#: fields of Isaac Lab's ThrusterCfg and MultirotorCfg (isaaclab_contrib, 2026), those without a default first
THRUSTER = {"dt", "thrust_range", "thrust_const_range", "tau_inc_range", "tau_dec_range", "torque_to_thrust_ratio",
            "thruster_names_expr"}  # fmt: skip
MULTIROTOR = {"prim_path", "spawn", "init_state", "actuators", "rotor_directions", "allocation_matrix"}


def drawn(vehicle: Vehicle, count: int = 12) -> ModelData:
    z = np.random.default_rng(1).standard_normal((count, 2))
    thrust = vehicle.value("rotors.T2") * (1.0 + 0.02 * z[:, 0])
    drag = vehicle.value("rotors.drag") * (1.0 + 0.05 * (0.8 * z[:, 0] + 0.6 * z[:, 1]))
    return ModelData(vehicle, draws={"rotors.T2": thrust, "rotors.drag": drag, "sensors.ax.bias": z[:, 0]})


def test_gym_pybullet_drones_reads_the_description(square: Vehicle) -> None:
    made = GymPyBulletDrones(ModelData(square)).files()
    root = ET.fromstring(made.files[made.main])  # noqa: S314
    properties, base, mass = root[0].attrib, root[1], square.value("mass.mass")
    read = float(base[0][1].attrib["value"]), float(base[0][2].attrib["ixx"])
    assert read == (mass, square.value("mass.inertia.xx"))
    assert {"length", "radius"} <= base[2][1][0].attrib.keys()
    assert len(base[2][0].attrib["xyz"].split()) == 3
    content = json.loads(made.files["quadrotor_x_1_5_kg.json"])
    full = content["rpm_offset"] + content["rpm_gain"]
    assert float(properties["kf"]) * full**2 == pytest.approx(FULL_THRUST, rel=1e-6)
    assert float(properties["km"]) / float(properties["kf"]) == pytest.approx(-0.016)  # clockwise at the left
    weight = mass * square.value("environment.gravity")
    assert float(properties["thrust2weight"]) == pytest.approx(4.0 * FULL_THRUST / weight, rel=1e-6)
    assert float(properties["arm"]) == pytest.approx(0.177 * np.sqrt(2.0))
    places = {j.find("child").attrib["link"]: j.find("origin").attrib["xyz"] for j in root.iter("joint")}
    # x_torque of its dynamics has the first two on the left
    assert (places["prop0_link"], places["prop3_link"]) == ("0.177 0.177 0.03", "0.177 -0.177 0.03")


def test_pyflyt_reads_the_folder(square: Vehicle) -> None:
    made = PyFlyt(ModelData(square)).files()
    content = yaml.safe_load(made.files["quadrotor_x_1_5_kg/quadrotor_x_1_5_kg.yaml"])
    motors = content["motor_params"]
    assert motors["total_thrust"] == pytest.approx(4.0 * FULL_THRUST, rel=1e-6)
    assert motors["torque_coef"] / motors["thrust_coef"] == pytest.approx(0.016)
    assert motors["tau"] == square.value("rotors.lag")
    # 1/2 rho A v^2 is the drag of the body, by the mean of its axes, in PyFlyt's air
    area = content["drag_params"]["drag_coef_xyz"] * content["drag_params"]["drag_area_xyz"]
    assert 0.5 * 1.225 * area == pytest.approx((0.02 + 0.02 + 0.03) / 3.0)
    assert content["control_params"].keys() == {"ang_vel", "ang_pos", "lin_vel", "lin_pos", "z_pos", "z_vel"}
    root = ET.fromstring(made.files["quadrotor_x_1_5_kg/quadrotor_x_1_5_kg.urdf"])  # noqa: S314
    assert [link.attrib["name"] for link in root.iter("link")][-1] == "body", "its drag acts on link 4"


def test_isaac_lab_and_aerial_gym_have_the_fields_of_their_classes(square: Vehicle) -> None:
    made = Isaac(drawn(square))
    files = made.with_draws(made.files()).files
    lab = ast.parse(files["quadrotor_x_1_5_kg_isaac_lab.py"])
    named = (n for n in ast.walk(lab) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name))
    calls = {n.func.id: {k.arg for k in n.keywords} for n in named}  # type: ignore[attr-defined]
    assert (calls["ThrusterCfg"], calls["MultirotorCfg"]) == (THRUSTER, MULTIROTOR)
    gym = ast.parse(files["quadrotor_x_1_5_kg_aerial_gym.py"])
    assert {n.name for n in ast.walk(gym) if isinstance(n, ast.ClassDef)} == {
        "VehicleCfg", "robot_asset", "damping", "control_allocator_config", "motor_model_config"
    }  # fmt: skip
    content = json.loads(files["quadrotor_x_1_5_kg.json"])
    share = np.percentile(drawn(square).draws["rotors.T2"], [2.5, 97.5]) / square.value("rotors.T2")
    nominal, ranges = (content[name]["thrust_const"] for name in ("nominal", "ranges"))
    assert ranges == pytest.approx(nominal * share, rel=1e-3)
    matrix = np.array(content["allocation_matrix"])
    assert matrix[3:] @ np.ones(4) == pytest.approx(0.0, abs=1e-12), "equal thrusts turn it about no axis"
    assert matrix[3, 0] < 0.0, "the rotor at the front right rolls it to the left"
    assert made.omitted.keys() >= {"rotors.drag", "body_drag.quadratic.x"}
    assert len([*ET.fromstring(files["quadrotor_x_1_5_kg.urdf"]).iter("link")]) == 5  # noqa: S314


def test_parameter_sets_keep_the_correlation(square: Vehicle) -> None:
    data = drawn(square)
    made = MuJoCo(data).with_draws(MuJoCo(data).files())
    sets = np.load(io.BytesIO(made.files["draws.npz"]))
    assert set(sets.files) == {"rotors.T2", "rotors.drag"}
    lists = json.loads(made.files["draws.json"])["numbers"]
    for name in sets.files:
        assert sets[name].tolist() == lists[name] == data.draws[name].tolist()
    own = GymPyBulletDrones(data).drawn[0]
    assert np.corrcoef(own["kf"] * own["thrust2weight"], data.draws["rotors.T2"])[0, 1] > 0.9


def test_one_set_is_written_and_draws_that_change_nothing_are_refused(square: Vehicle) -> None:
    one = MuJoCo(ModelData(square, draws={"mass.mass": np.array([1.6])}))
    made = one.with_draws(one.files())
    assert json.loads(made.files["draws.json"])["numbers"] == {"mass.mass": [1.6]}
    left = GymPyBulletDrones(ModelData(square, draws={"mass.mass": np.array([1.6, 1e3])}))
    content = json.loads(left.with_draws(left.files()).files["draws.json"])
    assert (content["draws"], content["numbers"]["mass"]) == (1, [1.6])
    same = MuJoCo(ModelData(square, draws={"sensors.ax.bias": np.array([0.1, 0.2])}))
    with pytest.raises(SimulationError, match="differ from the estimates in no number"):
        same.with_draws(same.files())


def test_refusals(square: Vehicle) -> None:
    # by 5.7 degrees: its side force would be lost
    tilted = with_entries(builtin_vehicle("quad-x"), {("rotor", "m1", "axis"): [0.0, 0.1, -1.0]})
    upright, six = "vertical rotors only; export this vehicle to mujoco", "this vehicle has 6 rotors"
    for target, vehicle, said in (
        *((one, tilted, upright) for one in (PyFlyt, Crazyflow, GymPyBulletDrones, Isaac)),
        (PyFlyt, builtin_vehicle("hexa-x"), six), (Isaac, builtin_vehicle("quad-plus"), "one rotor in each quadrant"),
    ):  # fmt: skip
        with pytest.raises(SimulationError, match=said):
            target(ModelData(vehicle)).files()
    with pytest.raises(StoopError, match="this target takes one parameter set; give mujoco"):
        export(drawn(square), "state-space")
    with pytest.raises(SimulationError, match="none of 3 draws has a steady flight"):
        assert GymPyBulletDrones(ModelData(square, draws={"mass.mass": np.full(3, 1e3)})).drawn


def test_drone_models_has_the_static_thrust() -> None:
    """Also of a vehicle with a part that is linear: T1 x + T2 x^2 at 1000 rad/s for x = 1, by the weight in hover at 200 m."""
    vehicle = builtin_vehicle("quad-x")
    made = Crazyflow(ModelData(vehicle))
    found, rpm, x = made.parameters(made.quad), 1000.0 * 30.0 / np.pi, float(trim(vehicle).inputs[0])
    weight = vehicle.value("mass.mass") * vehicle.value("environment.gravity")
    density = weight / 4.0 / (2.5 * x + 6.0 * x * x)
    thrust = [0.0, 2.5 * density / rpm, 6.0 * density / rpm**2]
    assert found["rpm2thrust"] == pytest.approx(thrust, rel=1e-6, abs=1e-9)
    assert found["mixing_matrix"][2] == [-1.0, -1.0, 1.0, 1.0]


def test_every_row_of_the_targets_names_an_exporter() -> None:
    found = {target.load() for target in TARGETS.values()} - {Exporter}
    assert [issubclass(one, Exporter) for one in found] == [True] * len(TARGETS)
    with pytest.raises(StoopError, match=r"no target 'gazeboo' of an export; did you mean gazebo\?"):
        stoop.export("twin-boom", "gazeboo")


class Card(Exporter):
    def files(self) -> Exported:
        return Exported({"card.txt": b"1.5 kg"}, "card.txt", ("a card",))

    def lacks(self) -> list[str]:
        return ["no aerodynamics"]

    def fly(self, made: Exported) -> Exported:
        return made.with_notes(["cards fly badly"])


def test_notes_are_those_on_files_on_what_a_target_lacks_and_on_its_flight() -> None:
    notes = Card(ModelData(builtin_vehicle("quad-x"))).export().notes
    assert notes == ("a card", "no aerodynamics", "cards fly badly")
