"""The model of those who flew: coefficients and residuals as they published them, and their formulas.

All is from https://github.com/altlnt/id_mod_helice (MIT): blade-element and momentum theory of axial flight for the
thrust, a force in the plane of the disc, drag of the body. Speeds of rotation are taken from the pulses alone, at 16.8 V,
at once.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of, to_body
from stoop.base.units import FACTORS
from stoop.base.variables import EULER
from stoop.errors import StoopError
from stoop.flight import Flight

TABLE: Final = "authors_identified_acc_FFFFF.csv"
MASS: Final = 1.895  #: kg
RADIUS: Final = 0.11  #: m
AREA: Final = math.pi * RADIUS**2
DENSITY: Final = 1.204  #: kg/m3
FULL: Final = 16.8 * 800.0 * FACTORS["rpm"]  #: rad/s at 1950 us
IDLE, RANGE = 1075.0, 875.0  #: us
ROTORS: Final = 6


@dataclass(frozen=True)
class Blades:
    """Their coefficients of one rotor and of the body; what is not theirs is zero."""

    ct1: float
    ct2: float
    ch1: float
    ch2: float
    di: float = 0.0
    dj: float = 0.0
    dk: float = 0.0

    def drawn(self, U: FloatArray, climb: FloatArray) -> FloatArray:
        """Return the induced velocity, m/s, of axial flight, for a tip speed U and a climb, m/s."""
        half = 0.5 * U * self.ct2
        root = np.sqrt((climb - half) ** 2 + 2.0 * self.ct1 * U**2)
        return np.asarray(0.5 * (root - climb - half))

    def thrust(self, U: FloatArray, climb: FloatArray) -> FloatArray:
        """Return the thrust of a rotor, N."""
        through = climb + self.drawn(U, climb)
        return np.asarray(DENSITY * AREA * U * (self.ct1 * U - self.ct2 * through))

    def drag(self, U: FloatArray, climb: FloatArray) -> FloatArray:
        """Return the force in the plane of the disc, N per m/s.

        Their program adds ch2 in one place and takes it off in another; only the latter gives a drag of the size of
        what they, and we, find (0.28 per second at hover).
        """
        return np.asarray(DENSITY * AREA * (self.ch1 * U - self.ch2 * (climb + self.drawn(U, climb))))

    def hovering(self) -> float:
        """Return the tip speed at which six rotors carry the weight, m/s."""
        from scipy.optimize import brentq

        still = np.zeros(1)
        share = MASS * 9.81 / ROTORS
        return float(brentq(lambda U: float(self.thrust(np.array([U]), still)[0]) - share, 1.0, 300.0))


@dataclass(frozen=True)
class Published:
    """What their table holds."""

    blades: Blades
    residuals: Mapping[str, float]


def published(folder: Path) -> Published:
    """Read their table.

    Raises
    ------
    StoopError
        It is not there or says something else.
    """
    path = folder / TABLE
    try:
        with path.open(newline="", encoding="utf-8") as file:
            row = next(csv.DictReader(file))
        numbers = {n: float(row[n]) for n in ("ct1", "ct2", "ch1", "ch2", "di", "dj", "dk")}
        residuals = {f"a{axis}": float(row[f"score_{axis}"]) for axis in "xyz"}
    except (OSError, StopIteration, KeyError, ValueError, UnicodeDecodeError):
        raise StoopError(
            f"hexacopter: {path}: the authors' table cannot be read; fetch altlnt-hexacopter-px4 anew"
        ) from None
    return Published(Blades(**numbers), residuals)


def specific_force(flight: Flight, blades: Blades) -> FloatArray:
    """Return the specific force (n, 3) that their model gives on the flight's grid, m/s2; NaN in holes."""
    ground, angles = (np.column_stack([flight.column(c) for c in n]) for n in (("vn", "ve", "vd"), EULER))
    u, v, w = to_body(quaternions_of(angles), ground).T
    tips = [(flight.column(f"pwm_{i}") - IDLE) / RANGE * FULL * RADIUS for i in range(1, ROTORS + 1)]
    lift = np.sum([blades.thrust(U, -w) for U in tips], axis=0)
    drag = np.sum([blades.drag(U, -w) for U in tips], axis=0)
    body = DENSITY * AREA * np.sqrt(u**2 + v**2 + w**2)
    x, y = -(drag + body * blades.di) * u, -(drag + body * blades.dj) * v
    return np.column_stack([x, y, -lift - body * blades.dk * w]) / MASS
