"""The state at the first sample of a piece, from the first 0.2 s of measurements."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, TypeVar

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of, to_body
from stoop.base.variables import EULER, WRAPPED
from stoop.errors import FlightError
from stoop.simulate import START_NAMES
from stoop.vehicle import Vehicle
from stoop.vehicle.schema import WIND

Number = TypeVar("Number", float, FloatArray)
FIRST = 0.2  #: s
NEEDED = {"lateral": ("V", "alpha", "theta")}  #: states that a reduced model holds where they were measured


def state_channels(vehicle: Vehicle) -> tuple[str, ...]:
    """Return the channels that the start of this vehicle's equations is read from."""
    observed = [c for c in vehicle.outputs if c in START_NAMES or c in WIND]
    return (*observed, *(c for c in NEEDED.get(vehicle.reduce, ()) if c not in observed))


def first_complete(readings: Mapping[str, FloatArray]) -> int:
    """Return the first sample at which every channel that was recorded at all has a value."""
    seen = [np.isfinite(values) for values in readings.values() if np.isfinite(values).any()]
    together = np.logical_and.reduce(seen) if seen else np.ones(1, dtype=np.bool_)
    return int(np.argmax(together)) if together.any() else 0


def guess_start(
    vehicle: Vehicle, t: FloatArray, readings: Mapping[str, FloatArray], where: str
) -> tuple[dict[str, float], list[str]]:
    """Guess the state at the first sample from a line through the first 0.2 s of each channel.

    Sensor bias, scale and vane position are undone with the vehicle file's values.

    Parameters
    ----------
    t : (n,), s
    readings : mapping
        Channel of :func:`state_channels` -> (n,), NaN where missing.
    where : str
        The maneuver, for messages.

    Returns
    -------
    start : dict
        By the vehicle's ``start_names``, without the altitude.
    missing : list of str
        Observed channels that were not recorded: their start is a default.
    """
    start = dict.fromkeys((*(WIND if vehicle.hovers else ()), *vehicle.start_names), 0.0)
    if not vehicle.hovers:
        start["V"] = vehicle.value("reference.airspeed")
    missing = []
    for channel in state_channels(vehicle):
        value = _line_at_start(t, readings[channel], channel in WRAPPED)
        if value is not None:
            start[channel] = true_value(vehicle, channel, value)
        elif channel in NEEDED.get(vehicle.reduce, ()):
            raise FlightError(
                f"{where}: '{channel}' was not recorded, and the {vehicle.reduce} model holds it as measured; "
                "choose another window or the full model"
            )
        else:
            missing.append(channel)
    start = through_air(start) if vehicle.hovers else at_center_of_gravity(vehicle, start)
    return start, missing


def through_air(start: Mapping[str, Number]) -> dict[str, Number]:
    """Turn a velocity north, east, down (less the wind) into body axes: ``u``, ``v``, ``w`` for ``vn``, ``ve``, ``vd``.

    Each entry is a number or (n,): one instant, or many.
    """
    ground, angles = (
        np.stack(np.broadcast_arrays(*(start[n] for n in names)), axis=-1)
        for names in (("vn", "ve", "vd"), EULER)
    )
    u, v, w = to_body(quaternions_of(angles), ground).T
    kept: dict[str, Any] = {name: value for name, value in start.items() if name not in WIND}
    return kept | {
        name: value if value.ndim else float(value) for name, value in zip("uvw", (u, v, w), strict=True)
    }


def _line_at_start(t: FloatArray, y: FloatArray, angle: bool) -> float | None:
    seen = np.isfinite(y) & (t <= t[0] + FIRST)
    if not seen.any():
        return None
    early, values = t[seen] - t[0], np.unwrap(y[seen]) if angle else y[seen]
    if seen.sum() < 4:
        return float(values[0])
    return float(np.polyfit(early, values, 1)[1])


def true_value(vehicle: Vehicle, channel: str, reading: Number) -> Number:
    """Undo reading = scale * truth + bias, of one reading or of (n,)."""
    scale = f"sensors.{channel}.scale"
    factor = vehicle.value(scale) if scale in vehicle.rows else 1.0
    return (reading - vehicle.value(f"sensors.{channel}.bias")) / (factor or 1.0)


def at_center_of_gravity(vehicle: Vehicle, start: dict[str, Number]) -> dict[str, Number]:
    """Take the flow angles from the vanes to the center of gravity (first order in rate times arm over V).

    Each entry is a number or (n,): one instant, or many.
    """
    if "sensors.vane_position.x" not in vehicle.rows:
        return start
    x, y, z = (_arm(vehicle, axis) for axis in "xyz")
    p, q, r = start["p"], start["q"], start["r"]
    V: Any = np.maximum(start["V"], 1.0)
    moved = {"alpha": start["alpha"] - (p * y - q * x) / V, "beta": start["beta"] - (r * x - p * z) / V}
    return {**start, **moved}


def _arm(vehicle: Vehicle, axis: str) -> float:
    center = f"mass.center_of_gravity.{axis}"
    origin = vehicle.value(center) if center in vehicle.rows else 0.0
    return vehicle.value(f"sensors.vane_position.{axis}") - origin
