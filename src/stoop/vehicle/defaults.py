"""Defaults of a vehicle file: the aerodynamic terms of eq. (1), and units, bounds and freedom of its numbers.

The 32 terms are those of the PS-GDE paper, which prints the coefficient of roll rate in the side force as ``C_Qw``; the
symmetric reading is ``CQp``. Their bounds cover conventional airplanes from a hand-launched model to a light aircraft.
Bounds of a rotor's coefficients scale with the thrust that carries the vehicle and the command x at hover.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Final

from stoop.vehicle import terms
from stoop.vehicle.schema import WIND, Quantity, Term

SHORTEST_LAG: Final = 0.02  #: s, that is integrated as it is, see `stoop.vehicle.symbolic.forces.lagged`
COEFFICIENTS: Final = ("CL", "CD", "CQ", "Cl", "Cm", "Cn")
EQUATION_1: Final[dict[str, dict[str, tuple[str, float, float]]]] = {
    "CD": {
        "CD0": ("1", 0.0, 0.5), "CDalpha": ("alpha", -1.0, 3.0), "CDalpha2": ("alpha^2", -2.0, 8.0),
        "CDV": ("V", -0.5, 0.5),
    },
    "CL": {
        "CL0": ("1", -1.0, 2.0), "CLalpha": ("alpha", 0.5, 10.0), "CLq": ("q", -20.0, 60.0), "CLV": ("V", -2.0, 2.0),
        "CLelevator": ("elevator", -2.0, 3.0),
    },
    "Cm": {
        "Cm0": ("1", -1.0, 1.0), "Cmalpha": ("alpha", -8.0, 2.0), "Cmq": ("q", -150.0, 0.0), "CmV": ("V", -1.0, 1.0),
        "Cmelevator": ("elevator", -5.0, 5.0),
    },
    "CQ": {
        "CQ0": ("1", -0.2, 0.2), "CQbeta": ("beta", -3.0, 1.0), "CQp": ("p", -2.0, 2.0), "CQr": ("r", -2.0, 3.0),
        "CQrudder": ("rudder", -1.0, 1.0), "CQV": ("V", -0.5, 0.5),
    },
    "Cl": {
        "Cl0": ("1", -0.1, 0.1), "Clbeta": ("beta", -0.6, 0.4), "Clp": ("p", -2.5, 0.0), "Clr": ("r", -1.0, 1.5),
        "Claileron": ("aileron", -1.0, 1.0), "Clrudder": ("rudder", -0.3, 0.3),
    },
    "Cn": {
        "Cn0": ("1", -0.1, 0.1), "Cnbeta": ("beta", -0.4, 0.6), "Cnp": ("p", -0.8, 0.6), "Cnr": ("r", -1.5, 0.3),
        "Cnaileron": ("aileron", -0.3, 0.3), "Cnrudder": ("rudder", -0.6, 0.6),
    },
}  # fmt: skip
"""Coefficient -> parameter -> (term, lower bound, upper bound)."""
#: moment coefficient -> reference length, and body axis
MOMENT_ARMS: Final = {"Cl": ("span", "x"), "Cm": ("chord", "y"), "Cn": ("span", "z")}
WIND_NUMBERS: Final = tuple(f"sensors.{c}.bias" for c in WIND)  #: the steady wind, m/s north, east, down
_GROUND_EFFECTS: Final = ("ground_effect.rotor", "ground_effect.lift")
#: numbers that are positive in every vehicle, as are rate limits of servos
POSITIVE: Final = (
    "mass.mass", "mass.inertia.xx", "mass.inertia.yy", "mass.inertia.zz", "reference.area", "reference.chord",
    "reference.span", "reference.airspeed", "environment.gravity", "environment.density",
    *(f"reference.inertia.{axis}" for axis in "xyz"),
    "propulsion.diameter", "propulsion.speed_gain", "ground_effect.radius",
    *(f"turbulence.{axis}.{number}" for axis in "uvw" for number in ("intensity", "length")),
    "rotors.gain", "rotors.nominal_voltage", "rotors.inertia", "rotors.radius", "turbulence.airspeed",
)  # fmt: skip
_UNITS: Final = {
    "mass": "kg", **dict.fromkeys(("xx", "yy", "zz", "xz", "xy", "yz", "inertia"), "kg m2"),
    "area": "m2", **dict.fromkeys(("chord", "span", "diameter", "length", "radius", "torque_ratio"), "m"),
    **dict.fromkeys(("center_of_gravity", "moment_point", "position", "accelerometer_position", "vane_position"), "m"),
    "airspeed": "m/s", "intensity": "m/s", "alpha": "rad", "offset": "rad", "pitch": "rad", "gravity": "m/s2",
    "density": "kg/m3", "thrust": "N", "lag": "s", "delay": "s", "speed_gain": "rev/s per unit",
    "rate_limit": "rad/s", "dead_zone": "rad", "imu_alignment": "rad", "wind_error": "m/s",
    "nominal_voltage": "V", "linear": "N s/m", "quadratic": "N s2/m2", "rotation": "N m s",
    "T0": "N", "Q0": "N m", "translational": "N s2/m2", "drag_inflow": "N s2/m2",
}  # fmt: skip
_DRIVE_UNITS: Final = {
    "T1": ("N", "N s/rad"), "T2": ("N", "N s2/rad2"), "inflow": ("N s/m", "N s2/(m rad)"),
    "drag": ("N s/m", "N s2/(m rad)"), "Q1": ("N m", "N m s/rad"), "Q2": ("N m", "N m s2/rad2"),
    "gain": ("1", "rad/s per unit"),
}  # fmt: skip
"""Where x of a rotor is a command, and where it is a speed."""
_PLAIN_COEFFICIENTS: Final = ("T0", "Q0", "translational", "drag_inflow", "torque_ratio")
ROTOR_AERODYNAMICS: Final = frozenset(f"rotors.{c}" for c in {*_PLAIN_COEFFICIENTS, *_DRIVE_UNITS} - {"gain"})
_CHANNEL_UNITS: Final = {
    **dict.fromkeys(("V", "vn", "ve", "vd"), "m/s"), **dict.fromkeys(("p", "q", "r"), "rad/s"),
    **dict.fromkeys(("ax", "ay", "az"), "m/s2"),
}  # fmt: skip


def _last(name: str) -> str:
    """Return the last part of a name that is no axis."""
    parts = name.split(".")
    return parts[-2] if parts[-1] in ("x", "y", "z") and len(parts) > 1 else parts[-1]


def unit(name: str, quantity: Quantity, controls: Collection[str], drive: str) -> str:
    """Return the unit of a number; `drive` is that of the rotors."""
    if isinstance(quantity, Term):
        return terms.unit(quantity.term, controls)
    table, _, last = name.rpartition(".")
    if last == "bias":
        return _CHANNEL_UNITS.get(_last(table), "rad")
    if table.endswith(".mix"):
        return "rad per unit"
    kind = _last(name)
    return _DRIVE_UNITS[kind][drive == "speed"] if kind in _DRIVE_UNITS else _UNITS.get(kind, "1")


def free_by_default(name: str, quantity: Quantity, estimated: Collection[str]) -> bool:
    """Return whether a number is estimated where the file does not say it: loads are, and what has a prior.

    `estimated` are the terms that the kept equations identify.
    """
    if isinstance(quantity, Term):
        return name in estimated
    loads = name in ROTOR_AERODYNAMICS or name in _GROUND_EFFECTS or name.startswith("body_drag.")
    return loads or quantity.prior is not None


def bounds(numbers: Mapping[str, Quantity]) -> dict[str, tuple[float, float]]:
    """Return the bounds of each number of a file that is not tied: its own, or defaults of its kind."""
    sizes, out = _rotor_sizes(numbers), {}
    for name, q in numbers.items():
        if q.tie is None:
            low, high = q.bounds or _default_bounds(name, q, sizes)
            out[name] = q.bounds or (min(max(low, physical_limit(name, q.value)), q.value), high)
    return out


def wider_bounds(name: str, value: float, box: tuple[float, float], estimate: float) -> tuple[float, float]:
    """Return a box that is twice as wide beyond the bound at which an estimate lies, as far as physics allows."""
    low, high = box
    if estimate - low > high - estimate:
        return low, 2.0 * high - low
    return max(2.0 * low - high, min(physical_limit(name, value), low)), high


def physical_limit(name: str, value: float) -> float:
    """Return below which no default bound of a number lies: what is positive stays so."""
    kind = _last(name)
    if name in POSITIVE or kind in (*_POSITIVE, "rate_limit"):
        return 0.1 * value if value > 0.0 else -math.inf
    return 0.0 if kind in ("lag", "CD0", "CT0", "dead_zone", "scale") and value >= 0.0 else -math.inf


def _default_bounds(name: str, q: Quantity, sizes: Mapping[str, float]) -> tuple[float, float]:
    value = q.value
    if isinstance(q, Term):
        for group in EQUATION_1.values():
            if name in group:
                _, low, high = group[name]
                return min(low, value - abs(value)), max(high, value + abs(value))
        reach = max(1.0, 5.0 * abs(value), 5.0 * (q.prior or 0.0))
        return -reach, reach
    if name.startswith(("rotors.", "rotor.", "body_drag.")) and (box := _rotor_bounds(name, q, sizes)):
        return box
    if q.prior is not None:
        return q.prior_mean - 5.0 * q.prior, q.prior_mean + 5.0 * q.prior
    if name.startswith("controls.") and _last(name) in ("rate_limit", "dead_zone"):
        return (0.2 * value, 5.0 * value) if _last(name) == "rate_limit" else (0.0, max(0.1, 3.0 * value))
    if name in _GROUND_EFFECTS:
        return min(-1.0, 2.0 * value), max(4.0, 2.0 * value)
    low, high = sorted((0.5 * value, 1.5 * value))
    return low, high


_POSITIVE: Final = ("T2", "Q2", "torque_ratio", "gain", "inertia", "radius", "factor", "torque_factor")
_REACH: Final = {
    "T0": (-1.0, 1.0), "T1": (-1.0, 3.0), "T2": (0.02, 4.0), "Q0": (-1.0, 1.0), "Q1": (-1.0, 3.0), "Q2": (0.002, 4.0),
}  # fmt: skip
"""Lower and upper bound in the sizes of :func:`_rotor_sizes`; (-0.25, 1) of all others."""
_FIXED_BOUNDS: Final = {"torque_ratio": (0.0005, 0.2), "factor": (0.2, 1.5), "torque_factor": (0.2, 1.5)}


def _rotor_bounds(name: str, q: Quantity, sizes: Mapping[str, float]) -> tuple[float, float] | None:
    """Return the bounds of a number of rotors or body drag; None where they are those of any number."""
    kind, value = _last(name), q.value
    key = f"rotation.{name[-1]}" if kind == "rotation" else kind
    if q.prior is not None:
        low, high = (q.prior_mean + sign * 5.0 * q.prior for sign in (-1.0, 1.0))
        return (max(low, 0.02 * q.prior_mean) if kind in _POSITIVE else low), high
    if key in sizes:
        low, high = (sizes[key] * r for r in _REACH.get(kind, (-0.25, 1.0)))
    elif kind in _FIXED_BOUNDS:
        low, high = _FIXED_BOUNDS[kind]
    elif kind in ("lag", "inertia", "gain", "radius") and value > 0.0:
        return 0.2 * value, 4.0 * value
    elif kind == "delay":
        return 0.0, max(0.1, 3.0 * value)
    elif kind == "position":
        return value - 0.05 - 0.5 * abs(value), value + 0.05 + 0.5 * abs(value)
    elif kind == "axis":
        return value - 0.3, value + 0.3
    else:
        return None
    least = 0.1 * value if kind in _POSITIVE and value > 0.0 else value - abs(value)
    return min(low, least), max(high, value + abs(value))


def _rotor_sizes(numbers: Mapping[str, Quantity]) -> dict[str, float]:
    """Return the size of each coefficient if it alone gave the thrust, the torque or the drag."""
    largest = 1e9  # so that no bound overflows
    thrust = min(share_of_weight(numbers), largest)
    x = hover_command(numbers, thrust) or 0.5 * abs(_value(numbers, "rotors.gain", 1.0)) or 0.5
    x = min(max(x, 1.0 / largest), largest)
    lever = 0.05  # m: torque over thrust of small propellers is 0.01 to 0.03
    weight = thrust * sum(name.startswith("rotor.") and name.endswith(".position.x") for name in numbers)
    moments = {a: _value(numbers, f"mass.inertia.{a}{a}", 0.01) for a in "xyz"}
    return {
        "T0": thrust, "T1": thrust / x, "T2": thrust / x**2, "inflow": thrust / (5.0 * x), "drag": thrust / (10.0 * x),
        "translational": thrust / 100.0, "drag_inflow": thrust / 100.0,
        "Q0": lever * thrust, "Q1": lever * thrust / x, "Q2": lever * thrust / x**2,
        "linear": weight / 10.0, "quadratic": weight / 50.0,
        **{f"rotation.{a}": 20.0 * moment for a, moment in moments.items()},
    }  # fmt: skip


def rotor_size(kind: str, numbers: Mapping[str, Quantity]) -> float:
    """Return the size of a load of rotors or body if it alone gave the thrust, the torque or the drag."""
    return 0.05 if kind == "torque_ratio" else _rotor_sizes(numbers)[kind]


def full_command(channel: str) -> float | None:
    """Return the value of a rotor's channel at full command; None where its name does not imply one."""
    full = {"motor_": 1.0, "servo_": 1.0, "control_": 1.0, "pwm_": 2000.0}
    return next((value for head, value in full.items() if channel.startswith(head)), None)


def thrust_at(numbers: Mapping[str, Quantity], x: float) -> float:
    """Return the thrust of one rotor in still air at sea level, N."""
    t0, t1, t2 = (_value(numbers, f"rotors.T{i}") for i in range(3))
    return t0 + t1 * x + t2 * x * x


def hover_command(numbers: Mapping[str, Quantity], thrust: float) -> float | None:
    """Return the x > 0 at which a rotor gives a thrust, N; None where it never does."""
    t0, t1, t2 = (_value(numbers, f"rotors.T{i}") for i in range(3))
    missing = thrust - t0
    if t2 <= 0.0:
        return missing / t1 if t1 > 0.0 and missing > 0.0 else None
    root = (math.sqrt(max(t1 * t1 + 4.0 * t2 * missing, 0.0)) - t1) / (2.0 * t2)
    return root if 0.0 < root < math.inf else None


def share_of_weight(numbers: Mapping[str, Quantity]) -> float:
    """Return the weight that one rotor carries if all carry the same, N."""
    weight = _value(numbers, "mass.mass", 1.0) * _value(numbers, "environment.gravity", 9.80665)
    count = sum(name.startswith("rotor.") and name.endswith(".position.x") for name in numbers)
    return abs(weight) / max(count, 1) or 1.0


def _value(numbers: Mapping[str, Quantity], name: str, default: float = 0.0) -> float:
    q = numbers.get(name)
    if q is not None and q.tie is not None:
        q = numbers.get(q.tie)
    return default if q is None or q.tie is not None else q.value
