"""Numbers of rotors and body drag: units, which are free unless the file says otherwise, where to look for them.

A coefficient of thrust has a size that depends on the vehicle: the thrust that carries it and the command x at which
it hovers. Without bounds in the file the search looks around that size.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Final

from stoop.vehicle.quantity import Quantity

PLACES: Final = ("rotors.", "rotor.", "body_drag.")
AERODYNAMIC: Final = frozenset(
    f"rotors.{name}"
    for name in (
        "T0", "T1", "T2", "inflow", "translational", "drag", "drag_inflow", "Q0", "Q1", "Q2", "torque_ratio",
    )
)  # fmt: skip
"""Coefficients of what the air does to rotors."""
#: units where x is a command, and where it is a speed
_COEFFICIENTS: Final = {
    "T0": ("N", "N"), "T1": ("N", "N s/rad"), "T2": ("N", "N s2/rad2"), "inflow": ("N s/m", "N s2/(m rad)"),
    "drag": ("N s/m", "N s2/(m rad)"), "translational": ("N s2/m2", "N s2/m2"), "Q0": ("N m", "N m"),
    "drag_inflow": ("N s2/m2", "N s2/m2"),
    "Q1": ("N m", "N m s/rad"), "Q2": ("N m", "N m s2/rad2"), "gain": ("1", "rad/s per unit"),
}  # fmt: skip
_PLAIN: Final = {
    "nominal_voltage": "V", "lag": "s", "delay": "s", "torque_ratio": "m", "inertia": "kg m2", "radius": "m",
    "linear": "N s/m", "quadratic": "N s2/m2", "rotation": "N m s", "position": "m",
}  # fmt: skip
FULL: Final = {
    "motor_": 1.0,
    "servo_": 1.0,
    "control_": 1.0,
    "pwm_": 2000.0,
}  #: of a rotor's channel, by how its name begins
_LARGEST: Final = 1e9  #: that a size is taken to be, so that no box overflows
_POSITIVE: Final = ("T2", "Q2", "torque_ratio", "lag", "gain", "inertia", "radius", "factor", "torque_factor")


def full_command(channel: str) -> float | None:
    """Return the value of a channel at full command; None where its name does not say."""
    return next((value for head, value in FULL.items() if channel.startswith(head)), None)


def free_by_default(name: str) -> bool:
    """Tell whether a number is estimated unless the file says otherwise: what the air does, not the geometry."""
    return name in AERODYNAMIC or name.startswith("body_drag.")


def unit(name: str, drive: str) -> str:
    """Return the unit of a number whose name begins with one of :data:`PLACES`."""
    parts = name.split(".")
    last = parts[-1] if parts[-1] not in ("x", "y", "z") else parts[-2]
    if last in _COEFFICIENTS:
        return _COEFFICIENTS[last][drive == "speed"]
    return _PLAIN.get(last, "1")


def boxes(numbers: Mapping[str, Quantity]) -> dict[str, tuple[float, float]]:
    """Return where to look for each number of rotors and body drag whose file gives no bounds."""
    sizes = _sizes(numbers)
    names = [n for n, q in numbers.items() if n.startswith(PLACES) and q.tie is None and q.bounds is None]
    found = {n: _box(n, numbers[n], sizes) for n in names}
    return {n: box for n, box in found.items() if box is not None}


def _value(numbers: Mapping[str, Quantity], name: str, default: float = 0.0) -> float:
    q = numbers.get(name)
    if q is not None and q.tie is not None:
        q = numbers.get(q.tie)
    return default if q is None or q.tie is not None else q.value


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
    count = sum(name.endswith(".position.x") and name.startswith("rotor.") for name in numbers)
    weight = _value(numbers, "mass.mass", 1.0) * _value(numbers, "environment.gravity", 9.80665)
    return abs(weight) / max(count, 1) or 1.0


def _sizes(numbers: Mapping[str, Quantity]) -> dict[str, float]:
    """Return what a coefficient of each name would be if it were all of the thrust, torque or drag."""
    thrust = min(share_of_weight(numbers), _LARGEST)
    x = hover_command(numbers, thrust) or 0.5 * abs(_value(numbers, "rotors.gain", 1.0)) or 0.5
    x = min(max(x, 1.0 / _LARGEST), _LARGEST)
    lever = 0.05  # m: torque over thrust of small propellers is 0.01 to 0.03
    count = sum(name.endswith(".position.x") and name.startswith("rotor.") for name in numbers)
    weight = thrust * count
    turning = {
        a: _value(numbers, f"mass.inertia.{i}", 0.01) for a, i in zip("xyz", ("xx", "yy", "zz"), strict=True)
    }
    return {
        "T0": thrust, "T1": thrust / x, "T2": thrust / x**2, "inflow": thrust / (5.0 * x), "drag": thrust / (10.0 * x),
        "translational": thrust / 100.0, "drag_inflow": thrust / 100.0,
        "Q0": lever * thrust, "Q1": lever * thrust / x, "Q2": lever * thrust / x**2,
        "linear": weight / 10.0, "quadratic": weight / 50.0,
        **{f"rotation.{a}": 20.0 * moment for a, moment in turning.items()},
    }  # fmt: skip


#: low and high, in the sizes above
_REACH: Final = {
    "T0": (-1.0, 1.0), "T1": (-1.0, 3.0), "T2": (0.02, 4.0), "Q0": (-1.0, 1.0), "Q1": (-1.0, 3.0), "Q2": (0.002, 4.0),
}  # fmt: skip
_FIXED: Final = {"torque_ratio": (0.0005, 0.2), "factor": (0.2, 1.5), "torque_factor": (0.2, 1.5)}


def _box(name: str, q: Quantity, sizes: Mapping[str, float]) -> tuple[float, float] | None:
    parts = name.split(".")
    last = parts[-1] if parts[-1] not in ("x", "y", "z") else parts[-2]
    key = f"rotation.{parts[-1]}" if last == "rotation" else last
    value = q.value
    if q.prior is not None:
        low = value - 5.0 * q.prior
        return (max(low, 0.02 * value) if last in _POSITIVE else low), value + 5.0 * q.prior
    if key in sizes:
        low, high = (sizes[key] * r for r in _REACH.get(last, (-0.25, 1.0)))
    elif last in _FIXED:
        low, high = _FIXED[last]
    elif last in ("lag", "inertia", "gain", "radius") and value > 0.0:
        return 0.2 * value, 4.0 * value
    elif last == "delay":
        return 0.0, max(0.1, 3.0 * value)
    elif last == "position":
        return value - 0.05 - 0.5 * abs(value), value + 0.05 + 0.5 * abs(value)
    elif last == "axis":
        return value - 0.3, value + 0.3
    else:
        return None
    least = 0.1 * value if last in _POSITIVE and value > 0.0 else value - abs(value)
    return min(low, least), max(high, value + abs(value))
