"""A flight as the log of an autopilot: PX4's ULog, ArduPilot's DataFlash, the micro-SD deck of a Crazyflie.

Each writer returns the bytes of the log and the mapping that belongs beside it, empty where the ready mapping reads all.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.base.units import DEGREE, MICROSECOND
from stoop.exporters.log_bytes import Event, Table, Topic, crazyflie_bytes, dataflash_bytes, ulog
from stoop.exporters.log_layout import Columns, LogLayout, MappingFile, travel
from stoop.flight import VARIABLES, Flight
from stoop.flight.conversion import SURFACES
from stoop.flight.mapping import ready


def _array(name: str, size: int) -> tuple[str, ...]:
    return tuple(f"{name}[{i}]" for i in range(size))


DEBUG_ARRAY: Final = "debug_array"  #: for what PX4 has no topic of its own
ARRAYS: Final = {
    "vehicle_attitude": _array("q", 4),
    "vehicle_angular_velocity": _array("xyz", 3),
    "sensor_combined": (*_array("gyro_rad", 3), *_array("accelerometer_m_s2", 3)),
    "vehicle_torque_setpoint": _array("xyz", 3),
    "vehicle_thrust_setpoint": _array("xyz", 3),
    "actuator_motors": _array("control", 12),
    "actuator_servos": _array("control", 8),
    "actuator_outputs": _array("output", 16),
    DEBUG_ARRAY: _array("data", 58),
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
ZERO: Final = frozenset(
    {"actuator_outputs", DEBUG_ARRAY}
)  #: topics in which zero, not NaN, stands for nothing


def px4_log(flight: Flight) -> tuple[bytes, str]:
    """Return a ULog and its mapping.

    Deflections go to the servos, as normalized commands; V to the validated airspeed; what else PX4 has no topic for to
    its array for debugging.
    """
    log, mapping = LogLayout.of(flight, ready("px4"), {**ARRAYS, **SINGLE}), MappingFile("px4")
    streams, unmapped = log.streams, log.unmapped
    if "V" in unmapped and "airspeed_validated" not in streams:
        streams["airspeed_validated"] = {"true_airspeed_m_s": unmapped.pop("V")}
        mapping.add("V", "true_airspeed_m_s", "m/s", "airspeed_validated")
    servos, commanded = ARRAYS["actuator_servos"], streams.get("actuator_servos", {})
    free = [column for column in servos if column not in commanded]
    for surface, column in zip([n for n in SURFACES if n in unmapped], free, strict=False):
        full = travel(unmapped[surface])
        streams.setdefault("actuator_servos", commanded)[column] = unmapped.pop(surface) / full
        mapping.calibrate(surface, f"servo_{servos.index(column) + 1}", -1.0, 1.0, full)
    for place, (name, x) in enumerate(unmapped.items()):
        column = ARRAYS[DEBUG_ARRAY][place]
        streams.setdefault(DEBUG_ARRAY, {})[column] = x
        mapping.add(name, column, VARIABLES[name].unit, DEBUG_ARRAY)
    topics = [_topic(name, flight.time, columns) for name, columns in streams.items()]
    texts = [(float(flight.time[0]), "INFO", f"stoop: {found}") for found in flight.notices]
    return ulog(topics, info={"sys_name": "PX4", "ver_sw": "simulated by stoop"}, texts=texts), mapping.text()


def _topic(name: str, time: npt.NDArray[np.float64], columns: Columns) -> Topic:
    """Return a topic with whole arrays, in the types that PX4 gives them."""
    nothing = np.full(time.size, 0.0 if name in ZERO else np.nan)
    written = ARRAYS[name] if name in ARRAYS else [column for column in SINGLE[name] if column in columns]
    typed: dict[str, npt.NDArray[Any]] = {
        column: columns.get(column, nothing).astype(bool if column.endswith("_valid") else np.float32)
        for column in written
    }
    stamp = {"timestamp_sample": np.rint(time / MICROSECOND).astype(np.uint64)} if name in STAMPED else {}
    return Topic(name, time, {**stamp, **typed})


@dataclass(frozen=True)
class Message:
    """Columns of an ArduPilot message that stoop fills.

    Attributes
    ----------
    columns : beside TimeUS and the number of the instance
    unit, letter, multiplier : of all of them, as ArduPilot's log structures have them
    instance : name of the column that holds it, which is always the first; empty where there is none
    whole : columns without values are written too, as zeros
    """

    columns: tuple[str, ...]
    unit: str
    letter: str = "f"
    multiplier: str = "0"
    instance: str = ""
    whole: bool = False

    def table(self, name: str, time: npt.NDArray[np.uint64], columns: Columns) -> Table:
        """Return the message with its layout."""
        nothing = np.zeros(time.size)
        kept = [i for i, column in enumerate(self.columns) if self.whole or column in columns]
        values: dict[str, npt.NDArray[Any]] = {"TimeUS": time}
        values |= {self.instance: nothing} if self.instance else {}
        values |= {self.columns[i]: columns.get(self.columns[i], nothing) for i in kept}
        one = bool(self.instance)
        return Table(
            name,
            ",".join(values),
            "Q" + "B" * one + self.letter * len(kept),
            "s" + "#" * one + "".join(self.unit[i] for i in kept),
            "F" + "-" * one + self.multiplier * len(kept),
            values,
        )


_OUTPUTS: Final = tuple(f"C{i}" for i in range(1, 15))
MESSAGES: Final[Mapping[str, Message]] = {
    "ATT": Message(("Roll", "Pitch", "Yaw"), "ddh"),
    "IMU": Message(("GyrX", "GyrY", "GyrZ", "AccX", "AccY", "AccZ"), "EEEooo", instance="I"),
    "XKF1": Message(("VN", "VE", "VD", "PN", "PE", "PD"), "nnnmmm", instance="C"),
    "XKF2": Message(("VWN", "VWE"), "nn", instance="C"),
    "POS": Message(("Alt",), "m"),
    "ARSP": Message(("Airspeed",), "n", instance="I"),
    "AOA": Message(("AOA", "SSA"), "dd"),
    "BARO": Message(("Press",), "P", instance="I"),
    "BAT": Message(("Volt", "Curr"), "vA", instance="Inst"),
    "AETR": Message(("Ail", "Elev", "Rudd", "Thr"), "----"),
    "RCOU": Message(_OUTPUTS, "Y" * 14, "H", "-", whole=True),
    "RCO2": Message(("C15", "C16"), "YY", "H", "-", whole=True),
}
NEUTRAL: Final = 1500.0  #: us, of a servo's pulse
HALF: Final = 500.0  #: us, to either side
IDLE: Final = 1000.0  #: us, of a motor's pulse
SPAN: Final = 1000.0  #: us, to full
PER_MESSAGE: Final = 3  #: variables in a message of our own: their names share 64 letters


def ardupilot_log(flight: Flight) -> tuple[bytes, str]:
    """Return a DataFlash log and its mapping.

    Motors and surfaces become pulses, which ArduPilot logs in whole microseconds; a vane becomes AOA, V the airspeed; what
    else ArduPilot has no message for stands in messages SM00, SM01, ... of its own, as scripts of users write them.
    """
    columns = {name: m.columns for name, m in MESSAGES.items()}
    log, mapping = LogLayout.of(flight, ready("ardupilot"), columns), MappingFile("ardupilot")
    streams, unmapped = log.streams, log.unmapped
    for name in ("airspeed_pitot", "V"):
        if name in unmapped and "ARSP" not in streams:
            streams["ARSP"] = {"Airspeed": unmapped.pop(name)}
            mapping.add(name, "Airspeed", "m/s", "ARSP")
    if {"alpha", "beta"} <= unmapped.keys():
        streams["AOA"] = {"AOA": unmapped.pop("alpha") / DEGREE, "SSA": unmapped.pop("beta") / DEGREE}
        mapping.add("alpha", "AOA", "deg", "AOA")
        mapping.add("beta", "SSA", "deg", "AOA")
    _add_pulses(streams, unmapped, mapping)
    if "ATT" in streams:
        streams["ATT"]["Yaw"] %= 360.0
    time = np.rint(flight.time / MICROSECOND).astype(np.uint64)
    tables = [MESSAGES[name].table(name, time, own) for name, own in streams.items()]
    names = list(unmapped)
    for k in range(0, len(names), PER_MESSAGE):
        part, stream = names[k : k + PER_MESSAGE], f"SM{k // PER_MESSAGE:02d}"
        for name in part:
            mapping.add(name, name[:16], VARIABLES[name].unit, stream)
        message = Message(tuple(part), "-" * len(part))
        tables.append(message.table(stream, time, {name: unmapped[name] for name in part}))
    texts = [f"stoop: {found}"[:64] for found in flight.notices]
    return dataflash_bytes(tables, messages=texts), mapping.text()


def _add_pulses(streams: dict[str, Columns], unmapped: Columns, mapping: MappingFile) -> None:
    """Send motors, servos and surfaces to the outputs that are free, in their order."""
    pulses = streams.get("RCOU", {})
    free = [column for column in _OUTPUTS if column not in pulses]
    motors, servos = ([n for n in unmapped if n.startswith(kind)] for kind in ("motor_", "servo_"))
    surfaces = [n for n in SURFACES if n in unmapped]
    for name, column in zip([*motors, *servos, *surfaces], free, strict=False):
        x = unmapped.pop(name)
        table = streams.setdefault("RCOU", pulses)
        if name in surfaces:
            full = travel(x)
            table[column] = NEUTRAL + HALF * x / full
            mapping.calibrate(name, f"pwm_{column[1:]}", NEUTRAL - HALF, NEUTRAL + HALF, full)
            continue
        span, zero = (SPAN, IDLE) if name in motors else (HALF, NEUTRAL)
        table[column] = zero + span * x
        mapping.add(name, column, "1", "RCOU", f", scale = {1.0 / span:g}, offset = {-zero / span:g}")


FIXED_FREQUENCY: Final = "fixedFrequency"  #: event of a Crazyflie's log at a fixed rate
CRAZYFLIE_VARIABLES: Final = frozenset(
    {
        *(f"stateEstimate.{x}" for x in ("x", "y", "z", "vx", "vy", "vz", "qx", "qy", "qz", "qw")),
        *(f"{group}.{axis}" for group in ("gyro", "acc") for axis in "xyz"),
        *(f"{group}.m{i}" for group in ("motor", "rpm") for i in range(1, 5)),
        "pm.vbat",
        "baro.pressure",
    }
)
OWN_GROUP: Final = "sim"  #: of what the firmware has no variable for
COMMAND: Final = np.iinfo(np.uint16)


def crazyflie_log(flight: Flight) -> tuple[bytes, str]:
    """Return a micro-SD log and its mapping.

    Motor commands have 16 bits. What the firmware has no variable for, such as a fifth motor, stands in a group of its own.
    """
    log = LogLayout.of(flight, ready("crazyflie"), {"": CRAZYFLIE_VARIABLES})
    mapping, columns = MappingFile("crazyflie"), dict[str, npt.NDArray[Any]]()
    for name, x in sorted(log.streams.get("", {}).items()):
        whole = name.startswith("motor.")
        columns[name] = (
            np.rint(np.clip(x, COMMAND.min, COMMAND.max)).astype(np.uint16) if whole else x.astype(np.float32)
        )
    for name, x in log.unmapped.items():
        columns[f"{OWN_GROUP}.{name}"] = x.astype(np.float32)
        mapping.add(name, f"{OWN_GROUP}.{name}", VARIABLES[name].unit)
    return crazyflie_bytes({FIXED_FREQUENCY: Event(1, flight.time, columns)}), mapping.text()
