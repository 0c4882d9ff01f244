"""Which vehicles are exported, and what they fly: from a steady flight, thirty seconds, open loop."""

from __future__ import annotations

from collections.abc import Callable
from importlib.resources import files
from typing import Any, Final

from stoop.export.excitation import AMPLITUDE, RATE, every_control
from stoop.simulate import Maneuver, Trim
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import builtin_vehicle

DURATION: Final = 30.0  #: s
FILES: Final = {"v-tail": "v_tail.toml", "flying-wing": "flying_wing.toml", "crooked": "crooked.toml"}
VEHICLES: Final = ("twin-boom", *FILES)


def load(name: str) -> Vehicle:
    """Return a vehicle of the experiment."""
    if name not in FILES:
        return builtin_vehicle(name)
    return parse_vehicle((files(__package__) / FILES[name]).read_text(encoding="utf-8"), name)


def _maneuver(point: Trim, moves: list[dict[str, Any]]) -> Maneuver:
    start = {"airspeed": point.start["V"], "altitude": point.start["h"]}
    return Maneuver.model_validate({"duration": DURATION, "rate": RATE, **start, "input": moves})


def multisines(vehicle: Vehicle, point: Trim) -> Maneuver:
    """Return harmonics from 0.1 to 2 Hz on all controls at once, each control its own."""
    count = len(vehicle.controls)
    common = {"shape": "multisine", "start": 1.0, "duration": 20.0, "amplitude": AMPLITUDE, "band": 2.0}
    moves = [
        {**common, "control": c, "first": 2 + i, "stride": count} for i, c in enumerate(vehicle.controls)
    ]
    return _maneuver(point, moves)


def pulses(vehicle: Vehicle, point: Trim) -> Maneuver:
    """Return a second and a half on each control, after which the aircraft is left to itself."""
    common = {"shape": "pulse", "duration": 1.5, "amplitude": AMPLITUDE}
    moves = [{**common, "control": c, "start": 1.0 + 3.0 * i} for i, c in enumerate(vehicle.controls)]
    return _maneuver(point, moves)


INPUTS: Final[dict[str, Callable[[Vehicle, Trim], Maneuver]]] = {
    "3-2-1-1, doublets": every_control,
    "multisines": multisines,
    "pulses": pulses,
}
