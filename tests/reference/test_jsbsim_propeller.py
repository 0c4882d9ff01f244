"""The angular momentum of a propeller against JSBSim's light airplane, whose propeller turns clockwise as seen from behind."""

import math

import jsbsim
import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.vehicle import parse_vehicle

INCH, FOOT, POUND = 0.0254, 0.3048, 4.4482216152605
INERTIA, GAIN = 1.67 * POUND * FOOT, 0.5 / math.pi  #: kg m2, of JSBSim's prop_75in2f.xml; turns by rad
THRUST_LINE = -24.41 * INCH  #: m, height in JSBSim's frame of the J3Cub
VEHICLE = f"""name = "light airplane"
mass = {{ mass = 400.0, inertia = {{ xx = 900.0, yy = 500.0, zz = 1300.0, xz = 40.0 }} }}
reference = {{ area = 16.6, chord = 1.6, span = 10.7, airspeed = 35.0 }}
aerodynamics = {{ default = false, CL = {{ CL0 = 0.4 }} }}
propulsion = {{ kind = "propeller", channel = "rotor_1", speed_gain = {GAIN}, diameter = 1.9, CT0 = 0.1, inertia = {INERTIA} }}
"""


def flown() -> FloatArray:
    """Return the propeller's speed, p, q, r, all rad/s, and its three moments without that of its thrust, N m, in rows."""
    sim = jsbsim.FGFDMExec(None)
    sim.set_debug_level(0)
    sim.load_model("J3Cub")
    sim["ic/h-sl-ft"], sim["ic/vc-kts"] = 3000.0, 65.0
    sim["fcs/throttle-cmd-norm"], sim["fcs/mixture-cmd-norm"] = 0.8, 0.9
    sim.run_ic()
    sim["propulsion/set-running"] = -1
    rows = []
    for i in range(1200):
        for control, speed in (("elevator", 0.05), ("rudder", 0.03)):
            sim[f"fcs/{control}-cmd-norm"] = 0.3 * math.sin(speed * i)
        sim.run()
        rates = [sim[f"velocities/{a}-rad_sec"] for a in "pqr"]
        moments = [sim[f"moments/{a}-prop-lbsft"] * POUND * FOOT for a in "lmn"]
        moments[1] += (THRUST_LINE - sim["inertia/cg-z-in"] * INCH) * sim["forces/fbx-prop-lbs"] * POUND
        rows.append([sim["propulsion/engine/propeller-rpm"] * math.pi / 30.0, *rates, *moments])
    return np.array(rows)[::20]


def test_gyroscopic_moments() -> None:
    """Those about y and z, sign included; JSBSim adds the reaction to the propeller's torque about x."""
    vehicle, record = parse_vehicle(VEHICLE, "light.toml"), flown()
    rows, theirs = vehicle.parameter_rows(), record[:, 5:]
    still = vehicle.parameter_rows({"propulsion.inertia": 0.0})
    xx, yy, zz, xz = (vehicle.value(f"mass.inertia.{axes}") for axes in ("xx", "yy", "zz", "xz"))
    inertia = np.array([[xx, 0.0, -xz], [0.0, yy, 0.0], [-xz, 0.0, zz]])
    rates = [vehicle.states.index(a) for a in "pqr"]
    ours = []
    for speed, p, q, r, *_ in record:
        inputs = np.array([[speed if name == "rotor_1" else 0.0] for name in vehicle.inputs])
        start = vehicle.initial_states({"V": 30.0, "h": 900.0, "p": p, "q": q, "r": r}, rows, inputs[:, 0])
        turning = [vehicle.kernel().evaluate(n, start, inputs)[0][rates, 0] for n in (rows, still)]
        ours.append(inertia @ (turning[0] - turning[1]))
    assert np.abs(theirs).max(axis=0).min() > 10.0, "both moments count"
    assert np.array(ours)[:, 1:] == pytest.approx(theirs, abs=0.02 * np.abs(theirs).max())
    assert np.array(ours)[:, 0] == pytest.approx(0.0, abs=1e-9)
