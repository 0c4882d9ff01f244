"""Maneuvers for ArduPilot: a Lua script that moves surfaces, or parameters of the mode System ID for multirotors.

References
----------
ArduPilot, sources: ``ArduCopter/mode_systemid.cpp`` (ranges and signal of ``SID_*``), ``libraries/SRV_Channel/SRV_Channel.cpp``
(functions, pulses of scaled outputs), ``libraries/AP_Scripting/docs/docs.lua``; ``LOG_BITMASK`` of Copter and Plane.
"""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.errors import SimulationError
from stoop.exporters.injection import Injection, Target, corners, pair, template
from stoop.simulation.maneuver import Sweep
from stoop.simulation.rotors import AXES, allocation, channel_range, effects

FUNCTIONS: Final = {
    "aileron": 4, "elevator": 19, "rudder": 21, "elevon_left": 77, "elevon_right": 78, "vtail_left": 79, "vtail_right": 80,
}  #: SERVOn_FUNCTION  # fmt: skip
TOLERANCE: Final = 0.002  #: of the largest output, of the lines between the points of the script
HEAP: Final = 100_000  #: bytes of SCR_HEAP_SIZE that the script takes
POINT_BYTES: Final = 200  #: that a point takes while the script is compiled (measured: Lua 5.3, 64 bit)
MAX_HEAP: Final = 1_000_000  #: of SCR_HEAP_SIZE
SID_AXES: Final = dict(zip(AXES, (10, 11, 12, 13), strict=True))  #: SID_AXIS of the mixer
MOTOR_SHARE: Final = 0.5  #: of the mixer's roll, pitch and yaw that a motor of the frame gets at most
SID_RANGES: Final = {
    "SID_MAGNITUDE": (0.0, 1.0, "lower --amplitude"), "SID_F_START_HZ": (0.01, 100.0, "change --duration"),
    "SID_F_STOP_HZ": (0.01, 100.0, "lower --band"), "SID_T_REC": (0.0, 255.0, "shorten --duration"),
    "SID_T_FADE_IN": (0.0, 20.0, "shorten --duration"), "SID_T_FADE_OUT": (0.0, 5.0, "shorten --duration"),
}  #: of the parameters, and what brings a value inside  # fmt: skip
PLANE_BITS: Final = (*range(16), 20)  #: the default set, which has IMU and RC, and attitude at the full rate
#: fast attitude, outputs, rate control, motors, fast IMU
COPTER_BITS: Final = (*range(11), 12, 13, 15, 17, 18)


def _ardupilot_files(injection: Injection) -> dict[str, str]:
    """Return script and parameters.

    Raises
    ------
    SimulationError
        A throw is exceeded, a multirotor without sweeps, or a parameter out of its range.
    """
    return _sweeps(injection) if injection.on_rotors else _script(injection)


def _script(injection: Injection) -> dict[str, str]:
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
        "ardupilot_maneuver.lua.txt", name=injection.name, inputs="\n".join(inputs), duration=f"{time[-1]:g}",
        bank=_table(injection.angles("phi"), 4), pitch=_table(injection.angles("theta"), 4),
        airspeed=_table(injection.airspeeds(), 2),
    )  # fmt: skip
    parameters = {"SCR_ENABLE": 1, "SCR_HEAP_SIZE": heap, **_logs(PLANE_BITS)}
    return {"maneuver.lua": lua, "ardupilot.param": _text(parameters)}


def _table(ends: tuple[float, float], decimals: int) -> str:
    return "{" + pair(ends, decimals).strip("()") + "}"


def _sweeps(injection: Injection) -> dict[str, str]:
    vehicle, trim, specs = injection.vehicle, injection.trim, injection.maneuver.input
    names = channel_range(vehicle).names
    if not all(isinstance(spec, Sweep) for spec in specs):
        raise SimulationError("ardupilot: the mode System ID flies sweeps alone; add --shape sweep")
    if not all(n.startswith(("motor_", "pwm_")) for n in names):
        raise SimulationError(
            f"ardupilot: the magnitude of the mixer follows from commands to the motors, and the vehicle has {', '.join(names)}; "
            'write a vehicle file with drive = "command"'
        )
    scale = np.array([1000.0 if n.startswith("pwm_") else 1.0 for n in names])
    mixing = allocation(vehicle, effects(vehicle, trim.start, trim.inputs, trim.changes)) / scale[:, None]
    out = {}
    for spec in specs:
        if not isinstance(spec, Sweep):
            continue
        i = AXES.index(spec.control)
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
        out[f"sid_{spec.control}.param"] = _text(values)
    return {**out, "ardupilot.param": _text(_logs(COPTER_BITS))}


def _logs(bits: tuple[int, ...]) -> dict[str, float]:
    return {"LOG_BITMASK": sum(1 << bit for bit in bits), "LOG_DISARMED": 0, "LOG_FILE_RATEMAX": 0}


def _text(parameters: dict[str, float]) -> str:
    """Return a parameter file as ground stations load it."""
    return "".join(
        f"{key},{value:.6g}\n" if isinstance(value, float) else f"{key},{value}\n"
        for key, value in parameters.items()
    )


ARDUPILOT: Final = Target(
    _ardupilot_files, ("maneuver.lua", *(f"sid_{axis}.param" for axis in AXES), "ardupilot.param"), on_wings=True,
    on_rotors=True, surfaces=FUNCTIONS,
)  # fmt: skip
