"""Folders for autopilots with JSBSim, flown by the properties that their backends write, as by their published sources."""

import re
from pathlib import Path
from typing import Any
from xml.etree import ElementTree as ET

import numpy as np
import pytest

from stoop.base.files import write_files
from stoop.errors import VehicleError
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_text, builtin_vehicle
from stoop.vehicle.channels import rigid_states
from stoop_export.autopilot_outputs import FULL_DEFLECTION
from stoop_export.jsbsim_flight import simulator
from stoop_export.sitl import AutopilotCommands, autopilot_commands
from stoop_export.sitl_folders import ardupilot, px4

FOOT = 0.3048
Folder, Numbers = tuple[dict[str, str], str], dict[str, float]  #: a folder: its texts, the model's place
FOLDERS = {"ardupilot-jsbsim": ardupilot, "px4-jsbsim": px4}
FLYING_WING = """
name = "Flying wing"
mass = { mass = 3.0, inertia = { xx = 0.3, yy = 0.12, zz = 0.4 } }
reference = { area = 0.5, chord = 0.25, span = 2.0, airspeed = 16.0 }
environment = { density = 1.2 }
propulsion = { kind = "constant", thrust = 3.0 }
[controls]
elevon_left = { mix = { servo_1 = 0.4 } }
elevon_right = { mix = { servo_2 = -0.4 } }
fin = { mix = { servo_3 = 0.3 } }
flap = { mix = { servo_4 = 0.3 } }
[aerodynamics]
CD = { CD0 = 0.03, CDalpha2 = 1.2 }
CQ.CQbeta = -0.3
CL = { CL0 = 0.3, CLalpha = 5.0, CLl = { value = 0.3, term = "elevon_left" }, CLr = { value = 0.3, term = "elevon_right" } }
Cm.Cml = { value = -0.3, term = "elevon_left" }
Cm.Cmr = { value = -0.3, term = "elevon_right" }
Cm.Cmflap = { value = -0.02, term = "flap" }
Cm.Cm0 = 0.02
Cm.Cmalpha = -0.5
Cm.Cmq = -3.0
Cl.Cll = { value = 0.1, term = "elevon_left" }
Cl.Clr_ = { value = -0.1, term = "elevon_right" }
Cl.Clfin = { value = 0.005, term = "fin" }
Cl.Clbeta = -0.05
Cl.Clp = -0.4
Cn = { Cnbeta = 0.06, Cnr = -0.1, Cnfin = { value = -0.05, term = "fin" } }
"""


def airframe(texts: dict[str, str]) -> dict[str, float]:
    text = next(text for file, text in texts.items() if "airframes" in file)
    found = re.findall(r"^(?:param set-default )?([A-Z0-9_]+) (\S+)$", text, re.MULTILINE)
    return {name: float(x) for name, x in found}


def commands(vehicle: Vehicle | str) -> AutopilotCommands:
    vehicle = builtin_vehicle(vehicle) if isinstance(vehicle, str) else vehicle
    return autopilot_commands(vehicle, None, 200.0, None)


def aloft(folder: Folder, root: Path, start: Numbers, commands: Numbers) -> Any:
    """Return JSBSim with the model of a folder in a flight over its Earth, at the first frame."""
    texts, place = folder
    name = Path(place).stem
    write_files(root, {f"aircraft/{name}/{name}.xml": texts[place]})
    fdm = simulator(root)
    assert fdm.load_model(name)
    fdm.set_dt(0.001)
    rigid = rigid_states(start)
    first = {f"ic/{axis}-fps": float(rigid[axis][0]) / FOOT for axis in "uvw"}
    first |= {f"ic/{axis}-rad": start.get(axis, 0.0) for axis in ("phi", "theta")}
    for command, x in (first | {"ic/h-sl-ft": start["h"] / FOOT} | commands).items():
        fdm[command] = x
    assert fdm.run_ic()
    for _ in range(int(commands.get("wait", 0))):
        fdm.run()
    return fdm


def accelerations(folder: Folder, root: Path, start: Numbers, commands: Numbers) -> np.ndarray:
    """Return the angular accelerations, rad/s2, two frames after commands to a model that began with steady ones."""
    fdm = aloft(folder, root, start, {n: x for n, x in commands.items() if not n.startswith("more ")})
    for name, x in commands.items():
        fdm[name.removeprefix("more ")] = x
    for _ in range(2):
        fdm.run()
    return np.array([fdm[f"accelerations/{a}dot-rad_sec2"] for a in "pqr"])


@pytest.mark.parametrize("name", ["twin-boom", "quadplane", "flying wing"])
@pytest.mark.parametrize("target", list(FOLDERS))
def test_surfaces_turn_where_the_autopilot_means(name: str, target: str, tmp_path: Path) -> None:
    """A positive command rolls to the right, raises the nose, turns it to the right; steady commands hold the steady flight."""
    wing = name == "flying wing"
    made = commands(parse_vehicle(FLYING_WING, "wing") if wing else name)
    assert {c.name for c in made.surfaces} == {"aileron", "elevator", "rudder"}
    steady = {c.place: c.steady for c in made.outputs if c not in made.rotors}
    folder, start = FOLDERS[target](made), made.wings.start
    level = accelerations(folder, tmp_path, start, steady)
    assert np.abs(level).max() < (0.05 if wing else 0.02)
    for axis, surface in enumerate(("aileron", "elevator", "rudder")):
        command = f"fcs/{surface}-cmd-norm"
        for sign in (-1.0, 1.0):
            x = steady[command] + sign * 0.5 if wing else sign * 0.9
            moved = accelerations(folder, tmp_path, start, steady | {f"more {command}": x}) - level
            assert sign * moved[axis] > 0.5
            assert not wing or abs(moved[axis]) == np.abs(moved).max()
    ends = {c.name: c.full_deflections for c in made.surfaces}
    if wing:  # elevons and a fin, known by their moments alone; a flap is left
        assert made.uncommanded == ("flap",)
        for name, left in (("elevator", -0.4), ("aileron", 0.4)):
            assert ends[name] == pytest.approx({"elevon_left": left, "elevon_right": -0.4})
        assert ends["rudder"] == pytest.approx({"fin": -0.3})
        if target == "px4-jsbsim":
            assert {"CA_AIRFRAME": 1, "CA_SV_CS_COUNT": 3}.items() <= airframe(folder[0]).items()
    else:
        full = 0.35 if name == "quadplane" else FULL_DEFLECTION
        assert abs(ends["elevator"]["elevator"]) == pytest.approx(full)


@pytest.mark.parametrize("name", ["hexa-x", "quadplane"])
def test_the_allocation_is_that_of_the_model(name: str, tmp_path: Path) -> None:
    made = commands(name)
    texts, place = px4(made)
    known = airframe(texts)
    steady = {c.place: c.steady for c in made.rotors}
    for i, command in enumerate(made.rotors):
        assert known[f"PWM_MAIN_FUNC{i + 1}"] == 101 + i

        def loads(x: float, place_of: str = command.place) -> np.ndarray:
            fdm = aloft((texts, place), tmp_path, made.hover.start, {**steady, place_of: x, "wait": 700})
            return np.array([fdm[f"stoop/moment/{a}-Nm"] for a in "xyz"])

        moment = loads(command.steady + 0.002) - loads(command.steady - 0.002)
        at, axis = (np.array([known[f"CA_ROTOR{i}_{k}{a}"] for a in "XYZ"]) for k in "PA")
        expected = np.cross(at, axis) - known[f"CA_ROTOR{i}_KM"] * axis
        assert moment @ expected / np.linalg.norm(moment) / np.linalg.norm(expected) > 0.98
        assert np.sign(moment[2]) == np.sign(expected[2])
    assert known["CA_AIRFRAME"] == (2 if name == "quadplane" else 0)


@pytest.mark.parametrize("name", ["quadplane", "twin-boom"])
def test_what_the_bridge_reads(name: str) -> None:
    made = commands(name)
    texts, place = px4(made)
    config = ET.fromstring(next(text for file, text in texts.items() if "/configs/" in file))  # noqa: S314
    known = airframe(texts)
    assert Path(place).stem == Path(place).parent.name == config.get("name")
    channels = config.findall("actuators/channel")
    assert [int(c.findtext("index", "")) for c in channels] == list(range(len(channels)))
    assert {c.findtext("scale") for c in channels} == {"1"}, "the bridge reads whole numbers"
    model = ET.fromstring(texts[place])  # noqa: S314
    own = {f"fcs/{s}-cmd-norm" for s in ("aileron", "elevator", "rudder")}
    declared = {e.text for e in model.iter("property")} | own
    for channel in channels:
        assert channel.findtext("property") in declared
        function = known[f"PWM_MAIN_FUNC{int(channel.findtext('index', '')) + 1}"]
        assert (function >= 201) == (channel.findtext("property") in own)
    assert known["CA_ROTOR_COUNT"] + known.get("CA_SV_CS_COUNT", 0) == len(channels)
    assert any(re.search(r"/22\d{3}_jsbsim_[a-z0-9_]+$", file) for file in texts)
    if made.rotors:
        u, f = made.rotors[0].steady, known["THR_MDL_FAC"]
        assert f * u**2 + (1.0 - f) * u == pytest.approx(known["MPC_THR_HOVER"], abs=1e-3)


def test_px4s_start_and_a_climb(tmp_path: Path) -> None:
    texts, place = px4(commands("hexa-x"))
    write_files(tmp_path, texts)
    bridge, name = tmp_path / "Tools" / "simulation" / "jsbsim" / "jsbsim_bridge", Path(place).stem
    fdm = simulator(bridge)
    fdm.set_aircraft_path(f"models/{name}")
    assert fdm.load_model(name, False)
    fdm.set_dt(0.004)
    assert fdm.load_ic(str(bridge / "scene" / f"{name}.xml"), False)
    assert fdm.run_ic()
    for _ in range(750):
        fdm.run()
    assert 0.0 < fdm["position/h-agl-ft"] * FOOT < 1.0
    assert fdm["accelerations/a-pilot-z-ft_sec2"] == pytest.approx(-32.17, abs=0.05)
    assert fdm["position/h-sl-meters"] == pytest.approx(488.0, abs=1.0)
    for _ in range(500):
        for i in range(6):
            fdm[f"fcs/esc-cmd-norm[{i}]"] = 0.7
        fdm.run()
    assert fdm["position/h-agl-ft"] * FOOT > 1.5
    assert abs(fdm["attitude/phi-rad"]) < 1e-3


def test_what_they_cannot_hold() -> None:
    shared = builtin_text("quad-x").replace('channel = "motor_2"', 'channel = "motor_1"')
    still = re.sub(r"(?m)^C\w\.\w+ = \{ value = .*\n|, \w+ = \{ value = [^}]*\}", "", FLYING_WING)
    with pytest.raises(VehicleError, match="no rotors; export to px4-jsbsim"):
        ardupilot(commands("quad-x"))
    for text, said in ((shared, "share a channel"), (still, "controls that turn the vehicle")):
        with pytest.raises(VehicleError, match=said):
            commands(parse_vehicle(text, "it"))
