"""JSBSim's F450, a quadrotor of 1.4 kg in X, identified from its outputs, against its own rotors and its own body.

Four brushless motors (DJI E305: voltage, resistance and no-load current give the torque) turn propellers (DJI 9450:
thrust and power over the advance ratio, measured at APC); the body is a flat plate in any wind. It is unchanged except
for the files of its sensors, which print warnings, and of its autopilot, which is ours.

Stoop is given mass, arms, directions of rotation, the moment of inertia in yaw, and drag along the thrust. True are
balances at the rotors and on the airframe; no equation of motion is used. Along a flight JSBSim gives thrust and torque
of each rotor and the force of the air on the body. Our coefficients of a rotor and of a body are fitted to these, each
force by itself, without noise: where JSBSim's tables are straight that gives their slopes; where they bend, the line and
the parabola through what was flown, which is all that a flight can tell. The response of the motors to a command is
measured on a stand: the body clamped in a steady wind.
"""

from __future__ import annotations

import functools
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.base.units import FACTORS, FOOT, POUND_FORCE, SLUG
from stoop.base.variables import EULER, RATES, VELOCITY
from stoop.errors import StoopError
from stoop.vehicle import Vehicle
from stoop.vehicle.load import parse_vehicle
from stoop_export.jsbsim_flight import simulator
from stoop_studies.findings import Findings, Setting
from stoop_studies.verify.jsbsim import Case, findings
from stoop_studies.verify.jsbsim_flight import EARTH_RATE, RATE, UNCONTROLLED, Executive, Recording, Subject
from stoop_studies.verify.study import Samples, Verification, data_text, work

STEP: Final = 5e-4  #: s, of JSBSim: its motors are integrated by Euler's rule
ALTITUDE: Final = 500.0  #: m, where flights begin
HEADING: Final = 0.5  #: rad
CLIMB_OUT: Final = 6.0  #: s, in which it takes off and climbs; not recorded
DURATION: Final = 24.0  #: s, recorded
CLIMB: Final = 3.0  #: m/s: propellers are told apart from still air only where the air comes from one side
COMMANDED: Final = {0: (6.0, 0.06, 6, 0), 1: (6.0, 0.06, 6, 2), 2: (1.4, 0.05, 7, 5)}
EXCITED: Final = {0: (2.5, 0.4, 9, 1), 1: (2.5, 0.4, 9, 2), 2: (1.0, 0.3, 8, 3), 3: (1.5, 1.0, 6, 4)}
#: axis -> amplitude (m/s, rad/s2, m/s2), lowest frequency (Hz), how many sines, which phases
#: files of JSBSim's package
PARTS: Final = (
    *(f"aircraft/F450/{name}.xml" for name in ("Metrics", "Mass", "Propulsion", "Aero")),
    *(f"engine/{name}.xml" for name in ("DJI_E305", "DJI_9450")),
)
ROTORS: Final = ("front_right", "rear_left", "front_left", "rear_right")  #: in the order of JSBSim's engines
SPEED, THRUST, TORQUE = (
    f"propulsion/engine[{{}}]/{name}" for name in ("propeller-rpm", "thrust-lbs", "propeller-torque-ftlb")
)
RPM: Final = FACTORS["rpm"]
FOOT_POUND: Final = FOOT * POUND_FORCE  #: N m
#: channels: command, speed (rad/s), thrust (N) and torque (N m) of each rotor
MOTORS, TURNS, LIFTS, TWISTS = (
    tuple(f"{of}_{i + 1}" for i in range(4)) for of in ("motor", "rotor", "thrust", "torque")
)
READ: Final = {
    **dict(zip(VELOCITY, ((f"velocities/v-{a}-fps", FOOT) for a in ("north", "east", "down")), strict=True)),
    **{a: (f"velocities/{a}i-rad_sec", 1.0) for a in RATES},
    **{a: (f"attitude/{a}-rad", 1.0) for a in EULER},
    **{f"a{a}": (f"accelerations/a-pilot-{a}-ft_sec2", FOOT) for a in "xyz"},
    "altitude": ("position/h-sl-ft", FOOT), "density": ("atmosphere/rho-slugs_ft3", SLUG / FOOT**3),
    **{a: (f"velocities/{a}-aero-fps", FOOT) for a in "uvw"},
    **{name: (SPEED.format(i), RPM) for i, name in enumerate(TURNS)},
    **{name: (THRUST.format(i), POUND_FORCE) for i, name in enumerate(LIFTS)},
    **{name: (TORQUE.format(i), FOOT_POUND) for i, name in enumerate(TWISTS)},
    **{f"drag_{a}": (f"forces/fb{a}-aero-lbs", POUND_FORCE) for a in "xyz"},
}  #: channel -> property and its unit: gyros sense the rate in space; the accelerometer is at the center of gravity  # fmt: skip
GRAVITY: Final = 9.8  #: m/s2, of the autopilot
HOVER: Final = 0.42  #: command that about carries the weight
#: roll, pitch, yaw, heave
SIGNS: Final = np.array([[-1, 1, 1, 1], [1, -1, 1, 1], [1, 1, -1, 1], [-1, -1, -1, 1]])
GAINS: Final = np.array([1 / 520.0, 1 / 520.0, 1 / 47.0, 1 / 43.0])  #: command per rad/s2 and m/s2
MAX_ANGLE: Final = 0.25  #: rad, of bank and pitch
NOISE: Final = {
    "vn": 0.1, "ve": 0.1, "vd": 0.1, "p": 0.02, "q": 0.02, "r": 0.02,
    "phi": 0.01, "theta": 0.01, "psi": 0.01, "ax": 0.3, "ay": 0.3, "az": 0.3,
}  #: one standard deviation of the white noise on each channel: m/s, rad/s, rad, m/s2  # fmt: skip
KNOWN: Final = ("mass.inertia.zz", "body_drag.quadratic.z")  #: the flight cannot separate them from others
BY_COMMAND: Final = """\
lag = {{ value = 0.1, free = true, bounds = [0.005, 0.3] }}
gain = {gain!r}
idle = {idle!r}"""
NOTCH: Final = 0.03  #: steps of the command on the stand
LAGS: Final = (0.02, 0.2)  #: s, among which the lag is
SETTLED: Final = 50  #: samples after which the start of a lag is forgotten
SPEEDS: Final = "speeds"  #: recorded are the speeds of the rotors
COMMANDS: Final = "commands"  #: recorded are the commands alone
RECORDS: Final = (
    Subject(SPEEDS, "Speeds of the rotors recorded"),
    Subject(COMMANDS, "Commands alone recorded"),
)


class Quadrotor(Executive):
    """JSBSim with the F450 in it, clamped at `ALTITUDE` with its motors at rest."""

    def __init__(self) -> None:
        stock = Path(simulator(None).get_root_dir())
        with tempfile.TemporaryDirectory() as folder:
            root = Path(folder)
            try:
                for part in PARTS:
                    (root / part).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copy(stock / part, root / part)
            except OSError as error:
                raise StoopError(
                    f"jsbsim: its package has no whole F450 ({error}); install jsbsim 1.2 or later"
                ) from error
            (root / "aircraft/F450/F450.xml").write_text(data_text("f450.xml"), encoding="utf-8")
            super().__init__(root, "F450", STEP)
        self.set(UNCONTROLLED)
        self.begin({"ic/h-sl-ft": ALTITUDE / FOOT, "ic/psi-true-rad": HEADING})
        self.fdm.get_propulsion().init_running(-1)
        self.set({"forces/hold-down": 1.0})

    def command(self, commands: Sequence[float] | FloatArray) -> None:
        """Set the four motors, 0 to 1."""
        self.set({f"fcs/throttle-pos-norm[{i}]": value for i, value in enumerate(commands)})

    def run(self, seconds: float) -> None:
        """Let a time pass."""
        for _ in range(round(seconds / STEP)):
            self.fdm.run()

    def settle(self, commands: Sequence[float] | FloatArray) -> None:
        """Command the motors and wait until they have their speed."""
        self.command(commands)
        self.run(0.8)

    def position(self, engine: int) -> tuple[float, float, float]:
        """Return where a rotor is (m forward, right, down)."""
        return self.point(f"propulsion/engine[{engine}]/{{}}-position")

    def sense(self, engine: int) -> str:
        """Return how a rotor turns, seen from above; JSBSim counts clockwise positive, seen from behind its thrust."""
        return "ccw" if self[f"propulsion/engine[{engine}]/propeller-sense"] > 0.0 else "cw"


class Pilot:
    """An autopilot of proportional gains that holds a velocity, and excites the vehicle while it does.

    Velocities (n, 3) north, east, down are commanded, m/s, and accelerations (n, 4) added: roll, pitch, yaw (rad/s2), heave
    (m/s2). Both are sums of sines, a third of an octave apart, of Schroeder's phases; before 0 s it only climbs.
    """

    def __init__(self, time: FloatArray) -> None:
        self.time, grown = time, np.clip(time + 2.0, 0.0, 1.0)
        self.velocity, self.excitation = np.zeros((len(time), 3)), np.zeros((len(time), 4))
        self.velocity[:, 2] = -CLIMB * np.clip((time + CLIMB_OUT) / 2.0, 0.0, 1.0)
        for table, sines in ((self.velocity, COMMANDED), (self.excitation, EXCITED)):
            for axis, (amplitude, lowest, count, phase) in sines.items():
                each = np.arange(count)
                frequency = lowest * 2.0 ** ((each + phase / 6.0) / 3.0)
                angle = 2.0 * np.pi * frequency * time[:, None] - np.pi * each * (each + phase) / count
                table[:, axis] += grown * (amplitude * np.sqrt(0.5 / count) * np.sin(angle).sum(axis=1))
        self.climb_error = 0.0  #: integral, m

    def __call__(self, k: int, now: Mapping[str, float]) -> FloatArray:
        """Return the commands (4,) for sample ``k``, from the state one sample before."""
        north, east, down = (w - now[v] for w, v in zip(self.velocity[k].tolist(), VELOCITY, strict=True))
        c, s = np.cos(now["psi"]), np.sin(now["psi"])
        ahead, right = c * north + s * east, c * east - s * north
        theta = float(np.clip(-1.5 * ahead / GRAVITY, -MAX_ANGLE, MAX_ANGLE))
        phi = float(np.clip(1.5 * right / GRAVITY, -MAX_ANGLE, MAX_ANGLE))
        self.climb_error += down / RATE
        roll = 40.0 * (phi - now["phi"]) - 9.0 * now["p"]
        pitch = 40.0 * (theta - now["theta"]) - 9.0 * now["q"]
        yaw = 4.0 * (HEADING - now["psi"]) - 4.0 * now["r"]
        accelerations = np.array([roll, pitch, yaw, -2.0 * down - 1.0 * self.climb_error])
        return np.asarray(np.clip(HOVER + SIGNS @ (GAINS * (accelerations + self.excitation[k])), 0.05, 1.0))


def fly(quadrotor: Quadrotor, autopilot: Pilot | None = None) -> Recording:
    """Let go of the vehicle and fly the maneuver of an autopilot.

    Commands run on straight lines between the samples, as the record is taken to say.
    """
    if autopilot is None:
        autopilot = Pilot(np.arange(round((CLIMB_OUT + DURATION) * RATE) + 1) / RATE - CLIMB_OUT)
    time = autopilot.time
    commands = np.full((len(time), 4), HOVER)
    quadrotor.settle(commands[0])
    gravity = quadrotor["accelerations/gravity-ft_sec2"] * FOOT
    quadrotor.set({"forces/hold-down": 0.0})
    rows = [quadrotor.sample(READ)]
    for k in range(1, len(time)):
        commands[k] = autopilot(k, dict(zip(READ, rows[-1].tolist(), strict=True)))
        quadrotor.pass_sample(commands[k - 1], commands[k], quadrotor.command)
        rows.append(quadrotor.sample(READ))
    recorded = time >= 0.0
    table = np.column_stack([np.array(rows), commands])[recorded].T.copy()
    return Recording(time[recorded], dict(zip((*READ, *MOTORS), table, strict=True)), gravity)


def vehicle_of(
    quadrotor: Quadrotor, flown: Recording, truth: Mapping[str, float], motor: Mapping[str, float] | None
) -> Vehicle:
    """Return the vehicle with guesses for all that is to be found.

    Of ``truth`` only `KNOWN` is read. Gravity is what acts on a body at rest over the equator: attraction, less what the
    turning of the Earth takes.
    """
    x = float(np.mean([flown.columns[c].mean() for c in TURNS]))
    mass = quadrotor["inertia/mass-slugs"] * SLUG
    radius = quadrotor["position/radius-to-vehicle-ft"] * FOOT
    text = data_text("f450.toml.in").format(
        mass=mass, zz=truth["mass.inertia.zz"], gravity=flown.gravity - EARTH_RATE**2 * radius,
        channel="" if motor is None else BY_COMMAND.format(**motor),
        T2_start=mass * flown.gravity / 4.0 / x**2, drag=truth["body_drag.quadratic.z"],
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
    quadrotor.set({"atmosphere/wind-down-fps": CLIMB / FOOT})
    speeds = []
    for one in (command - NOTCH, command + NOTCH):
        quadrotor.settle([one] * 4)
        speeds.append(quadrotor[SPEED.format(0)] * RPM)
    gain = (speeds[1] - speeds[0]) / (2.0 * NOTCH)
    return {"gain": gain, "idle": command - sum(speeds) / (2.0 * gain)}


def truth(quadrotor: Quadrotor, flown: Recording, motor: Mapping[str, float] | None) -> dict[str, float]:
    """Return JSBSim's numbers by the names of a vehicle file; ``motor`` is its curve where only commands are recorded."""
    climb = climbs(quadrotor, flown)
    if motor is None:
        lags, x = {}, np.stack([flown.columns[c] for c in TURNS])
    else:
        lag = fitted_lag(flown, climb, motor)
        lags, x = {"rotors.lag": lag}, lagged(flown, motor, lag)
    inertia = quadrotor.read([f"inertia/i{a}{a}-slugs_ft2" for a in "xyz"]) * (SLUG * FOOT**2)
    return {
        **rotor_coefficients(quadrotor, flown, x, climb), **lags, **airframe(flown),
        **{f"body_drag.rotation.{a}": 0.0 for a in "xyz"},
        **{f"mass.inertia.{a}{a}": value for a, value in zip("xyz", inertia.tolist(), strict=True)},
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


def rotor_coefficients(
    quadrotor: Quadrotor, flown: Recording, x: FloatArray, climb: FloatArray
) -> dict[str, float]:
    """Return the coefficients of the thrust over x (4, n), torque over thrust, m, and the inertia of a rotor, kg m2.

    The latter two are those of the difference of four rotors in yaw. That is what a flight shows: torques that are alike
    cancel, so of the tables it is the ratio of slopes over x. The torque is JSBSim's, and the thrust what our coefficients
    make of x: where commands are recorded, that rises 2 % less in yaw than JSBSim's, for two coefficients stand for level,
    command and climb. A motor's torque, which JSBSim says, also speeds its rotor up.
    """
    terms = _thrust_terms(x, climb)
    T2, inflow = _solved(terms, _lifts(flown)).tolist()
    signs = np.array([1.0 if quadrotor.sense(i) == "ccw" else -1.0 for i in range(4)])
    own = (terms @ [T2, inflow]).reshape(4, -1)
    lift = signs @ own * flown.columns["density"][SETTLED:] / SEA_LEVEL_DENSITY
    twist = -np.sum([flown.columns[c] for c in TWISTS], axis=0)  # JSBSim has the sign of the turning in it
    faster = np.gradient(signs @ x, 1.0 / RATE)
    ratio, inertia = _solved(np.column_stack([lift, faster[SETTLED:]]), twist[SETTLED:])
    names = ("T2", "inflow", "torque_ratio", "inertia")
    return {f"rotors.{n}": float(v) for n, v in zip(names, (T2, inflow, ratio, inertia), strict=True)}


def airframe(flown: Recording) -> dict[str, float]:
    """Return the drag of the body.

    JSBSim's plate is braked by |V| v; ours by each component for itself. What sideways motion adds to the force along
    the thrust has the form of ``rotors.translational``, a quarter of it for each rotor.
    """
    u, v, w = (flown.columns[c] for c in "uvw")
    ahead, right, down = (-flown.columns[c] for c in ("drag_x", "drag_y", "drag_z"))
    x, y = (_solved(np.column_stack([s, np.abs(s) * s]), force) for s, force in ((u, ahead), (v, right)))
    z = _solved(np.column_stack([np.abs(w) * w, u * u + v * v]), down)
    thin = SEA_LEVEL_DENSITY / float(flown.columns["density"].mean())
    linear, quadratic = {"x": x[0], "y": y[0]}, {"x": x[1], "y": y[1], "z": z[0]}
    return {
        **{f"body_drag.linear.{a}": float(v) for a, v in linear.items()},
        **{f"body_drag.quadratic.{a}": float(v) for a, v in quadratic.items()},
        "rotors.translational": thin * float(z[1]) / 4.0,
    }


def _solved(columns: FloatArray, values: FloatArray) -> FloatArray:
    return np.asarray(np.linalg.lstsq(columns, values, rcond=None)[0])


@functools.cache
def flown_case(recorded: str) -> Case:
    """Fly the vehicle, and measure it on the stand."""
    airborne, clamped = Quadrotor(), Quadrotor()
    flown = fly(airborne)
    by_speed = recorded == SPEEDS
    middle = float(np.mean([flown.columns[c].mean() for c in MOTORS]))
    motor = None if by_speed else motor_curve(clamped, middle)
    found = truth(clamped, flown, motor)
    vehicle = vehicle_of(clamped, flown, found, motor)
    channels = (*NOISE, "altitude", *(TURNS if by_speed else MOTORS))
    unknown = {n: v for n, v in found.items() if n not in KNOWN}
    return Case("f450", vehicle, flown, unknown, NOISE, channels, int(by_speed))


@work
def identify_once(case: str, seed: int) -> dict[str, Any]:
    """Identify the vehicle from one noisy flight."""
    known = flown_case(case)
    return known.estimates(known.flight(seed))


def show(setting: Setting, samples: Samples) -> Findings:
    """Return how far the estimates are off."""
    title = "JSBSim's F450, identified from its outputs"
    return findings(title, "recorded", "parameter", RECORDS, samples)


EXPERIMENT: Final = Verification("multirotor", show, runs=10, work="identify_once", cases=(SPEEDS, COMMANDS))
