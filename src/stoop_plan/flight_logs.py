"""A flight as a file: stoop's own, the log of an autopilot, or a table, with a mapping beside it where one is needed.

Each writer returns the bytes of the file and the mapping that belongs beside it, empty where the ready mapping reads all.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from stoop import Flight, save_flight
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import OutputError
from stoop.extend.files import write_files
from stoop.extend.flights import FlightMapping
from stoop.extend.recordings import mapping_beside
from stoop.extend.variables import FAMILIES, VARIABLES
from stoop.extend.verbs import install
from stoop_plan.blackbox_flight import betaflight_log
from stoop_plan.log_bytes import MICROSECOND, Event, Table, Topic, crazyflie_bytes, dataflash_bytes, ulog
from stoop_plan.log_columns import Columns, MappingFile, lay_out

SURFACES: Final = ("elevator", "aileron", "rudder", "flap", "throttle")  #: that a calibration leads to
OWN: Final = ".nc"
CLOCK: Final = "t"  #: name of the column of time of a table, s
MAX_CLOCK: Final = 2**63 * MICROSECOND  #: s
Writer: TypeAlias = Callable[[Flight], tuple[bytes, str]]


def check_ending(target: Path) -> None:
    """Refuse a name by which the file could not be read again: OutputError with the endings that there are."""
    if target.suffix.lower() not in ENDINGS:
        endings = f"{', '.join(ENDINGS[:-1])} or {ENDINGS[-1]}"
        raise OutputError(f"{target}: no kind of flight file; end its name in {endings}")


def save_flight_as(flight: Flight, target: Path) -> Path | None:
    """Write a flight in the form that the ending of the file names.

    Parameters
    ----------
    flight : whose channels share one clock
    target : ends in one of `ENDINGS`

    Returns
    -------
    Path or None : the mapping that was written beside it

    Raises
    ------
    OutputError
        When it cannot be written.
    """
    check_ending(target)
    if target.suffix.lower() == OWN:
        save_flight(flight, target)
        return None
    ending, time = target.suffix.lower(), flight.time
    if ending not in TABLES and time.size and not (time[0] >= 0.0 and time[-1] < MAX_CLOCK):
        raise OutputError(
            f"{target}: autopilot logs count microseconds from zero, and this clock runs from {time[0]:g} s to "
            f"{time[-1]:g} s; end the name in {OWN} or {', '.join(TABLES)}"
        )
    content, mapping = WRITERS[ending](flight)
    place = mapping_beside(target)
    beside = {place.name: mapping} if mapping else {}
    if not target.parent.is_dir():
        raise OutputError(f"{target}: there is no folder {target.parent}; make it first, or choose another")
    write_files(target.parent, {target.name: content, **beside}, () if mapping else [place.name])
    return place if mapping else None


def travel(x: FloatArray) -> float:
    """Return the travel of a surface to either side: 0.5 rad as usual, or as far as it went."""
    most = float(np.nanmax(np.abs(x), initial=0.0))
    return min(max(0.5, math.ceil(10.0 * most) / 10.0), 0.5 * math.pi)


def _elements(name: str, size: int) -> tuple[str, ...]:
    return tuple(f"{name}[{i}]" for i in range(size))


DEBUG_ARRAY: Final = "debug_array"  #: for what PX4 has no topic of its own
ARRAYS: Final = {
    "vehicle_attitude": _elements("q", 4),
    "vehicle_angular_velocity": _elements("xyz", 3),
    "sensor_combined": (*_elements("gyro_rad", 3), *_elements("accelerometer_m_s2", 3)),
    "vehicle_torque_setpoint": _elements("xyz", 3),
    "vehicle_thrust_setpoint": _elements("xyz", 3),
    "actuator_motors": _elements("control", 12),
    "actuator_servos": _elements("control", 8),
    "actuator_outputs": _elements("output", 16),
    DEBUG_ARRAY: _elements("data", 58),
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
ZERO: Final = frozenset({"actuator_outputs", DEBUG_ARRAY})  #: topics in which zero, not NaN, means no value


def px4_log(
    flight: Flight, serial: str = "", software: str = "simulated by stoop", zero: float | None = None
) -> tuple[bytes, str]:
    """Return a ULog and its mapping.

    Deflections go to the servos, as normalized commands; V to the validated airspeed; what else PX4 has no topic for to
    its array for debugging. The serial number of the autopilot, its software, and when its clock was zero, s since 1970, which a
    receiver tells every second, stand in it where they are known.
    """
    (streams, unmapped), time = lay_out(flight, FlightMapping.ready("px4"), {**ARRAYS, **SINGLE}), flight.time
    mapping = MappingFile("px4")
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
    topics = []
    for name, columns in streams.items():  # in the types that PX4 gives them
        nothing = np.full(time.size, 0.0 if name in ZERO else np.nan)
        written = ARRAYS[name] if name in ARRAYS else [column for column in SINGLE[name] if column in columns]
        typed: dict[str, npt.NDArray[Any]] = {}
        if name in STAMPED:
            typed["timestamp_sample"] = np.rint(time / MICROSECOND).astype(np.uint64)
        for column in written:
            kind = bool if column.endswith("_valid") else np.float32
            typed[column] = columns.get(column, nothing).astype(kind)
        kept = _with_readings(columns)
        topics.append(Topic(name, time[kept], {column: x[kept] for column, x in typed.items()}))
    texts = [(float(time[0]), "INFO", f"stoop: {found}") for found in flight.notices]
    if zero is not None:
        second = time[:: max(1, round(flight.rate))]
        utc = {"time_utc_usec": np.rint((zero + second) / MICROSECOND).astype(np.uint64)}
        topics.append(Topic("vehicle_gps_position", second, utc))
    info = {"sys_name": "PX4", "ver_sw": software} | ({"sys_uuid": serial} if serial else {})
    return ulog(topics, flight.parameters, info, texts), mapping.text()


def _with_readings(columns: Columns) -> npt.NDArray[np.bool_]:
    """Return which rows (n,) hold a reading: a row in which nothing was read, flags aside, is not logged."""
    readings = [np.isfinite(x) for name, x in columns.items() if not name.endswith("_valid")]
    return np.asarray(np.any(readings, axis=0))


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
        letters = "Q" + "B" * one + self.letter * len(kept)
        units = "s" + "#" * one + "".join(self.unit[i] for i in kept)
        multipliers = "F" + "-" * one + self.multiplier * len(kept)
        return Table(name, ",".join(values), letters, units, multipliers, values)


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


def ardupilot_log(flight: Flight) -> tuple[bytes, str]:
    """Return a DataFlash log and its mapping.

    Motors and surfaces become pulses, which ArduPilot logs in whole microseconds; a vane becomes AOA, V the airspeed; what
    else ArduPilot has no message for stands in messages SM00, SM01, ... of its own, as scripts of users write them.
    """
    columns = {name: m.columns for name, m in MESSAGES.items()}
    streams, unmapped = lay_out(flight, FlightMapping.ready("ardupilot"), columns)
    mapping = MappingFile("ardupilot")
    for name in ("airspeed_pitot", "V"):
        if name in unmapped and "ARSP" not in streams:
            streams["ARSP"] = {"Airspeed": unmapped.pop(name)}
            mapping.add(name, "Airspeed", "m/s", "ARSP")
    if {"alpha", "beta"} <= unmapped.keys():
        streams["AOA"] = {"AOA": np.degrees(unmapped.pop("alpha")), "SSA": np.degrees(unmapped.pop("beta"))}
        mapping.add("alpha", "AOA", "deg", "AOA")
        mapping.add("beta", "SSA", "deg", "AOA")
    _add_pulses(streams, unmapped, mapping)
    if "ATT" in streams:
        streams["ATT"]["Yaw"] %= 360.0
    time = np.rint(flight.time / MICROSECOND).astype(np.uint64)
    tables = []
    for name, own in streams.items():
        kept = _with_readings(own)
        tables.append(MESSAGES[name].table(name, time[kept], {c: x[kept] for c, x in own.items()}))
    names = list(unmapped)
    for k in range(0, len(names), 3):  # the names of the columns of a message share 64 letters
        part, stream = names[k : k + 3], f"SM{k // 3:02d}"
        for name in part:
            mapping.add(name, name[:16], VARIABLES[name].unit, stream)
        message = Message(tuple(part), "-" * len(part))
        tables.append(message.table(stream, time, {name: unmapped[name] for name in part}))
    texts = [f"stoop: {found}"[:64] for found in flight.notices]
    return dataflash_bytes(tables, flight.parameters, texts), mapping.text()


def _add_pulses(streams: dict[str, Columns], unmapped: Columns, mapping: MappingFile) -> None:
    """Send motors (1000 to 2000 us), servos and surfaces (1500 us -+ 500 us) to the free outputs, in their order."""
    pulses = streams.get("RCOU", {})
    free = [column for column in _OUTPUTS if column not in pulses]
    motors, servos = ([n for n in unmapped if n.startswith(kind)] for kind in ("motor_", "servo_"))
    surfaces = [n for n in SURFACES if n in unmapped]
    for name, column in zip([*motors, *servos, *surfaces], free, strict=False):
        x = unmapped.pop(name)
        table = streams.setdefault("RCOU", pulses)
        if name in surfaces:
            full = travel(x)
            table[column] = 1500.0 + 500.0 * x / full
            mapping.calibrate(name, f"pwm_{column[1:]}", 1000.0, 2000.0, full)
            continue
        span, zero = (1000.0, 1000.0) if name in motors else (500.0, 1500.0)
        table[column] = zero + span * x
        mapping.add(name, column, "1", "RCOU", f", scale = {1.0 / span:g}, offset = {-zero / span:g}")


CRAZYFLIE_VARIABLES: Final = frozenset(
    {
        *(f"stateEstimate.{x}" for x in ("x", "y", "z", "vx", "vy", "vz", "qx", "qy", "qz", "qw")),
        *(f"{group}.{axis}" for group in ("gyro", "acc") for axis in "xyz"),
        *(f"{group}.m{i}" for group in ("motor", "rpm") for i in range(1, 5)),
        "pm.vbat",
        "baro.pressure",
    }
)


def crazyflie_log(flight: Flight) -> tuple[bytes, str]:
    """Return a micro-SD log and its mapping.

    Motor commands have 16 bits, unless some are missing. What the firmware has no variable for, such as a fifth motor, stands
    in a group "sim".
    """
    streams, unmapped = lay_out(flight, FlightMapping.ready("crazyflie"), {"": CRAZYFLIE_VARIABLES})
    mapping, columns = MappingFile("crazyflie"), dict[str, npt.NDArray[Any]]()
    for name, x in sorted(streams.get("", {}).items()):
        whole = name.startswith("motor.") and bool(np.isfinite(x).all())
        columns[name] = np.rint(np.clip(x, 0, 65535)).astype(np.uint16) if whole else x.astype(np.float32)
    for name, x in unmapped.items():
        columns[f"sim.{name}"] = x.astype(np.float32)
        mapping.add(name, f"sim.{name}", VARIABLES[name].unit)
    return crazyflie_bytes({"fixedFrequency": Event(1, flight.time, columns)}), mapping.text()


def csv_table(flight: Flight) -> tuple[bytes, str]:
    """Return a table of text, and the mapping that names its columns."""
    columns, mapping = _table(flight)
    lines, rows = io.StringIO(), np.column_stack([*columns.values()])
    # a clock that counts from 1970 needs more digits than a sensor has
    formats = ["%.16g", *["%.9g"] * (len(columns) - 1)]
    np.savetxt(lines, rows, fmt=formats, delimiter=",", header=",".join(columns), comments="")
    return lines.getvalue().encode(), mapping


def matlab_table(flight: Flight) -> tuple[bytes, str]:
    """Return a .mat file of version 5 with one structure, and the mapping that names its fields."""
    from scipy.io import savemat

    (columns, mapping), content = _table(flight), io.BytesIO()
    savemat(content, {"flight": columns}, oned_as="column")  # type: ignore[arg-type]  # it takes any binary file
    return content.getvalue(), mapping


def parquet_table(flight: Flight) -> tuple[bytes, str]:
    """Return a Parquet file, and the mapping that names its columns; OutputError without pyarrow."""
    try:
        import pyarrow as pa
        from pyarrow import parquet
    except ImportError:
        message = f"Parquet is written by pyarrow, which is not installed: {install('parquet')}"
        raise OutputError(message) from None
    (columns, mapping), content = _table(flight), io.BytesIO()
    parquet.write_table(pa.table(columns), content)
    return content.getvalue(), mapping


def _table(flight: Flight) -> tuple[Columns, str]:
    """Return time and variables by stoop's names and units, the attitude as angles where there are any; and the mapping."""
    names = list(flight.channels)
    angles = set(FAMILIES["euler"]) <= set(names)
    kept = [name for name in names if not (angles and name in FAMILIES["quaternion"])]
    mapping = MappingFile(clock=CLOCK)
    for name in kept:
        mapping.add(name, name, VARIABLES[name].unit)
    return {CLOCK: flight.time, **{name: flight.column(name) for name in kept}}, mapping.text()


TABLES: Final[dict[str, Writer]] = {".csv": csv_table, ".mat": matlab_table, ".parquet": parquet_table}
WRITERS: Final[dict[str, Writer]] = {
    ".ulg": px4_log, ".bin": ardupilot_log, ".usd": crazyflie_log, ".bbl": betaflight_log, **TABLES,
}  # fmt: skip  #: ending -> log and mapping
ENDINGS: Final = (OWN, *WRITERS)
