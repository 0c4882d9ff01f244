"""A flight as ArduPilot would have written it: messages with their formats, units and multipliers."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.base.units import DEGREE, MICROSECOND
from stoop.export.beside import Beside, surfaces, travel
from stoop.export.inverse import Columns, lay_out
from stoop.flight import VARIABLES, Flight
from stoop.flight.mapping import ready
from stoop.logs.dataflash_write import Table, dataflash_bytes


@dataclass(frozen=True)
class Message:
    """Columns that stoop fills of a message.

    Attributes
    ----------
    columns : beside TimeUS and the number of the instance
    letter, unit, multiplier : of all of them, as ArduPilot's log structures have them
    instance : name of the column that holds it, which is always the first; empty where there is none
    whole : columns without values are written too, as zeros
    """

    columns: tuple[str, ...]
    unit: str
    letter: str = "f"
    multiplier: str = "0"
    instance: str = ""
    whole: bool = False


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
FURTHER: Final = 3  #: variables in a message of our own: their names share 64 letters


def ardupilot_log(flight: Flight) -> tuple[bytes, str]:
    """Return a DataFlash log and the mapping that belongs beside it, empty where ArduPilot's own reads all.

    Motors and surfaces become pulses, which ArduPilot logs in whole microseconds; a vane becomes AOA, V the airspeed; what
    else ArduPilot has no message for stands in messages SM00, SM01, ... of its own, as scripts of users write them.
    """
    laid = lay_out(flight, ready("ardupilot"), {name: m.columns for name, m in MESSAGES.items()})
    beside = Beside("ardupilot")
    _measure_air(laid.streams, laid.left, beside)
    _drive(laid.streams, laid.left, beside)
    if "ATT" in laid.streams:
        laid.streams["ATT"]["Yaw"] %= 360.0
    further = list(_further(laid.left, beside))
    time = np.rint(flight.time / MICROSECOND).astype(np.uint64)
    tables = [_table(name, MESSAGES[name], time, columns) for name, columns in laid.streams.items()]
    tables += [_table(name, message, time, columns) for name, message, columns in further]
    said = [f"stoop: {found}"[:64] for found in flight.notices]
    return dataflash_bytes(tables, messages=said), beside.text()


def _measure_air(streams: dict[str, Columns], left: Columns, beside: Beside) -> None:
    for name in ("airspeed_pitot", "V"):
        if name in left and "ARSP" not in streams:
            streams["ARSP"] = {"Airspeed": left.pop(name)}
            beside.name(name, "Airspeed", "m/s", "ARSP")
    if {"alpha", "beta"} <= left.keys():
        streams["AOA"] = {"AOA": left.pop("alpha") / DEGREE, "SSA": left.pop("beta") / DEGREE}
        beside.name("alpha", "AOA", "deg", "AOA")
        beside.name("beta", "SSA", "deg", "AOA")


def _drive(streams: dict[str, Columns], left: Columns, beside: Beside) -> None:
    """Send motors and surfaces to the outputs that are free, in their order."""
    pulses = streams.get("RCOU", {})
    free = [column for column in _OUTPUTS if column not in pulses]
    motors, servos = ([n for n in left if n.startswith(kind)] for kind in ("motor_", "servo_"))
    for name, column in zip([*motors, *servos, *surfaces(left)], free, strict=False):
        x = left.pop(name)
        table = streams.setdefault("RCOU", pulses)
        if name in motors:
            table[column] = IDLE + SPAN * x
            beside.name(name, column, "1", "RCOU", _scaled(SPAN, IDLE))
        elif name in servos:
            table[column] = NEUTRAL + HALF * x
            beside.name(name, column, "1", "RCOU", _scaled(HALF, NEUTRAL))
        else:
            full = travel(x)
            table[column] = NEUTRAL + HALF * x / full
            beside.calibrate(name, f"pwm_{column[1:]}", NEUTRAL - HALF, NEUTRAL + HALF, full)


def _scaled(span: float, zero: float) -> str:
    """Return the keys that turn a pulse into a command of 0 at `zero` and 1 at `zero` + `span`."""
    return f", scale = {1.0 / span:g}, offset = {-zero / span:g}"


def _further(left: Columns, beside: Beside) -> Iterator[tuple[str, Message, Columns]]:
    names = list(left)
    for k in range(0, len(names), FURTHER):
        part, stream = names[k : k + FURTHER], f"SM{k // FURTHER:02d}"
        for name in part:
            beside.name(name, name[:16], VARIABLES[name].unit, stream)
        yield stream, Message(tuple(part), "-" * len(part)), {name: left[name] for name in part}


def _table(name: str, message: Message, time: npt.NDArray[np.uint64], columns: Columns) -> Table:
    """Return a message with its layout."""
    nothing = np.zeros(time.size)
    kept = [i for i, column in enumerate(message.columns) if message.whole or column in columns]
    values: dict[str, npt.NDArray[Any]] = {"TimeUS": time}
    values |= {message.instance: nothing} if message.instance else {}
    values |= {message.columns[i]: columns.get(message.columns[i], nothing) for i in kept}
    one = bool(message.instance)
    return Table(
        name,
        ",".join(values),
        "Q" + "B" * one + message.letter * len(kept),
        "s" + "#" * one + "".join(message.unit[i] for i in kept),
        "F" + "-" * one + message.multiplier * len(kept),
        values,
    )
