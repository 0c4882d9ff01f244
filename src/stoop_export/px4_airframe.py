"""PX4's airframe of a vehicle: number, control allocation, airspeeds and hover, for any simulator.

References
----------
PX4-Autopilot: src/modules/control_allocator/module.yaml (00f285ea) and ActuatorEffectivenessRotors.cpp (25ab311a), airframes
1036_jsbsim_malolo and 10043_sihsim_standard_vtol (000f5fdb), 4004_gz_standard_vtol and 4008_gz_advanced_plane.
FW_AIRSPD_*: equivalent airspeed, as a pitot tube measures it.
"""

from __future__ import annotations

import re
import zlib
from collections.abc import Mapping, Sequence
from typing import Final

from stoop.extend.errors import VehicleError
from stoop.extend.text import printable
from stoop.extend.variables import PX4
from stoop_export.autopilot_outputs import FASTEST, SLOWEST, MotorOutput, SurfaceOutput, ThrustCurve

FIRST_NUMBER: Final = 22000  #: of PX4's numbers for airframes of one's own, of which there are a thousand
VTOL: Final = 2  #: CA_AIRFRAME
KINDS: Final = (("mc", "Multirotor"), ("fw", "Plane"), ("vtol", "VTOL"))
"""By CA_AIRFRAME: of the defaults, of the header."""
_TYPES: Final = {name: kind for kind, (name, _) in PX4.surfaces.items()}


def airframe_number(name: str) -> int:
    """Return the number of an airframe, by its name, so that the airframes of several vehicles can stand side by side."""
    return FIRST_NUMBER + zlib.crc32(name.encode()) % 1000


def airframe_kind(where: str, rotors: bool, surfaces: bool) -> int:
    """Return CA_AIRFRAME: 0 of a multirotor, 1 of an airplane, 2 of a vehicle with rotors and surfaces.

    Raises
    ------
    VehicleError
        Neither rotors nor surfaces: there is nothing to allocate.
    """
    if not rotors and not surfaces:
        raise VehicleError(f"{where}: PX4 needs rotors or surfaces that turn the vehicle; the file has none")
    if rotors and surfaces:
        return VTOL
    return 1 if surfaces else 0


def airframe(title: str, kind: int, parameters: Mapping[str, float], settings: Sequence[str] = ()) -> str:
    """Return the start-up file: header, defaults of the kind, settings of the shell, and parameters."""
    defaults, group = KINDS[kind]
    shown = re.sub(r"[^ -~]", "?", printable(title))
    lines = ["#!/bin/sh", f"# @name {shown}", f"# @type {group}", ""]
    lines += [
        "# Made by stoop export; gains and limits are PX4's own.",
        f". ${{R}}etc/init.d/rc.{defaults}_defaults",
        "",
    ]
    lines += [*settings, ""] if settings else []
    return "\n".join([*lines, *(f"param set-default {n} {x:g}" for n, x in parameters.items())]) + "\n"


def allocation(
    kind: int, motors: Sequence[MotorOutput], surfaces: Sequence[SurfaceOutput]
) -> dict[str, float]:
    """Return the geometry of motors and surfaces; KM is positive for a rotor that turns counterclockwise."""
    out: dict[str, float] = {"CA_AIRFRAME": kind, **({"VT_TYPE": 2, "MAV_TYPE": 22} if kind == VTOL else {})}
    out["CA_ROTOR_COUNT"] = len(motors)
    for i, motor in enumerate(motors):
        numbers = {f"P{a}": x for a, x in zip("XYZ", motor.position, strict=True)}
        numbers |= {f"A{a}": x for a, x in zip("XYZ", motor.axis, strict=True)}
        numbers["KM"] = motor.torque_ratio * (1.0 if motor.spin == "ccw" else -1.0)
        out |= {f"CA_ROTOR{i}_{end}": round(x, 5) + 0.0 for end, x in numbers.items()}
    if surfaces:
        out["CA_SV_CS_COUNT"] = len(surfaces)
    for i, surface in enumerate(surfaces):
        out[f"CA_SV_CS{i}_TYPE"] = _TYPES[surface.role]
        out |= {
            f"CA_SV_CS{i}_TRQ_{a}": round(x, 3) + 0.0 for a, x in zip("RPY", surface.moments, strict=True)
        }
        out[f"CA_SV_CS{i}_TRIM"] = round(surface.trim, 4) + 0.0
    return out


def hover(curve: ThrustCurve) -> dict[str, float]:
    """Return the thrust curve of the rotors, relative thrust = f u^2 + (1 - f) u, and the thrust of the hover."""
    full, u = curve.linear + curve.square, curve.hover
    return {
        "THR_MDL_FAC": round(min(max(curve.square / full, 0.0), 1.0), 4),
        "MPC_THR_HOVER": round((curve.linear * u + curve.square * u**2) / full, 4),
    }


def cruise(airspeed: float, throttle: float | None) -> dict[str, float]:
    """Return the airspeeds about an equivalent one, m/s, and the throttle of the steady flight."""
    ends = {"TRIM": 1.0, "MIN": SLOWEST, "MAX": FASTEST}
    out = {f"FW_AIRSPD_{end}": round(share * airspeed, 2) for end, share in ends.items()}
    return out if throttle is None else out | {"FW_THR_TRIM": round(throttle, 3)}
