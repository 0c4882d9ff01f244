"""A flight as the micro-SD deck of a Crazyflie would have written it: variables of its log, in its units and axes."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop.export.beside import Beside
from stoop.export.inverse import lay_out
from stoop.flight import VARIABLES, Flight
from stoop.flight.mapping import ready
from stoop.logs.crazyflie_write import Event, crazyflie_bytes

EVENT: Final = "fixedFrequency"  #: as the firmware calls what it logs at a fixed rate
_XYZ: Final = "xyz"
VARIABLE_NAMES: Final = frozenset(
    {
        *(f"stateEstimate.{x}" for x in ("x", "y", "z", "vx", "vy", "vz", "qx", "qy", "qz", "qw")),
        *(f"{group}.{axis}" for group in ("gyro", "acc") for axis in _XYZ),
        *(f"motor.m{i}" for i in range(1, 5)),
        *(f"rpm.m{i}" for i in range(1, 5)),
        "pm.vbat",
        "baro.pressure",
    }
)
FURTHER: Final = "sim"  #: group of what the firmware has no variable for
COMMAND: Final = np.iinfo(np.uint16)


def crazyflie_log(flight: Flight) -> tuple[bytes, str]:
    """Return a micro-SD log and the mapping that belongs beside it, empty where that for Crazyflies reads all.

    Motor commands have 16 bits. What the firmware has no variable for, such as a fifth motor, stands in a group of its own.
    """
    laid = lay_out(flight, ready("crazyflie"), {"": VARIABLE_NAMES})
    columns = {name: _typed(name, x) for name, x in sorted(laid.streams.get("", {}).items())}
    beside = Beside("crazyflie")
    for name, x in laid.left.items():
        columns[f"{FURTHER}.{name}"] = x.astype(np.float32)
        beside.name(name, f"{FURTHER}.{name}", VARIABLES[name].unit)
    return crazyflie_bytes({EVENT: Event(1, flight.time, columns)}), beside.text()


def _typed(name: str, x: npt.NDArray[np.float64]) -> npt.NDArray[Any]:
    if name.startswith("motor."):
        return np.rint(np.clip(x, COMMAND.min, COMMAND.max)).astype(np.uint16)
    return x.astype(np.float32)
