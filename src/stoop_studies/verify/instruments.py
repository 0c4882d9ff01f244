"""Logs of made-up vehicles: time on the ground, instruments with noise and one defect, and the files of three recorders.

A log holds what such a log holds: PX4 and ArduPilot with the parameters that name outputs and ranges, a table with the
commanded deflections. The truth stays in the program.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import numpy as np
from scipy.signal import lfilter

from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY, standard_density
from stoop.base.rotations import matrices_of_angles
from stoop.base.variables import EULER, POSITION, RATES, SPECIFIC_FORCE, VELOCITY
from stoop.flight import from_columns
from stoop.simulation.trim import traveled
from stoop_plan.flight_logs import save_flight_as
from stoop_studies.verify.made_up import MadeUp
from stoop_studies.verify.pilots import Columns

GROUND: Final = 12.0  #: s on the ground, before the launch
LAUNCH: Final = 1.2  #: s, on a rail; the time in which motors of a multirotor spin up
CHECK: Final = 0.6  #: share of the range by which surfaces are checked on the ground
WIND: Final = 2.0  #: m/s, standard deviation of either component
NOISE: Final = {
    "V": 0.25, "alpha": 0.004, "beta": 0.004, "p": 0.006, "q": 0.006, "r": 0.006,
    "phi": 0.002, "theta": 0.002, "psi": 0.003, "ax": 0.12, "ay": 0.12, "az": 0.15,
    "vn": 0.03, "ve": 0.03, "vd": 0.03, "altitude": 0.05,
}  #: white, one standard deviation, SI  # fmt: skip
DRIFT: Final = {
    "phi": (0.004, 4.0), "theta": (0.004, 4.0), "psi": (0.008, 8.0), "vn": (0.08, 4.0), "ve": (0.08, 4.0),
    "vd": (0.06, 4.0), "altitude": (0.5, 8.0), "wind_n": (0.3, 15.0), "wind_e": (0.3, 15.0),
}  #: of an estimator: standard deviation (SI) and time of correlation (s) of a first-order process  # fmt: skip
BIASES: Final = dict.fromkeys(RATES, 0.004) | dict.fromkeys(SPECIFIC_FORCE, 0.06)  #: of sound instruments, SI
GROUPS: Final = {
    "rates": RATES, "attitude": EULER, "velocity": VELOCITY, "airspeed": ("V",),
    "commands": ("elevator", "aileron", "rudder", "rotors"),
}  # fmt: skip
LOST: Final = {
    "rates": (*RATES, *SPECIFIC_FORCE), "attitude": EULER, "velocity": (*VELOCITY, *POSITION, "altitude"),
}  #: what is lost with a group  # fmt: skip


@dataclass(frozen=True)
class Defect:
    """What is wrong with the instruments of a flight: SI.

    Attributes
    ----------
    words : for the page
    bias, scale : by channel
    delay : s, by group of `GROUPS`
    gaps : group that is lost now and then
    arm : (3,) m, of the accelerometer, in chords (aircraft) or half spans (multirotors)
    """

    words: str
    bias: Mapping[str, float] = field(default_factory=dict)
    scale: Mapping[str, float] = field(default_factory=dict)
    delay: Mapping[str, float] = field(default_factory=dict)
    gaps: str = ""
    arm: tuple[float, float, float] = (0.0, 0.0, 0.0)


def _bias(rng: np.random.Generator) -> Defect:
    rate, force = str(rng.choice(RATES)), str(rng.choice(SPECIFIC_FORCE))
    size = {rate: 0.03 * rng.choice((-1.0, 1.0)), force: 0.4 * rng.choice((-1.0, 1.0))}
    return Defect("biases of a gyro and an accelerometer", bias={n: float(x) for n, x in size.items()})


def _pitot(rng: np.random.Generator) -> Defect:
    share = 1.0 + rng.uniform(0.05, 0.1) * rng.choice((-1.0, 1.0))
    return Defect("scale of the pitot", scale={"V": float(share)})


def _delay(rng: np.random.Generator) -> Defect:
    group = str(rng.choice(("rates", "attitude", "velocity")))
    return Defect("delay of a group of channels", delay={group: float(rng.uniform(0.02, 0.06))})


def _gaps(rng: np.random.Generator) -> Defect:
    return Defect("dropouts", gaps=str(rng.choice(("rates", "attitude", "velocity"))))


def _gyro(rng: np.random.Generator) -> Defect:
    share = 1.0 + rng.uniform(0.02, 0.04) * rng.choice((-1.0, 1.0))
    return Defect("scale of a gyro", scale={str(rng.choice(RATES)): float(share)})


def _arm(rng: np.random.Generator) -> Defect:
    x, y, z = rng.uniform(-1.0, 1.0, 3) * (0.5, 0.1, 0.2)
    return Defect("accelerometer off the center of gravity", arm=(float(x), float(y), float(z)))


DEFECTS: Final[tuple[Callable[[np.random.Generator], Defect], ...]] = (
    _bias, _pitot, _delay, _gaps, _gyro, _arm,
)  # fmt: skip
ROTOR_DEFECTS: Final = tuple(one for one in DEFECTS if one is not _pitot)  #: of what has no pitot


def on_the_ground(
    vehicle: MadeUp, flown: Columns, wind: FloatArray, rate: float, rng: np.random.Generator
) -> Columns:
    """Put time on the ground and a launch before a flight: a rail for aircraft, motors spinning up for multirotors.

    ``flown`` has velocities over ground, ``wind`` (2,) blows north and east, m/s.
    """
    count = round((GROUND + LAUNCH) * rate)
    time = np.arange(count) / rate
    share = 0.5 - 0.5 * np.cos(np.pi * np.clip((time - GROUND) / LAUNCH, 0.0, 1.0))
    out = {n: np.full(count, x[0]) for n, x in flown.items()}
    angles = np.array([flown[a][0] for a in EULER])
    body = matrices_of_angles(angles)
    velocity = np.array([flown[n][0] for n in VELOCITY])
    ahead = share[:, None] * velocity * float(vehicle.winged)
    specific = (np.gradient(ahead, 1.0 / rate, axis=0) - (0.0, 0.0, 9.80665)) @ body
    out |= dict(zip(VELOCITY, ahead.T, strict=True)) | dict(zip(SPECIFIC_FORCE, specific.T, strict=True))
    out |= dict.fromkeys(RATES, np.zeros(count))
    if vehicle.winged:  # the pitot looks along the rail
        out["V"] = np.maximum((ahead - np.append(wind, 0.0)) @ body[:, 0], 0.0)
    powered = [n for n in flown if n.startswith(("motor_", "control_throttle"))]
    out |= {n: share * flown[n][0] for n in powered}
    for i, (surface, throw) in enumerate(vehicle.throw.items()):
        if surface in flown:
            begin = 3.0 + 2.5 * i + rng.uniform(0.0, 0.5)
            swing = np.sin(np.pi * np.clip((time - begin) / 0.8, 0.0, 2.0))
            out[surface] = share * flown[surface][0] + CHECK * throw * swing
    return {n: np.concatenate([out[n], x]) for n, x in flown.items()}


def drifting(rng: np.random.Generator, count: int, rate: float, size: float, tau: float) -> FloatArray:
    """Return a stationary first-order process (n,) of a standard deviation and a time of correlation, s."""
    share = float(np.exp(-1.0 / (rate * tau)))
    driven = rng.standard_normal(count)
    driven[1:] *= np.sqrt(1.0 - share**2)
    return np.asarray(size * lfilter([1.0], [1.0, -share], driven))


def without_noise(true: Columns, rate: float, arm: FloatArray) -> Columns:
    """Return what sound instruments would read: position from the start, and the accelerometer at an ``arm`` (3,), m."""
    position = traveled(np.stack([true[n] for n in VELOCITY], axis=-1), 1.0 / rate)
    out = {**true, **dict(zip(POSITION, position.T, strict=True))}
    out |= {angle: np.unwrap(true[angle]) for angle in ("phi", "psi")}
    rates = np.stack([true[a] for a in RATES], axis=-1)
    turning = np.gradient(rates, 1.0 / rate, axis=0)
    moved = np.cross(turning, arm) + np.cross(rates, np.cross(rates, arm))
    return out | {axis: true[axis] + moved[:, i] for i, axis in enumerate(SPECIFIC_FORCE)}


def measured(
    vehicle: MadeUp, true: Columns, rate: float, defect: Defect, rng: np.random.Generator
) -> Columns:
    """Return what the instruments say of a flight, with noise, drift and defect; NaN where a reading was lost."""
    count, time = len(true["p"]), np.arange(len(true["p"])) / rate
    arm = np.array(defect.arm) * (vehicle.tape["chord"] if vehicle.winged else 0.5 * vehicle.tape["span"])
    out = without_noise(true, rate, arm) | {"density": standard_density(true["altitude"])}
    for group, seconds in defect.delay.items():
        for name in GROUPS[group]:
            out[name] = np.interp(time - seconds, time, out[name])
    for name, x in out.items():
        bias = defect.bias.get(name, 0.0) + BIASES.get(name, 0.0) * rng.standard_normal()
        noise = NOISE.get(name, 0.0) * rng.standard_normal(count)
        slow = drifting(rng, count, rate, *DRIFT[name]) if name in DRIFT else 0.0
        out[name] = defect.scale.get(name, 1.0) * x + bias + noise + slow
    if defect.gaps:
        lost = rng.uniform(size=count) < 0.01
        for begin in rng.uniform(GROUND, time[-1], 4):
            lost |= (time > begin) & (time < begin + rng.uniform(0.3, 1.0))
        for name in LOST[defect.gaps]:
            out[name] = np.where(lost, np.nan, out[name])
    return out


# ---------------------------------------------------------------- what a recorder writes

Recorder = Callable[[MadeUp, Columns], tuple[Columns, dict[str, float]]]
SIGNS: Final = {
    "elevator": -1.0,
    "aileron": 1.0,
    "rudder": -1.0,
}  #: of a surface per command: nose up, right wing down, nose right
COMMANDS: Final = {"elevator": "control_pitch", "aileron": "control_roll", "rudder": "control_yaw"}
TAILS: Final[Mapping[str, tuple[str, ...]]] = {
    "conventional": ("left aileron", "right aileron", "elevator", "rudder"),
    "glider": ("left aileron", "right aileron", "elevator", "rudder"),
    "quadplane": ("left aileron", "right aileron", "elevator", "rudder"),
    "v-tail": ("left aileron", "right aileron", "left v-tail", "right v-tail"),
    "flying-wing": ("left elevon", "right elevon"),
}  #: template -> servos in their order
#: servo -> share of the commands in roll, pitch and yaw that it is sent; its PX4 type and torques; ArduPilot's function
Servo = tuple[tuple[float, float, float], int, tuple[float, float, float], int]
SERVOS: Final[Mapping[str, Servo]] = {
    "left aileron": ((-1.0, 0.0, 0.0), 1, (-0.5, 0.0, 0.0), 4),
    "right aileron": ((1.0, 0.0, 0.0), 2, (0.5, 0.0, 0.0), 4),
    "elevator": ((0.0, 1.0, 0.0), 3, (0.0, 1.0, 0.0), 19),
    "rudder": ((0.0, 0.0, 1.0), 4, (0.0, 0.0, 1.0), 21),
    "left elevon": ((-1.0, 1.0, 0.0), 5, (-0.5, 0.5, 0.0), 77),
    "right elevon": ((1.0, 1.0, 0.0), 6, (0.5, 0.5, 0.0), 78),
    "left v-tail": ((0.0, 1.0, 1.0), 7, (0.0, 0.5, 0.5), 79),
    "right v-tail": ((0.0, 1.0, -1.0), 8, (0.0, 0.5, -0.5), 80),
}
ARDUPILOT_CLASS: Final = {"quad": 1.0, "hexa": 2.0, "octo": 3.0}
PULSES: Final = (1100.0, 1500.0, 1900.0)  #: us, least, neutral and most of a servo of an ArduPilot


def normalized(vehicle: MadeUp, columns: Columns) -> Columns:
    """Return the commands of the pilot, -1 to 1 and 0 to 1, by the names of the registry."""
    surfaces = {
        COMMANDS[s]: sign * columns[s] / vehicle.throw[s] for s, sign in SIGNS.items() if s in columns
    }
    return surfaces | {n: columns[n] for n in ("control_throttle",) if n in columns}


def servo_commands(vehicle: MadeUp, commands: Columns) -> dict[str, FloatArray]:
    """Return the command of each servo, in their order."""
    zero = np.zeros(len(commands["control_pitch"]))
    axes = [commands.get(n, zero) for n in ("control_roll", "control_pitch", "control_yaw")]
    shares = {name: SERVOS[name][0] for name in TAILS[vehicle.template]}
    return {
        name: np.asarray(sum(w * x for w, x in zip(share, axes, strict=True)))
        for name, share in shares.items()
    }


def px4_record(vehicle: MadeUp, columns: Columns) -> tuple[Columns, dict[str, float]]:
    """Return the columns of a PX4 log and its parameters."""
    known = {n: x for n, x in columns.items() if n not in (*SIGNS, "V", "alpha", "beta")}
    rotors = list(vehicle.vehicle.file.rotor.values())
    parameters: dict[str, float] = {"CA_AIRFRAME": 0 if rotors else 1, "CA_ROTOR_COUNT": len(rotors)}
    for i, rotor in enumerate(rotors):
        for axis, x in zip("XYZ", rotor.position, strict=True):
            parameters[f"CA_ROTOR{i}_P{axis}"] = float(x.value)
        parameters[f"CA_ROTOR{i}_KM"] = 0.05 if rotor.spin == "ccw" else -0.05
        parameters[f"PWM_MAIN_FUNC{i + 1}"] = 101 + i
    if not vehicle.winged:
        return known, parameters
    commands = normalized(vehicle, columns)
    servos = servo_commands(vehicle, commands)
    engines = {}
    if vehicle.template == "quadplane":
        parameters |= {"CA_AIRFRAME": 2, **_lift_rotors(vehicle)}
        engines = {f"motor_{k}": np.zeros(len(columns["p"])) for k in range(1, 5)}
    if "control_throttle" in commands:
        i = len(engines)
        engines[f"motor_{i + 1}"] = commands["control_throttle"]
        parameters |= {f"CA_ROTOR{i}_AX": 1.0, f"CA_ROTOR{i}_AZ": 0.0, f"CA_ROTOR{i}_PX": 0.3}
    parameters |= {"CA_ROTOR_COUNT": len(engines), "CA_SV_CS_COUNT": len(servos)}
    parameters |= {f"PWM_MAIN_FUNC{len(servos) + 1 + i}": 101 + i for i in range(len(engines))}
    for i, name in enumerate(servos):
        _, kind, torques, _ = SERVOS[name]
        parameters |= {f"CA_SV_CS{i}_TYPE": kind, f"CA_SV_CS{i}_TRIM": 0.0, f"PWM_MAIN_FUNC{i + 1}": 201 + i}
        parameters |= {f"CA_SV_CS{i}_TRQ_{a}": x for a, x in zip("RPY", torques, strict=True)}
        parameters |= {f"PWM_MAIN_MIN{i + 1}": 1000, f"PWM_MAIN_MAX{i + 1}": 2000}
    known |= commands | {f"servo_{i + 1}": x for i, x in enumerate(servos.values())} | engines
    return known | {"airspeed_pitot": columns["V"]}, parameters


def _lift_rotors(vehicle: MadeUp) -> dict[str, float]:
    """Return the parameters of four rotors in X."""
    arm = 0.25 * vehicle.tape["span"]
    places = ((arm, arm, 0.05), (-arm, -arm, 0.05), (arm, -arm, -0.05), (-arm, arm, -0.05))
    return {
        f"CA_ROTOR{i}_{name}": x
        for i, place in enumerate(places)
        for name, x in zip(("PX", "PY", "KM"), place, strict=True)
    }


def ardupilot_record(vehicle: MadeUp, columns: Columns) -> tuple[Columns, dict[str, float]]:
    """Return the columns of an ArduPilot log and its parameters."""
    known = {n: x for n, x in columns.items() if n not in (*SIGNS, "V", "alpha", "beta")}
    motors = [n for n in columns if n.startswith("motor_")]
    if not vehicle.winged:
        parameters = {"FRAME_CLASS": ARDUPILOT_CLASS[vehicle.template], "FRAME_TYPE": 1.0}
        parameters |= {"MOT_PWM_MIN": 1000.0, "MOT_PWM_MAX": 2000.0}
        parameters |= {f"SERVO{i + 1}_FUNCTION": 33.0 + i for i in range(len(motors))}
        pulses = {f"pwm_{i + 1}": 1000.0 + 1000.0 * known.pop(n) for i, n in enumerate(motors)}
        return known | pulses, parameters
    commands, low, middle, high = normalized(vehicle, columns), *PULSES
    # by this gain a full command is the full throw of a tail in V and of elevons, too
    parameters, outputs = {"MIXING_GAIN": 1.0}, {}
    for i, (name, x) in enumerate(servo_commands(vehicle, commands).items(), 1):
        outputs[f"pwm_{i}"] = middle + (high - middle) * x
        parameters |= {f"SERVO{i}_FUNCTION": float(SERVOS[name][3]), f"SERVO{i}_REVERSED": 0.0}
        if name == "left aileron":  # both follow the same function; this one is mounted the other way around
            parameters[f"SERVO{i}_REVERSED"] = 1.0
        parameters |= {f"SERVO{i}_MIN": low, f"SERVO{i}_TRIM": middle, f"SERVO{i}_MAX": high}
    if "control_throttle" in commands:
        i = len(outputs) + 1
        outputs[f"pwm_{i}"] = 1000.0 + 1000.0 * commands["control_throttle"]
        parameters |= {f"SERVO{i}_FUNCTION": 70.0, f"SERVO{i}_MIN": 1000.0, f"SERVO{i}_MAX": 2000.0}
    if vehicle.template == "quadplane":
        parameters |= {"Q_ENABLE": 1.0, "Q_FRAME_CLASS": 1.0, "Q_FRAME_TYPE": 1.0}
        for k in range(4):
            parameters[f"SERVO{len(outputs) + 1}_FUNCTION"] = 33.0 + k
            outputs[f"pwm_{len(outputs) + 1}"] = np.full(len(columns["p"]), 1000.0)
    ratio = np.sqrt(columns["density"] / SEA_LEVEL_DENSITY)
    return known | commands | outputs | {"airspeed_equivalent": columns["V"] * ratio}, parameters


def csv_record(vehicle: MadeUp, columns: Columns) -> tuple[Columns, dict[str, float]]:
    """Return the columns of a table: vanes and commanded deflections, no parameters, no estimate of the wind."""
    return {n: x for n, x in columns.items() if n not in ("wind_n", "wind_e")}, {}


RECORD: Final[Mapping[str, tuple[Recorder, str]]] = {
    "px4": (px4_record, ".ulg"), "ardupilot": (ardupilot_record, ".bin"), "csv": (csv_record, ".csv"),
}  # fmt: skip


def write_log(vehicle: MadeUp, columns: Columns, rate: float, start: float, folder: Path, name: str) -> Path:
    """Write the log of a flight; returns its file. Nothing but what a recorder knows is written."""
    record, ending = RECORD[vehicle.record]
    known, parameters = record(vehicle, columns)
    time = start + np.arange(len(columns["p"])) / rate
    path = folder / f"{name}{ending}"
    save_flight_as(replace(from_columns(name, time, known), parameters=parameters), path)
    return path
