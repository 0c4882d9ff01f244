"""Who flies a designed maneuver, and the files that each needs: a pilot, ArduPilot, PX4, the Crazyflie.

- A pilot has a card of steps, and somebody counts aloud.
- ArduPilot runs a Lua script that moves surfaces; for multirotors it has parameters of its mode System ID.
- PX4 takes body rates over MAVLink in offboard mode, from SET_ATTITUDE_TARGET, but no surfaces. Its rate controller gives
  u = FF k s + P k^2 (s - w) for a set-point s and a rate w, plus an integral; k = FW_AIRSPD_TRIM over the airspeed, or 1 without
  FW_ARSP_SCALE_EN. With s = (u + P k^2 w) / (FF k + P k^2), w the rate that the model expects, the surfaces move by the designed
  u where the model is right, and the aircraft follows the expected motion where it is not.
- The Crazyflie gets the expected attitude over radio, while its firmware holds the height.

References
----------
ArduPilot, sources: ``ArduCopter/mode_systemid.cpp`` (ranges and signal of ``SID_*``), ``libraries/SRV_Channel/SRV_Channel.cpp``
(functions, pulses of scaled outputs), ``libraries/AP_Scripting/docs/docs.lua``; ``LOG_BITMASK`` of Copter and Plane.
PX4 documentation, "Offboard Mode" and "Logging"; PX4-Autopilot, ``src/modules/fw_rate_control/FixedwingRateControl.cpp``;
MAVLink common messages, SET_ATTITUDE_TARGET (82) and MAV_CMD_DO_SET_MODE (176).
Bitcraze, crazyflie-lib-python, ``cflib/crazyflie/commander.py`` (``send_zdistance_setpoint``); crazyflie-firmware,
``crtp_commander_generic.c`` (signs of the set-points) and ``docs/functional-areas/usd_deck`` (format of ``config.txt``).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop.extend import motion
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError
from stoop.extend.files import csv_text
from stoop_plan.injection import AXES, AXIS_OF, Injection, Target, corners, pair, template
from stoop_plan.input_design.information import amplitude_text

#: `mode_systemid.cpp`: "Axis requires manual throttle"
MANUAL_THROTTLE: Final = (
    "enter System ID in flight from a mode with manual throttle (Stabilize, Acro): newer firmware refuses others, and "
    "throughout the sweep the throttle stick alone holds the height"
)

NUMBERS: Final = (
    "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve",
)  # fmt: skip
WIDTH: Final = 16  #: characters of the first column
STICKS: Final = ("aileron", "elevator", "rudder")
DIRECTIONS: Final = {
    "roll": ("right wing down", "left wing down"),
    "pitch": ("nose up", "nose down"),
    "yaw": ("nose right", "nose left"),
}  #: of a positive and of a negative moment
LIMITS: Final = {
    "V": ("airspeed", "m/s", 1.0),
    "phi": ("bank", "deg", math.degrees(1.0)),
    "theta": ("pitch", "deg", math.degrees(1.0)),
}
HEAD: Final = """\
FLIGHT CARD: {name}
Airspeed {V:.3g} m/s, altitude {h:.0f} m, straight and level, throttle fixed, calm air.
Beat {beat:g} s: {pace} counts a second, aloud. One stop for each stick, the same to both sides.
Manual mode of any autopilot, or its mode with the least feedback.
Fly each line twice, each time trimmed anew: first with half of the stop, then with the whole one.
The page predicts the standard errors of the lines with the whole stop, each flown once, from trim.
"""
TAIL: Final = """\
{limits}Write down: time, line, wind, what went wrong. Words to stop: "knock it off".
"""


def card(injection: Injection) -> str:
    """Return the card.

    Raises
    ------
    SimulationError
        The maneuver is not one of steps on a beat.
    """
    if injection.beat is None or not all(isinstance(spec, motion.Steps) for spec in injection.maneuver.input):
        raise SimulationError("pilot: a card holds steps on a beat; design with --for pilot")
    other = [c for c in injection.moved_controls if c not in STICKS]
    if other:
        raise SimulationError(
            f"pilot: sticks move {', '.join(STICKS)}, not {other[0]}; exclude it with --amplitude {other[0]}=0"
        )
    start, beat = injection.trim.start, injection.beat
    parts = [
        HEAD.format(name=injection.name, V=start["V"], h=start["h"], beat=beat, pace=f"{1.0 / beat:.3g}")
    ]
    for i, spec in enumerate(sorted(injection.maneuver.input, key=lambda one: one.start), 1):
        if isinstance(spec, motion.Steps):
            parts.append(f"{i}. {_line(injection, spec)}")
    limits = []
    for channel, (name, unit, factor) in LIMITS.items():
        if channel in injection.envelope:
            low, high = (factor * edge for edge in injection.envelope[channel])
            limits.append(f"{name} {low:.0f} to {high:.0f} {unit}")
    if injection.caution:
        parts.append(f"CAUTION: {injection.caution}.\n")
    edges = f"Break off and recover beyond: {', '.join(limits)}.\n" if limits else ""
    parts.append(TAIL.format(limits=edges))
    return "\n".join(parts)


def _line(injection: Injection, spec: motion.Steps) -> str:
    """Return the steps of one control, with the counts of each."""
    axis, moment = max(injection.moments(spec.control).items(), key=lambda item: abs(item[1]))
    throw = injection.throws.get(spec.control)
    stick = f" ({100.0 * abs(spec.amplitude) / throw:.0f} % of the stick)" if throw else ""
    stop = amplitude_text(spec.control, abs(spec.amplitude))
    counts = round(spec.step / (injection.beat or 1.0))
    rows = [f"{spec.control.upper()} {spec.shape}: stop at {stop}{stick}", f'   {"":{WIDTH}} "steady"']
    for i, length in enumerate(spec.PATTERNS[spec.shape]):
        upward = (moment * spec.amplitude > 0.0) == (i % 2 == 0)
        words = [NUMBERS[k % len(NUMBERS)] for k in range(length * counts)]
        rows.append(f"   {DIRECTIONS[axis][0 if upward else 1]:{WIDTH}} {' - '.join(words)}")
    rows.append(f"   {'hands off':{WIDTH}} three seconds or more, then trim again")
    return "\n".join(rows) + "\n"


PILOT: Final = Target(
    lambda injection: {"card.txt": card(injection)}, ("card.txt",), on_wings=True, on_rotors=False,
    advice="its sticks command rates or angles; choose --for ardupilot or crazyflie",
)  # fmt: skip


FUNCTIONS: Final = {
    "aileron": 4, "elevator": 19, "rudder": 21, "elevon_left": 77, "elevon_right": 78, "vtail_left": 79, "vtail_right": 80,
}  #: SERVOn_FUNCTION  # fmt: skip
PLANE: Final = "ArduPilot Plane 4.3 or later"
COPTER: Final = "ArduPilot Copter 4.0 or later"  #: which has the mode System ID
TOLERANCE: Final = 0.002  #: of the largest output, of the lines between the points of the script
HEAP: Final = 100_000  #: bytes of SCR_HEAP_SIZE that the script takes
POINT_BYTES: Final = 200  #: that a point takes while the script is compiled (measured: Lua 5.3, 64 bit)
MAX_HEAP: Final = 1_000_000  #: of SCR_HEAP_SIZE
SID_AXES: Final = dict(zip(motion.EXCITATIONS, (10, 11, 12, 13), strict=True))  #: SID_AXIS of the mixer
MOTOR_SHARE: Final = 0.5  #: of the mixer's roll, pitch and yaw that a motor of the frame gets at most
SID_RANGES: Final = {
    "SID_MAGNITUDE": (0.0, 1.0, "lower --amplitude"), "SID_F_START_HZ": (0.01, 100.0, "change --duration"),
    "SID_F_STOP_HZ": (0.01, 100.0, "lower --band"), "SID_T_REC": (0.0, 255.0, "shorten --duration"),
    "SID_T_FADE_IN": (0.0, 20.0, "shorten --duration"), "SID_T_FADE_OUT": (0.0, 5.0, "shorten --duration"),
}  #: of the parameters, and what brings a value inside  # fmt: skip
PLANE_BITS: Final = (*range(16), 20)  #: the default set, which has IMU and RC, and attitude at the full rate
#: fast attitude, outputs, rate control, motors, fast IMU
COPTER_BITS: Final = (*range(11), 12, 13, 15, 17, 18)


def _edges(injection: Injection, brackets: str) -> dict[str, str]:
    """Return the ends of bank and pitch, rad, and of the airspeed, m/s, beyond which a maneuver is broken off."""
    ends = {
        "bank": injection.angles("phi"),
        "pitch": injection.angles("theta"),
        "airspeed": injection.airspeeds(),
    }
    texts = {name: pair(both, 2 if name == "airspeed" else 4).strip("()") for name, both in ends.items()}
    return {name: f"{brackets[0]}{text}{brackets[1]}" for name, text in texts.items()}


def _script(injection: Injection) -> dict[str, str]:
    """Return the script that moves surfaces, and parameters; SimulationError where a throw is exceeded."""
    time, inputs, count = injection.maneuver.time, [], 0
    for control, x in injection.outputs().items():
        points = corners(time, x, TOLERANCE * float(np.abs(x).max()))
        count += len(points)
        t, y = (", ".join(f"{v:.5g}" for v in column) for column in points.T)
        inputs.append(
            f'  {{name = "{control}", func = {FUNCTIONS[control]},\n   t = {{{t}}},\n   x = {{{y}}}}},'
        )
    heap = HEAP + POINT_BYTES * count
    if heap > MAX_HEAP:
        raise SimulationError(
            f"ardupilot: {count} points do not fit into a script; lower --band, shorten --duration, or take --shape square"
        )
    lua = template(
        "ardupilot_maneuver.lua.txt", name=injection.name, inputs="\n".join(inputs), duration=f"{time[-1]:g}", firmware=PLANE,
        **_edges(injection, "{}"),
    )  # fmt: skip
    parameters = {"SCR_ENABLE": 1, "SCR_HEAP_SIZE": heap, **_logs(PLANE_BITS)}
    return {"maneuver.lua": lua, "ardupilot.param": _text(PLANE, parameters)}


def _sweeps(injection: Injection) -> dict[str, str]:
    """Return parameters of the mode System ID; SimulationError for other signals, and for a parameter out of its range."""
    vehicle, trim, specs = injection.vehicle, injection.trim, injection.maneuver.input
    names = vehicle.rotor_range.names
    if not all(spec.shape == "sweep" for spec in specs):
        raise SimulationError("ardupilot: the mode System ID flies sweeps alone; add --shape sweep")
    if not all(n.startswith(("motor_", "pwm_")) for n in names):
        raise SimulationError(
            f"ardupilot: the magnitude of the mixer follows from commands to the motors, and the vehicle has {', '.join(names)}; "
            'write a vehicle file with drive = "command"'
        )
    scale = np.array([1000.0 if n.startswith("pwm_") else 1.0 for n in names])
    mixing = (
        vehicle.rotor_allocation(vehicle.rotor_effects(trim.start, trim.inputs, trim.changes))
        / scale[:, None]
    )
    out = {}
    for spec in specs:
        if spec.shape != "sweep":
            continue
        i = list(SID_AXES).index(spec.control)
        share = 1.0 if spec.control == "heave" else MOTOR_SHARE
        values = {
            "SID_AXIS": SID_AXES[spec.control],
            "SID_MAGNITUDE": float(np.abs(mixing[:, i]).max()) * abs(spec.amplitude) / share,
            "SID_F_START_HZ": spec.low, "SID_F_STOP_HZ": spec.band, "SID_T_REC": spec.duration,
            "SID_T_FADE_IN": spec.fade, "SID_T_FADE_OUT": spec.fade,
        }  # fmt: skip
        for key, (low, high, advice) in SID_RANGES.items():
            if not low <= values[key] <= high:
                raise SimulationError(
                    f"ardupilot: {key} of {spec.control} would be {values[key]:.4g}, outside {low:g} to {high:g}; {advice}"
                )
        out[f"sid_{spec.control}.param"] = _text(COPTER, values, f"# {MANUAL_THROTTLE}\n")
    return {**out, "ardupilot.param": _text(COPTER, _logs(COPTER_BITS))}


def _logs(bits: tuple[int, ...]) -> dict[str, float]:
    return {"LOG_BITMASK": sum(1 << bit for bit in bits), "LOG_DISARMED": 0, "LOG_FILE_RATEMAX": 0}


def _text(firmware: str, parameters: dict[str, float], remark: str = "") -> str:
    """Return a parameter file as ground stations load it, headed by the firmware that it is for."""
    return f"# {firmware}\n{remark}" + "".join(
        f"{key},{value:.6g}\n" if isinstance(value, float) else f"{key},{value}\n"
        for key, value in parameters.items()
    )


ARDUPILOT: Final = Target(
    lambda injection: _sweeps(injection) if injection.on_rotors else _script(injection),
    ("maneuver.lua", *(f"sid_{axis}.param" for axis in motion.EXCITATIONS), "ardupilot.param"), on_wings=True, on_rotors=True,
    surfaces=FUNCTIONS,
)  # fmt: skip


PX4_FIRMWARE: Final = "PX4 1.14 or later"
KNOWN: Final = ("aileron", "elevator", "rudder")
STREAM: Final = 50.0  #: Hz of the set-points
TYPES: Final = {int: 6, float: 9}  #: of parameters, MAV_PARAM_TYPE
PARAMETERS: Final = {
    "SDLOG_PROFILE": 25,  # bits 0 default, 3 system identification, 4 high rate
    "SDLOG_MODE": 0,  # from arming to disarming
    "IMU_GYRO_RATEMAX": 400,  # Hz
    "COM_OF_LOSS_T": 0.5,  # s
    "COM_OBL_RC_ACT": 5,  # Hold where the script no longer sends
}


def _px4_files(injection: Injection) -> dict[str, str]:
    """Return script, set-points and parameters.

    Raises
    ------
    SimulationError
        A throw is exceeded.
    """
    maneuver = injection.maneuver
    moved = {AXIS_OF[control]: x for control, x in injection.outputs().items()}
    time = injection.at(STREAM)
    columns = {"time_s": time}
    for axis, rate in AXES.items():
        expected = injection.expected(rate)
        columns[f"{axis}_output"] = np.interp(time, maneuver.time, moved.get(axis, np.zeros(len(expected))))
        columns[f"{axis}_rate_rad_s"] = np.interp(time, maneuver.time, expected - expected[0])
    script = template(
        "px4_offboard.py.txt", name=injection.name, firmware=PX4_FIRMWARE, pitch_trim=f"{injection.trim.start['theta']:.5f}",
        **_edges(injection, "()"),
    )  # fmt: skip
    lines = [f"1\t1\t{key}\t{value}\t{TYPES[type(value)]}" for key, value in PARAMETERS.items()]
    return {
        "fly_px4.py": script,
        "px4_setpoints.csv": _setpoints(PX4_FIRMWARE, columns, 9),
        "px4.params": f"# {PX4_FIRMWARE}\n# Onboard parameters: vehicle, component, name, value, type\n"
        + "\n".join(lines)
        + "\n",
    }


def _setpoints(firmware: str, columns: Mapping[str, FloatArray], digits: int) -> str:
    """Return a table of set-points (n,) by column, headed by the firmware that it is for."""
    rows = zip(*columns.values(), strict=True)
    texts = ([f"{round(v, digits) + 0.0:.{digits}g}" for v in row] for row in rows)
    return f"# {firmware}\n" + csv_text(tuple(columns), texts, "\n")


PX4: Final = Target(
    _px4_files, ("fly_px4.py", "px4_setpoints.csv", "px4.params"), on_wings=True, on_rotors=False,
    advice="rates alone would let a multirotor drift; choose --for ardupilot or crazyflie", surfaces=KNOWN,
    needs=tuple(AXES.values()),
)  # fmt: skip


RATE: Final = 100.0  #: Hz, of set-points and log
MAX_ANGLE, MAX_YAW_RATE, MAX_HEIGHT = 30.0, 200.0, 0.5  #: deg, deg/s, and m about the height of the hover
LOGGED: Final = (
    *(f"{sensor}.{axis}" for sensor in ("gyro", "acc") for axis in "xyz"),
    *(f"stateEstimate.{name}" for name in ("qx", "qy", "qz", "qw", "vx", "vy", "vz", "z")),
    *(f"motor.m{i}" for i in range(1, 5)), "pm.vbat",
)  #: one block of the card  # fmt: skip
BUFFER: Final = 512  #: bytes
CRAZYFLIE_FIRMWARE: Final = "Crazyflie firmware 2021.01 or later"
#: The firmware reads lines of 31 characters at most, comments included.
CONFIG: Final = """\
1     # firmware 2021.01+
{buffer}   # buffer size in bytes
stoop # file name
0     # enable on startup
on:fixedFrequency
{rate:.0f}   # Hz
1     # synchronous
{variables}
"""


def _crazyflie_files(injection: Injection) -> dict[str, str]:
    """Return script, set-points and the configuration of the card.

    Raises
    ------
    SimulationError
        The set-points would be too large.
    """
    maneuver = injection.maneuver
    time = injection.at(RATE)
    climb = np.interp(time, maneuver.time, -injection.expected("vd"))
    height = np.concatenate([[0.0], np.cumsum(0.5 * (climb[1:] + climb[:-1]) / RATE)])
    columns = {
        "time_s": time,
        **{
            key: np.interp(time, maneuver.time, np.degrees(injection.expected(channel)))
            for key, channel in (("roll_deg", "phi"), ("pitch_deg", "theta"), ("yawrate_deg_s", "r"))
        },
        "height_m": height,
    }
    limits = (
        ("roll_deg", MAX_ANGLE),
        ("pitch_deg", MAX_ANGLE),
        ("yawrate_deg_s", MAX_YAW_RATE),
        ("height_m", MAX_HEIGHT),
    )
    for key, limit in limits:
        most = float(np.abs(columns[key]).max())
        if most > limit:
            advice = (
                "lower --amplitude heave=..., or exclude it with --amplitude heave=0"
                if key == "height_m"
                else "lower --amplitude or narrow --within"
            )
            raise SimulationError(
                f"crazyflie: the maneuver needs {key} {most:.3g}, and the script sends {limit:g} at most; {advice}"
            )
    roll, pitch = (
        pair((math.degrees(low), math.degrees(high)), 1)
        for low, high in map(injection.angles, ("phi", "theta"))
    )
    return {
        "fly_crazyflie.py": template(
            "crazyflie_setpoints.py.txt",
            name=injection.name,
            firmware=CRAZYFLIE_FIRMWARE,
            roll=roll,
            pitch=pitch,
        ),
        "crazyflie_setpoints.csv": _setpoints(CRAZYFLIE_FIRMWARE, columns, 6),
        "config.txt": CONFIG.format(buffer=BUFFER, rate=RATE, variables="\n".join(LOGGED)),
    }


CRAZYFLIE: Final = Target(
    _crazyflie_files, ("fly_crazyflie.py", "crazyflie_setpoints.csv", "config.txt"), on_wings=False, on_rotors=True,
    advice="choose --for pilot, ardupilot or px4", needs=("phi", "theta", "r", "vd"),
)  # fmt: skip
