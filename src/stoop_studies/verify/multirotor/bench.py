"""What JSBSim's F450 is: balances at its rotors and on its airframe. Nothing here knows an equation of motion.

Along a flight JSBSim tells thrust and torque of each rotor and the force of the air on the body. Our coefficients of a
rotor and of a body are fitted to these, each force for itself, without noise: where JSBSim's tables are straight that
gives their slopes; where they bend, the line and the parabola through what was flown, which is all that a flight can
tell. What the motors do with a command is measured on a stand: the body clamped in a steady wind.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop_studies.verify.multirotor.craft import RATE, RPM, SPEEDS, THRUSTS, Craft
from stoop_studies.verify.multirotor.flight import AIRFRAME, CLIMB, LIFTS, MOTORS, TURNS, TWISTS, Recording

NOTCH: Final = 0.03  #: steps of the command on the stand
LAGS: Final = (0.02, 0.2)  #: s, among which the lag is
SETTLED: Final = 50  #: samples after which the start of a lag is forgotten
SEA_LEVEL: Final = 1.225  #: kg/m3, to which the coefficients of rotors belong


def motor_curve(craft: Craft, command: float) -> dict[str, float]:
    """Return the speed over the command at a climb, a straight line: ``gain`` and ``idle`` of a vehicle file."""
    craft.blow((0.0, 0.0, CLIMB))
    speeds = []
    commands = (command - NOTCH, command + NOTCH)
    for one in commands:
        craft.command([one] * 4)
        craft.settle()
        speeds.append(craft[SPEEDS[0]] * RPM)
    gain = (speeds[1] - speeds[0]) / (2.0 * NOTCH)
    return {"gain": gain, "idle": command - sum(speeds) / (2.0 * gain)}


def step_response(craft: Craft, command: float) -> float:
    """Return the time constant of the thrust after a small step of the command, s; mean of up and down."""
    craft.blow((0.0, 0.0, CLIMB))
    return float(np.mean([_area(craft, command - s, command + s) for s in (NOTCH, -NOTCH)]))


def _area(craft: Craft, before: float, after: float) -> float:
    """Return the area between a step's response and its end, s."""
    craft.command([before] * 4)
    craft.settle()
    thrust = [craft[THRUSTS[0]]]
    craft.command([after] * 4)
    for _ in range(round(0.8 * RATE)):
        craft.sample()
        thrust.append(craft[THRUSTS[0]])
    y = np.array(thrust)
    missing = (y[-1] - y) / (y[-1] - y[0])
    return float(np.sum(missing[1:] + missing[:-1]) / (2.0 * RATE))


def truth(craft: Craft, flown: Recording, motor: Mapping[str, float] | None) -> dict[str, float]:
    """Return JSBSim's numbers by the names of a vehicle file.

    Parameters
    ----------
    motor : mapping, optional
        What `motor_curve` says where commands are recorded; nothing where speeds are.
    """
    climb = climbs(craft, flown)
    if motor is None:
        lags, x = {}, np.stack([flown.columns[c] for c in TURNS])
    else:
        lag = fitted_lag(flown, climb, motor)
        lags, x = {"rotors.lag": lag}, lagged(flown, motor, lag)
    xx, yy, zz = craft.inertia
    return {
        **thrust(flown, x, climb), **torque_ratio(craft, flown, x, climb), **lags, **airframe(flown),
        **{f"body_drag.rotation.{a}": 0.0 for a in "xyz"},
        "mass.inertia.xx": xx, "mass.inertia.yy": yy, "mass.inertia.zz": zz,
    }  # fmt: skip


def climbs(craft: Craft, flown: Recording) -> FloatArray:
    """Return the speed of the air through each disc (4, n), m/s: JSBSim's hubs move as the body turns, too."""
    x, y, _ = np.array([craft.position(i) for i in range(4)]).T[:, :, None]
    p, q, w = (flown.columns[c] for c in "pqw")
    return np.asarray(-(w + p * y - q * x))


def lagged(flown: Recording, motor: Mapping[str, float], lag: float) -> FloatArray:
    """Return the commands (4, n) in rad/s after a lag of first order; between samples they run on straight lines."""
    wanted = motor["gain"] * (np.stack([flown.columns[c] for c in MOTORS]) - motor["idle"])
    kept = np.exp(-1.0 / (RATE * lag))
    ramp = (1.0 - kept) * lag * RATE
    start = (wanted[:, :1] * kept, [1.0 - ramp, ramp - kept], [1.0, -kept])
    # x[k] = kept x[k-1] + (1 - ramp) wanted[k] + (ramp - kept) wanted[k-1]
    rest = lfilter(start[1], start[2], wanted[:, 1:], zi=wanted[:, :1] * (ramp - kept) + start[0])[0]
    return np.hstack([wanted[:, :1], rest])


def _thrust_terms(x: FloatArray, climb: FloatArray) -> FloatArray:
    """Return what the coefficients of the thrust multiply, for the samples of all rotors after `SETTLED`."""
    return np.stack([x * x, -x * climb], axis=-1)[:, SETTLED:].reshape(-1, 2)


def _lifts(flown: Recording) -> FloatArray:
    """Return the thrust of each rotor at the density of the sea level (4, n), N."""
    return np.stack([flown.columns[c] for c in LIFTS]) * SEA_LEVEL / flown.columns["density"]


def fitted_lag(flown: Recording, climb: FloatArray, motor: Mapping[str, float]) -> float:
    """Return the lag with which commands tell the thrust best, s."""
    wanted = _lifts(flown)[:, SETTLED:].ravel()

    def misfit(lag: float) -> float:
        terms = _thrust_terms(lagged(flown, motor, lag), climb)
        return float(np.sum((terms @ _solved(terms, wanted) - wanted) ** 2))

    return float(minimize_scalar(misfit, bounds=LAGS, method="bounded", options={"xatol": 1e-7}).x)


def thrust(flown: Recording, x: FloatArray, climb: FloatArray) -> dict[str, float]:
    """Return the coefficients of the thrust over x (4, n)."""
    found = _solved(_thrust_terms(x, climb), _lifts(flown)[:, SETTLED:].ravel())
    return dict(zip((f"rotors.{n}" for n in ("T2", "inflow")), map(float, found), strict=True))


def torque_ratio(craft: Craft, flown: Recording, x: FloatArray, climb: FloatArray) -> dict[str, float]:
    """Return torque over thrust, m, and the inertia of a rotor, kg m2, from what four rotors leave over in yaw.

    That is what a flight shows: torques that are alike cancel, so of the tables it is the ratio of slopes over x (4, n).
    The torque is JSBSim's, and the thrust what our coefficients make of x: where commands are recorded, that rises 2 %
    less in yaw than JSBSim's, for two coefficients stand for level, command and climb. A motor's torque, which JSBSim
    tells, also speeds its rotor up.
    """
    turns = np.array([1.0 if craft.sense(i) == "ccw" else -1.0 for i in range(4)])
    told = (_thrust_terms(x, climb) @ list(thrust(flown, x, climb).values())).reshape(4, -1)
    lift = turns @ told * flown.columns["density"][SETTLED:] / SEA_LEVEL
    twist = -np.sum([flown.columns[c] for c in TWISTS], axis=0)  # JSBSim has the sign of the turning in it
    faster = np.gradient(turns @ x, 1.0 / RATE)
    ratio, inertia = _solved(np.column_stack([lift, faster[SETTLED:]]), twist[SETTLED:])
    return {"rotors.torque_ratio": float(ratio), "rotors.inertia": float(inertia)}


def airframe(flown: Recording) -> dict[str, float]:
    """Return the drag of the body.

    JSBSim's plate is braked by |V| v; ours by each component for itself. What sideways motion adds to the force along
    the thrust has the form of ``rotors.translational``, a quarter of it for each rotor.
    """
    u, v, w = (flown.columns[c] for c in "uvw")
    ahead, right, down = (-flown.columns[c] for c in AIRFRAME)
    x, y = _solved(_braked(u), ahead), _solved(_braked(v), right)
    z = _solved(np.column_stack([np.abs(w) * w, u * u + v * v]), down)
    thin = SEA_LEVEL / float(flown.columns["density"].mean())
    numbers: Sequence[float] = [*map(float, (x[0], y[0], x[1], y[1], z[0])), thin * float(z[1]) / 4.0]
    names = (
        *(f"body_drag.{n}" for n in ("linear.x", "linear.y", "quadratic.x", "quadratic.y", "quadratic.z")),
    )
    return dict(zip((*names, "rotors.translational"), numbers, strict=True))


def _braked(v: FloatArray) -> FloatArray:
    return np.column_stack([v, np.abs(v) * v])


def _solved(columns: FloatArray, wanted: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(columns, wanted, rcond=None)[0])
