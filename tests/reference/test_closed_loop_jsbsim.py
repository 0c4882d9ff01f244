"""JSBSim as the independent truth of flights under the law of an autopilot: the exported airplane, its law in the loop."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from stoop.base.files import write_files
from stoop.base.rotations import quaternions_of
from stoop.control_laws.recursion import LawRecursion
from stoop.control_laws.table import firmware_of
from stoop.exporters import jsbsim_aircraft
from stoop.exporters.jsbsim_flight import Host, Record, begin, file_name
from stoop.simulation.maneuver import parse_maneuver
from stoop.tuning.closed_loop import AttitudeLoop, Course, fly_under_law
from stoop.tuning.judgment import commands_of
from stoop.vehicle.document import with_entries
from stoop_studies.verify import scenes

SURFACES = {"elevator": ("pitch", -0.4), "aileron": ("roll", 0.3), "rudder": ("yaw", -0.4)}
LAW = {
    "FW_RR_P": 0.4, "FW_RR_I": 0.3, "FW_RR_FF": 0.3, "FW_PR_P": 0.8, "FW_PR_I": 0.6, "FW_PR_FF": 1.0, "FW_YR_P": 0.3,
    "FW_AIRSPD_TRIM": 33.0, "FW_AIRSPD_MAX": 60.0, "FW_AIRSPD_STALL": 15.0,
}  # fmt: skip
COURSE = """
duration = 12.0
rate = 400.0
[[input]]
control = "phi"
shape = "pulse"
start = 1.0
duration = 5.0
amplitude = 0.4
[[input]]
control = "theta"
shape = "doublet"
start = 2.0
step = 2.0
amplitude = 0.08
"""


def test_jsbsim_flies_the_same_under_the_law(tmp_path: Path) -> None:
    """Steps of bank and pitch with servos that lag; readings within 0.1 % of their ranges."""
    mixes = {("controls", c, "mix"): {f"control_{a}": g} for c, (a, g) in SURFACES.items()}
    vehicle = with_entries(scenes.aircraft(), mixes | {("controls", c, "lag"): 0.04 for c in SURFACES})
    maneuver, firmware = parse_maneuver(COURSE, "course"), firmware_of(LAW, rotors=False)
    ours = fly_under_law(vehicle, maneuver, firmware, LAW)

    course, moved = Course.of(vehicle, maneuver), commands_of(vehicle, firmware, LAW)
    write_files(tmp_path, jsbsim_aircraft.folder(vehicle, None))
    record = Record(vehicle, course.point.start, course.time, course.inputs)
    simulation = begin(tmp_path, file_name(vehicle.name), record, None, Host(2000.0))
    loop = AttitudeLoop(firmware, LAW, moved.axes, course)
    law = LawRecursion([firmware.law(LAW, a) for a in moved.axes], np.zeros((3, 1)))
    rows, done = [], np.zeros((3, 1))
    for k in range(len(course.time)):
        s = simulation.read()
        rows.append(s)
        attitude = quaternions_of(np.array([s["phi"], s["theta"], s["psi"]]))
        speed = float(np.linalg.norm([s["u"], s["v"], s["w"]]))
        setpoints, _ = loop.setpoints(k, attitude, speed)
        done = law.commands(setpoints, np.array([[s["p"]], [s["q"]], [s["r"]]]), loop.scale(speed), done)
        channels = course.inputs[k] + moved.outputs @ done[:, 0]
        simulation.advance(channels, channels)
    for name in ("p", "q", "r", "phi", "theta"):
        theirs = np.array([row[name] for row in rows])
        own = ours.outputs[:, vehicle.outputs.index(name)]
        assert np.ptp(theirs) > 0.05, name
        assert np.sqrt(np.mean((own - theirs) ** 2)) < 1e-3 * np.ptp(theirs), name
