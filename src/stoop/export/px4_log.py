"""A flight as PX4's logger would have written it: topics by PX4's names, in its units and axes."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.base.units import MICROSECOND
from stoop.export.beside import Beside, surfaces, travel
from stoop.export.inverse import Columns, lay_out
from stoop.flight import VARIABLES, Flight
from stoop.flight.mapping import ready
from stoop.logs.ulog_write import Topic, ulog


def _array(name: str, size: int) -> tuple[str, ...]:
    return tuple(f"{name}[{i}]" for i in range(size))


FURTHER: Final = "debug_array"  #: for what PX4 has no topic of its own
ARRAYS: Final = {
    "vehicle_attitude": _array("q", 4),
    "vehicle_angular_velocity": _array("xyz", 3),
    "sensor_combined": (*_array("gyro_rad", 3), *_array("accelerometer_m_s2", 3)),
    "vehicle_torque_setpoint": _array("xyz", 3),
    "vehicle_thrust_setpoint": _array("xyz", 3),
    "actuator_motors": _array("control", 12),
    "actuator_servos": _array("control", 8),
    "actuator_outputs": _array("output", 16),
    FURTHER: _array("data", 58),
}  #: topics with arrays, which are written whole
SINGLE: Final = {
    "vehicle_local_position": ("x", "y", "z", "vx", "vy", "vz", "ref_alt",
                               "xy_valid", "z_valid", "v_xy_valid", "v_z_valid"),
    "airspeed_validated": ("true_airspeed_m_s",),
    "vehicle_air_data": ("rho", "baro_pressure_pa", "ambient_temperature", "baro_alt_meter"),
    "battery_status": ("voltage_v", "current_a"),
    "wind": ("windspeed_north", "windspeed_east", "variance_north"),
}  # fmt: skip
STAMPED: Final = frozenset({"vehicle_attitude", "vehicle_angular_velocity", "vehicle_local_position"})
ZERO: Final = frozenset({"actuator_outputs", FURTHER})  #: topics in which zero, not NaN, stands for nothing


def px4_log(flight: Flight) -> tuple[bytes, str]:
    """Return a ULog and the mapping that belongs beside it, empty where PX4's own reads all.

    Deflections go to the servos, as normalized commands; V to the validated airspeed; what else PX4 has no topic for to
    its array for debugging.
    """
    laid = lay_out(flight, ready("px4"), {**ARRAYS, **SINGLE})
    beside = Beside("px4")
    if "V" in laid.left and "airspeed_validated" not in laid.streams:
        laid.streams["airspeed_validated"] = {"true_airspeed_m_s": laid.left.pop("V")}
        beside.name("V", "true_airspeed_m_s", "m/s", "airspeed_validated")
    _move_servos(laid.streams, laid.left, beside)
    _keep_further(laid.streams, laid.left, beside)
    topics = [_topic(name, flight.time, columns) for name, columns in laid.streams.items()]
    texts = [(float(flight.time[0]), "INFO", f"stoop: {found}") for found in flight.notices]
    return ulog(topics, info={"sys_name": "PX4", "ver_sw": "simulated by stoop"}, texts=texts), beside.text()


def _move_servos(streams: dict[str, Columns], left: Columns, beside: Beside) -> None:
    """Command the servos of the surfaces, behind those that are commanded already."""
    servos = ARRAYS["actuator_servos"]
    table = streams.get("actuator_servos", {})
    free = [column for column in servos if column not in table]
    for name, column in zip(surfaces(left), free, strict=False):
        full = travel(left[name])
        streams.setdefault("actuator_servos", table)[column] = left.pop(name) / full
        beside.calibrate(name, f"servo_{servos.index(column) + 1}", -1.0, 1.0, full)


def _keep_further(streams: dict[str, Columns], left: Columns, beside: Beside) -> None:
    for place, name in enumerate(left):
        column = ARRAYS[FURTHER][place]
        streams.setdefault(FURTHER, {})[column] = left[name]
        beside.name(name, column, VARIABLES[name].unit, FURTHER)


def _topic(name: str, time: npt.NDArray[np.float64], columns: Columns) -> Topic:
    """Return a topic with its arrays whole, in the types that PX4 gives them."""
    nothing = np.full(time.size, 0.0 if name in ZERO else np.nan)
    whole = {column: columns.get(column, nothing) for column in _sorted(name, columns)}
    typed: dict[str, npt.NDArray[Any]] = {
        column: x.astype(bool if column.endswith("_valid") else np.float32) for column, x in whole.items()
    }
    stamp = {"timestamp_sample": np.rint(time / MICROSECOND).astype(np.uint64)} if name in STAMPED else {}
    return Topic(name, time, {**stamp, **typed})


def _sorted(name: str, columns: Iterable[str]) -> tuple[str, ...]:
    if name in ARRAYS:
        return ARRAYS[name]
    there = set(columns)
    return tuple(column for column in SINGLE[name] if column in there)
