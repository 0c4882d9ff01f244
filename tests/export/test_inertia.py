"""A full inertia tensor through every exporter, read back from the written files in each format's own convention.

The truth is the definition, I = integral of (r.r 1 - r r') dm: off the diagonal the tensor has minus the products of inertia
of a vehicle file (Ixy = integral of x y dm). In axes forward, left, up it is F I F with F = diag(1, -1, -1).
"""

import json
import re
import tomllib
import zipfile
from collections.abc import Callable
from pathlib import Path
from unittest import mock
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from stoop.base.files import write_files
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop_export import fmu
from stoop_export.exporter import Exported, ModelData, load_script
from stoop_export.targets import TARGETS
from stoop_studies.verify.export import load

FOOT, SLUG = 0.3048, 0.45359237 * 9.80665 / 0.3048
NUMBERS = {"xx": 0.021, "yy": 0.027, "zz": 0.04, "xy": 0.0013, "xz": -0.0021, "yz": 0.0034}
SIX = ("xx", "yy", "zz", "xy", "xz", "yz")
ROWS = ("xx", "xy", "xz"), ("xy", "yy", "yz"), ("xz", "yz", "zz")
#: a planet that does not turn: JSBSim's accelerations are then those of the body alone
STILL = "<planet name='still'><rotation_rate unit='RAD/SEC'>0</rotation_rate></planet>"


def tensor(vehicle: Vehicle, up: bool = False) -> np.ndarray:
    """Return the tensor of a vehicle file, axes forward, right, down, or forward, left, up."""
    out = np.array([[vehicle.value(f"mass.inertia.{n}") for n in row] for row in ROWS])
    signs = 2.0 * np.eye(3) - 1.0
    return out * signs * (np.outer([1, -1, -1], [1, -1, -1]) if up else 1.0)


@pytest.fixture(scope="module")
def quad() -> Vehicle:
    text = re.sub(r"inertia = \{.*?\}", f"inertia = {json.dumps(NUMBERS).replace(':', ' =')}".replace('"', ""),
                  builtin_text("quad-x"))  # fmt: skip
    return parse_vehicle(text, "quad")


def exported(target: str, vehicle: Vehicle) -> Exported:
    return TARGETS[target].load()(ModelData(vehicle)).files()


def symmetric(xx: float, yy: float, zz: float, xy: float, xz: float, yz: float) -> np.ndarray:
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def element(made: Exported, root: Path, ending: str, tag: str) -> ET.Element:
    place = next(p for p in made.files if p.endswith(ending))
    return next(ET.parse(root / place).getroot().iter(tag))  # noqa: S314


def of_jsbsim(made: Exported, root: Path) -> np.ndarray:
    """Return the tensor with which JSBSim turns: M = I w' + w x I w at six rates w, solved for I.

    Free of moments that leaves the scale open, so Ixx is JSBSim's own. Products of inertia are not read there: its property
    inertia/ixz-slugs_ft2 shows the number of the file, an element in structural axes (back, right, up).
    """
    import jsbsim

    (root / "still.xml").write_text(STILL)
    file = next(p for p in root.rglob("*.xml") if ET.parse(p).getroot().tag == "fdm_config")  # noqa: S314
    jsbsim.FGJSBBase().debug_lvl = 0
    engine = jsbsim.FGFDMExec(str(root), None)
    engine.set_debug_level(0)
    engine.load_planet(str(root / "still.xml"), False)
    engine.set_aircraft_path(str(file.parent.parent.relative_to(root)))
    assert engine.load_model(file.stem)
    left, right = [], []
    base = [symmetric(*row) for row in np.eye(6)]
    for omega in np.random.default_rng(1).normal(size=(6, 3)):
        for axis, rate in zip("pqr", omega, strict=True):
            engine[f"ic/{axis}-rad_sec"] = rate
        engine["ic/h-sl-ft"], engine["ic/u-fps"] = 1000.0, 60.0
        engine.run_ic()
        rates = np.array([engine[f"velocities/{a}-rad_sec"] for a in "pqr"])
        turned = np.array([engine[f"accelerations/{a}dot-rad_sec2"] for a in "pqr"])
        moment = np.array([engine[f"moments/{a}-total-lbsft"] for a in "lmn"])
        left.append(np.column_stack([b @ turned + np.cross(rates, b @ rates) for b in base]))
        right.append(moment)
    A, known = np.concatenate(left), engine["inertia/ixx-slugs_ft2"]
    found, _, rank, _ = np.linalg.lstsq(A[:, 1:], np.concatenate(right) - A[:, 0] * known)
    assert rank == 5
    return symmetric(known, *found) * SLUG * FOOT**2


def of_gazebo(made: Exported, root: Path) -> np.ndarray:
    """Return the tensor of all links about their common center of mass: sdformat.org, inertial: elements, link's own frame."""
    masses, places, tensors = [], [], []
    for link in element(made, root, "model.sdf", "sdf").iter("link"):
        turned = [float(x) for x in (link.findtext("pose") or "0 0 0 0 0 0").split()]
        offset = [float(x) for x in (link.findtext("inertial/pose") or "0 0 0 0 0 0").split()]
        assert turned[3:] == offset[3:] == [0.0] * 3, link.attrib["name"]
        masses.append(float(link.findtext("inertial/mass")))  # type: ignore[arg-type]
        places.append(np.add(turned[:3], offset[:3]))
        tensors.append(symmetric(*(float(link.findtext(f"inertial/inertia/i{n}")) for n in SIX)))  # type: ignore[arg-type]
    center = np.average(places, axis=0, weights=masses)
    arms = [r - center for r in places]
    moved = [m * (r @ r * np.eye(3) - np.outer(r, r)) for m, r in zip(masses, arms, strict=True)]
    return np.sum([*tensors, *moved], axis=0)


def of_urdf(made: Exported, root: Path) -> np.ndarray:
    """wiki.ros.org/urdf/XML/link: the elements of the tensor in the link's frame, forward, left, up."""
    entry = element(made, root, ".urdf", "inertia").attrib
    return symmetric(*(float(entry[f"i{n}"]) for n in SIX))


def of_mujoco(made: Exported, root: Path) -> np.ndarray:
    """MuJoCo, XML Reference, body/inertial: fullinertia is M11 M22 M33 M12 M13 M23; beside it names of numbers."""
    found = element(made, root, ".xml", "inertial")
    own = json.loads(made.files[next(p for p in made.files if p.endswith(".json"))])
    assert own["inertia"] == {n: f"mass.inertia.{n}" for n in SIX}
    return symmetric(*map(float, found.attrib["fullinertia"].split()))


def of_rotorpy(made: Exported, root: Path) -> np.ndarray:
    """rotorpy/vehicles/multirotor.py: [[Ixx, Ixy, Ixz], [Ixy, Iyy, Iyz], [Ixz, Iyz, Izz]], axes forward, left, up."""
    text = (root / next(p for p in made.files if p.endswith(".json"))).read_text()
    own = json.loads(text)["quad_params"]
    return symmetric(*(own[f"I{n}"] for n in SIX))


def of_crazyflow(made: Exported, root: Path) -> np.ndarray:
    """drone_models, params.toml: J is the tensor, axes forward, left, up."""
    found = tomllib.loads((root / "params.toml").read_text())
    (own,) = [t for t in (found, *found.values()) if isinstance(t, dict) and "J" in t]
    return np.array(own["J"])


def of_fmu(made: Exported, root: Path) -> np.ndarray:
    """Parameters of the modelDescription of both versions have the names, and so the signs, of a vehicle file."""
    found = []
    for place in made.files:
        with zipfile.ZipFile(root / place) as archive:
            variables = ET.fromstring(archive.read("modelDescription.xml")).find("ModelVariables")  # noqa: S314
        start = {v.attrib["name"]: (v.attrib | {k: x for c in v for k, x in c.attrib.items()}).get("start")
                 for v in variables}  # type: ignore[union-attr] # fmt: skip
        found.append({n: float(start[f"mass.inertia.{n}"]) for n in SIX})  # type: ignore[arg-type]
    assert found == [NUMBERS] * 2
    return symmetric(*(found[0][n] * (1.0 if n[0] == n[1] else -1.0) for n in SIX))


READERS: dict[str, tuple[Callable[[Exported, Path], np.ndarray], bool]] = {
    **dict.fromkeys(("jsbsim", "px4-jsbsim", "ardupilot-jsbsim"), (of_jsbsim, False)), "fmu": (of_fmu, False),
    **dict.fromkeys(("pyflyt", "gym-pybullet-drones", "isaac"), (of_urdf, True)), "gazebo": (of_gazebo, True),
    "mujoco": (of_mujoco, True), "rotorpy": (of_rotorpy, True), "crazyflow": (of_crazyflow, True),
}  #: target -> reader of the tensor, and whether its axes are forward, left, up  # fmt: skip


def test_every_target_is_read() -> None:
    assert {*READERS, "simulink", "state-space"} == set(TARGETS)


@pytest.mark.parametrize("target", READERS)
def test_the_written_tensor_is_that_of_the_vehicle(target: str, quad: Vehicle, tmp_path: Path) -> None:
    vehicle = load("crooked") if target == "ardupilot-jsbsim" else quad  # its backend commands no rotors
    with mock.patch.object(fmu, "find_compiler", return_value=None):  # sources and descriptions alone
        made, (reader, up) = exported(target, vehicle), READERS[target]
    write_files(tmp_path, made.files)
    assert reader(made, tmp_path) == pytest.approx(tensor(vehicle, up), rel=1e-9)


def test_state_space_turns_the_tensor_of_the_vehicle(quad: Vehicle) -> None:
    """At rest I dw'/dx are the derivatives of the moments, whatever the tensor."""
    plain, moments = quad.with_numbers({f"mass.inertia.{n}": {"value": 0.0} for n in SIX[3:]}), []
    for vehicle in (quad, plain):
        made = exported("state-space", vehicle)
        read = json.loads(made.files[made.main])
        turned = [[s["name"] for s in read["states"]].index(a) for a in "pqr"]
        moments.append(tensor(vehicle) @ np.array(read["A"])[turned])
    assert np.abs(moments[0]).max() > 0.1
    assert moments[0] == pytest.approx(moments[1], rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("target", ["pyflyt", "gym-pybullet-drones", "isaac", "crazyflow", "mujoco"])
def test_parameter_sets_hold_the_tensor_of_each_draw(target: str, quad: Vehicle) -> None:
    drawn = {f"mass.inertia.{n}": np.array([1.1 * x, 0.8 * x]) for n, x in NUMBERS.items()}
    exporter = TARGETS[target].load()(ModelData(quad, draws=drawn))
    found = json.loads(exporter.with_draws(Exported({}, "")).files["draws.json"])["numbers"]
    for k, share in enumerate((1.1, 0.8)):
        whole = share * tensor(quad, up=True)
        if target == "mujoco":
            assert [found[f"mass.inertia.{n}"][k] for n in SIX] == [share * NUMBERS[n] for n in SIX]
        elif target == "crazyflow":
            assert np.array(found["J"][k]) == pytest.approx(whole)
        else:
            assert found["inertia"][k] == pytest.approx(np.diag(whole))


def test_mujoco_turns_the_tensor_of_a_draw(quad: Vehicle, tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    made = exported("mujoco", quad)
    write_files(tmp_path, made.files)
    numbers = {f"mass.inertia.{n}": 1.2 * x for n, x in NUMBERS.items()}
    script = load_script(tmp_path / next(p for p in made.files if p.endswith(".py")))
    flown, turned = script.Vehicle(numbers), np.zeros(9)
    mujoco.mju_quat2Mat(turned, flown.model.body_iquat[flown.body])
    axes = turned.reshape(3, 3)
    found = axes @ np.diag(flown.model.body_inertia[flown.body]) @ axes.T
    assert found == pytest.approx(1.2 * tensor(quad, up=True), rel=1e-9)
