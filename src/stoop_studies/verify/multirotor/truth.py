"""What stoop is given of JSBSim's F450, and what is true of it.

Given are mass, arms, which way rotors turn, moment of inertia in yaw, drag along the thrust. True are balances at its
rotors and on its airframe; nothing here knows an equation of motion. Along a flight JSBSim says thrust and torque of each
rotor and the force of the air on the body. Our coefficients of a rotor and of a body are fitted to these, each force for
itself, without noise: where JSBSim's tables are straight that gives their slopes; where they bend, the line and the
parabola through what was flown, which is all that a flight can tell. What the motors do with a command is measured on a
stand: the body clamped in a steady wind.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.base.units import FOOT
from stoop.vehicle import Vehicle
from stoop.vehicle.atmosphere import SEA_LEVEL_DENSITY
from stoop.vehicle.load import parse_vehicle
from stoop_studies.verify.jsbsim.flight import EARTH_RATE, Recording
from stoop_studies.verify.multirotor.flight import (
    AIRFRAME,
    CLIMB,
    LIFTS,
    MOTORS,
    RATE,
    ROTORS,
    RPM,
    SPEED,
    THRUST,
    TURNS,
    TWISTS,
    Quadrotor,
)

NOISE: Final = {
    "vn": 0.1, "ve": 0.1, "vd": 0.1, "p": 0.02, "q": 0.02, "r": 0.02,
    "phi": 0.01, "theta": 0.01, "psi": 0.01, "ax": 0.3, "ay": 0.3, "az": 0.3,
}  #: one standard deviation of the white noise on each channel: m/s, rad/s, rad, m/s2  # fmt: skip
STARTS: Final = {"xx": 0.03, "yy": 0.03}  #: kg m2, where the search for the moments of inertia starts
KNOWN: Final = ("mass.inertia.zz", "body_drag.quadratic.z")  #: the flight cannot separate them from others
FILE: Final = """
format = "stoop-vehicle/1"
name = "F450 of JSBSim"

[mass]
mass = {mass!r}
[mass.inertia]
xx = {{ value = {xx!r}, free = true, bounds = [0.005, 0.1] }}
yy = {{ value = {yy!r}, free = true, bounds = [0.005, 0.1] }}
zz = {zz!r}

[environment]
gravity = {gravity!r}

[rotors]
drive = "speed"
{channel}
inertia = {{ value = 2e-5, free = true, bounds = [1e-6, 3e-4] }}
T2 = {T2_start!r}
inflow = 0.0
translational = 0.0
torque_ratio = 0.01

[body_drag]
linear = [0.0, 0.0, {{ value = 0.0, free = false }}]
quadratic = [0.0, 0.0, {{ value = {drag!r}, free = false }}]
rotation = [{turning}, {turning}, {turning}]
"""
BY_COMMAND: Final = """\
lag = {{ value = 0.1, free = true, bounds = [0.005, 0.3] }}
gain = {gain!r}
idle = {idle!r}"""
TURNING: Final = "{ value = 0.0, bounds = [-0.1, 0.1] }"
NOTCH: Final = 0.03  #: steps of the command on the stand
LAGS: Final = (0.02, 0.2)  #: s, among which the lag is
SETTLED: Final = 50  #: samples after which the start of a lag is forgotten


def vehicle_of(
    quadrotor: Quadrotor, flown: Recording, truth: Mapping[str, float], motor: Mapping[str, float] | None
) -> Vehicle:
    """Return the vehicle with guesses for all that is to be found.

    Of ``truth`` only `KNOWN` is read. Gravity is what acts on a body at rest over the equator: attraction, less what the
    turning of the Earth takes.
    """
    x = float(np.mean([flown.columns[c].mean() for c in TURNS]))
    radius = quadrotor["position/radius-to-vehicle-ft"] * FOOT
    text = FILE.format(
        mass=quadrotor.mass, **STARTS, zz=truth["mass.inertia.zz"], gravity=flown.gravity - EARTH_RATE**2 * radius,
        channel="" if motor is None else BY_COMMAND.format(**motor),
        T2_start=quadrotor.mass * flown.gravity / 4.0 / x**2, drag=truth["body_drag.quadratic.z"], turning=TURNING,
    )  # fmt: skip
    channels = TURNS if motor is None else MOTORS
    rotors = [
        f'[rotor.{name}]\nchannel = "{channels[i]}"\nposition = {list(quadrotor.position(i))}\n'
        f'spin = "{quadrotor.sense(i)}"'
        for i, name in enumerate(ROTORS)
    ]
    sensors = [f"[sensors.{channel}]\nsigma = {sigma!r}" for channel, sigma in NOISE.items()]
    return parse_vehicle("\n".join([text, *rotors, *sensors]), "jsbsim F450")


def motor_curve(quadrotor: Quadrotor, command: float) -> dict[str, float]:
    """Return the speed over the command at a climb, a straight line: ``gain`` and ``idle`` of a vehicle file."""
    quadrotor.blow((0.0, 0.0, CLIMB))
    speeds = []
    for one in (command - NOTCH, command + NOTCH):
        quadrotor.settle([one] * 4)
        speeds.append(quadrotor[SPEED.format(0)] * RPM)
    gain = (speeds[1] - speeds[0]) / (2.0 * NOTCH)
    return {"gain": gain, "idle": command - sum(speeds) / (2.0 * gain)}


def step_response(quadrotor: Quadrotor, command: float) -> float:
    """Return the time constant of the thrust after a small step of the command, s; mean of up and down."""
    quadrotor.blow((0.0, 0.0, CLIMB))
    areas = []
    for step in (NOTCH, -NOTCH):
        quadrotor.settle([command - step] * 4)
        thrust = [quadrotor[THRUST.format(0)]]
        quadrotor.command([command + step] * 4)
        for _ in range(round(0.8 * RATE)):
            quadrotor.run(1.0 / RATE)
            thrust.append(quadrotor[THRUST.format(0)])
        y = np.array(thrust)
        missing = (y[-1] - y) / (y[-1] - y[0])
        areas.append(float(np.sum(missing[1:] + missing[:-1]) / (2.0 * RATE)))
    return float(np.mean(areas))


def truth(quadrotor: Quadrotor, flown: Recording, motor: Mapping[str, float] | None) -> dict[str, float]:
    """Return JSBSim's numbers by the names of a vehicle file.

    Parameters
    ----------
    quadrotor : Quadrotor
    flown : Recording
    motor : mapping, optional
        What `motor_curve` says where commands are recorded; nothing where speeds are.
    """
    climb = climbs(quadrotor, flown)
    if motor is None:
        lags, x = {}, np.stack([flown.columns[c] for c in TURNS])
    else:
        lag = fitted_lag(flown, climb, motor)
        lags, x = {"rotors.lag": lag}, lagged(flown, motor, lag)
    xx, yy, zz = quadrotor.inertia
    return {
        **thrust(flown, x, climb), **torque_ratio(quadrotor, flown, x, climb), **lags, **airframe(flown),
        **{f"body_drag.rotation.{a}": 0.0 for a in "xyz"},
        "mass.inertia.xx": xx, "mass.inertia.yy": yy, "mass.inertia.zz": zz,
    }  # fmt: skip


def climbs(quadrotor: Quadrotor, flown: Recording) -> FloatArray:
    """Return the speed of the air through each disc (4, n), m/s: JSBSim's hubs move as the body turns, too."""
    x, y, _ = np.array([quadrotor.position(i) for i in range(4)]).T[:, :, None]
    p, q, w = (flown.columns[c] for c in "pqw")
    return np.asarray(-(w + p * y - q * x))


def lagged(flown: Recording, motor: Mapping[str, float], lag: float) -> FloatArray:
    """Return the commands (4, n) in rad/s after a lag of first order; between samples they run on straight lines.

    x[k] = a x[k-1] + (1 - ramp) u[k] + (ramp - a) u[k-1], with a = exp(-1 / (rate lag)).
    """
    u = motor["gain"] * (np.stack([flown.columns[c] for c in MOTORS]) - motor["idle"])
    a = np.exp(-1.0 / (RATE * lag))
    ramp = (1.0 - a) * lag * RATE
    start = u[:, :1] * (ramp - a) + u[:, :1] * a
    return np.hstack([u[:, :1], lfilter([1.0 - ramp, ramp - a], [1.0, -a], u[:, 1:], zi=start)[0]])


def _thrust_terms(x: FloatArray, climb: FloatArray) -> FloatArray:
    """Return what the coefficients of the thrust multiply, for the samples of all rotors after `SETTLED`."""
    return np.stack([x * x, -x * climb], axis=-1)[:, SETTLED:].reshape(-1, 2)


def _lifts(flown: Recording) -> FloatArray:
    """Return the thrusts of all rotors after `SETTLED` at the density of the sea level, N."""
    lifts = np.stack([flown.columns[c] for c in LIFTS]) * SEA_LEVEL_DENSITY / flown.columns["density"]
    return lifts[:, SETTLED:].ravel()


def fitted_lag(flown: Recording, climb: FloatArray, motor: Mapping[str, float]) -> float:
    """Return the lag with which commands explain the thrust best, s."""
    lifts = _lifts(flown)

    def misfit(lag: float) -> float:
        terms = _thrust_terms(lagged(flown, motor, lag), climb)
        return float(np.sum((terms @ _solved(terms, lifts) - lifts) ** 2))

    return float(minimize_scalar(misfit, bounds=LAGS, method="bounded", options={"xatol": 1e-7}).x)


def thrust(flown: Recording, x: FloatArray, climb: FloatArray) -> dict[str, float]:
    """Return the coefficients of the thrust over x (4, n)."""
    T2, inflow = map(float, _solved(_thrust_terms(x, climb), _lifts(flown)))
    return {"rotors.T2": T2, "rotors.inflow": inflow}


def torque_ratio(
    quadrotor: Quadrotor, flown: Recording, x: FloatArray, climb: FloatArray
) -> dict[str, float]:
    """Return torque over thrust, m, and the inertia of a rotor, kg m2, from what four rotors leave over in yaw.

    That is what a flight shows: torques that are alike cancel, so of the tables it is the ratio of slopes over x (4, n).
    The torque is JSBSim's, and the thrust what our coefficients make of x: where commands are recorded, that rises 2 %
    less in yaw than JSBSim's, for two coefficients stand for level, command and climb. A motor's torque, which JSBSim
    says, also speeds its rotor up.
    """
    signs = np.array([1.0 if quadrotor.sense(i) == "ccw" else -1.0 for i in range(4)])
    own = (_thrust_terms(x, climb) @ list(thrust(flown, x, climb).values())).reshape(4, -1)
    lift = signs @ own * flown.columns["density"][SETTLED:] / SEA_LEVEL_DENSITY
    twist = -np.sum([flown.columns[c] for c in TWISTS], axis=0)  # JSBSim has the sign of the turning in it
    faster = np.gradient(signs @ x, 1.0 / RATE)
    ratio, inertia = _solved(np.column_stack([lift, faster[SETTLED:]]), twist[SETTLED:])
    return {"rotors.torque_ratio": float(ratio), "rotors.inertia": float(inertia)}


def airframe(flown: Recording) -> dict[str, float]:
    """Return the drag of the body.

    JSBSim's plate is braked by |V| v; ours by each component for itself. What sideways motion adds to the force along
    the thrust has the form of ``rotors.translational``, a quarter of it for each rotor.
    """
    u, v, w = (flown.columns[c] for c in "uvw")
    ahead, right, down = (-flown.columns[c] for c in AIRFRAME)
    x, y = (_solved(np.column_stack([s, np.abs(s) * s]), force) for s, force in ((u, ahead), (v, right)))
    z = _solved(np.column_stack([np.abs(w) * w, u * u + v * v]), down)
    thin = SEA_LEVEL_DENSITY / float(flown.columns["density"].mean())
    return {
        "body_drag.linear.x": float(x[0]),
        "body_drag.linear.y": float(y[0]),
        "body_drag.quadratic.x": float(x[1]),
        "body_drag.quadratic.y": float(y[1]),
        "body_drag.quadratic.z": float(z[0]),
        "rotors.translational": thin * float(z[1]) / 4.0,
    }


def _solved(columns: FloatArray, values: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(columns, values, rcond=None)[0])
