"""The CrazyPAD flights by name: airframe, what was done to it, and what its rotors were commanded."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from importlib.resources import files
from pathlib import Path
from typing import Final

from stoop.errors import StoopError
from stoop.estimate.effectiveness import Balance, Hover, hover
from stoop.flight import load
from stoop.vehicle import parse_vehicle

FOLDER: Final = "crazypad-propeller-damage"
WHOLE: Final = 47  #: mm, length of an uncut propeller
LEAST_NORMAL: Final = 2
_NAME: Final = re.compile(
    r"(?:(?P<normal>normal_flight)|cut_propeller_M3_\dmm_\dmm_(?P<cut>\d\d)mm|add_weight_(?P<weight>W\d)_near_M3)"
    r"__(?P<airframe>E\d+)_log(?P<log>\d\d)"
)


@dataclass(frozen=True)
class Flown:
    """One flight and the truth about it.

    Attributes
    ----------
    airframe : str
    length : int
        Of the propeller M3, mm.
    weight : str
        Name of the weight taped near M3; empty without any.
    log : str
    hover : Hover
    """

    airframe: str
    length: int
    weight: str
    log: str
    hover: Hover

    @property
    def healthy(self) -> bool:
        """Whether nothing was done to it."""
        return self.length == WHOLE and not self.weight

    @property
    def condition(self) -> str:
        """What was done to it."""
        return f"weight {self.weight}" if self.weight else "normal" if self.healthy else f"{self.length} mm"


def balance() -> Balance:
    """Return the rotors of the Crazyflie."""
    text = files("stoop_studies.verify.propellers").joinpath("crazyflie.toml").read_text(encoding="utf-8")
    return Balance(parse_vehicle(text, "crazyflie.toml"))


def read_flights(folder: Path | None) -> tuple[Flown, ...]:
    """Read all flights in a folder, or in its folder ``crazypad-propeller-damage``.

    Raises
    ------
    StoopError
        There are none, or one cannot be read.
    """
    rotors = balance()
    flights = tuple(_flown(path, parts, rotors) for path, parts in _named(folder))
    for airframe in sorted({f.airframe for f in flights}):
        if sum(f.airframe == airframe and f.healthy for f in flights) < LEAST_NORMAL:
            raise StoopError(
                f"propellers: {folder}: {airframe} has fewer than {LEAST_NORMAL} normal flights to compare with; fetch all"
            )
    return flights


def _named(folder: Path | None) -> Sequence[tuple[Path, re.Match[str]]]:
    places = [] if folder is None else [folder, folder / FOLDER]
    found = [
        [(path, parts) for path in sorted(place.glob("*.usd")) if (parts := _NAME.fullmatch(path.stem))]
        for place in places
    ]
    best = max(found, key=len, default=[])
    if not best:
        where = "no folder is named" if folder is None else f"{folder}: holds none of its flights"
        raise StoopError(
            f"propellers: {where}; give --data DIR with flights of https://github.com/AerialRoboticsUUST/CrazyPAD "
            "(data/motor_data, '/' in a path become '__')"
        )
    return best


def _flown(path: Path, parts: re.Match[str], rotors: Balance) -> Flown:
    length = int(parts["cut"] or WHOLE)
    return Flown(parts["airframe"], length, parts["weight"] or "", parts["log"], hover(load(path), rotors))
