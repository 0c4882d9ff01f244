"""The log of the hexacopter, the model of those who flew it, and what is fitted to it.

The authors' coefficients, residuals and formulas are those of https://github.com/altlnt/id_mod_helice (MIT): blade-element
and momentum theory of axial flight for the thrust, a force in the plane of the disc, drag of the body. Their speeds of
rotation are taken from the pulses alone, at 16.8 V, at once.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from importlib.resources import as_file, files
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of, to_body
from stoop.base.units import FACTORS
from stoop.base.variables import EULER, SPECIFIC_FORCE, VELOCITY
from stoop.errors import StoopError
from stoop.estimate import methods
from stoop.estimate.fit import Fit, Options
from stoop.estimate.predict import (
    ForceCurves,
    ForceResiduals,
    ReferenceModels,
    force_curves,
    identified_vehicle,
    low_passed,
    mean_biases,
)
from stoop.flight import Flight, load
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle, parse_vehicle
from stoop_studies.verify.experiment import vehicle_text

FOLDER: Final = "altlnt-hexacopter-px4"
MAPPING: Final = ("stoop_studies.problems", "hexacopter_mapping.toml")  #: package and file
Span = tuple[float, float]  #: start and stop, s
LEARNED: Final = (140.0, 214.0)  #: s: hover, two climbs of 6 m/s, slow descents
SPRINTS: Final = (214.0, 260.0)  #: s: forth and back at 10 m/s
WHOLE: Final = (140.0, 281.0)  #: s, all that was in the air
METHOD: Final = "equation-error"
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
    """The authors' coefficients of one rotor and of the body; what is not theirs is zero."""

    ct1: float
    ct2: float
    ch1: float
    ch2: float
    di: float = 0.0
    dj: float = 0.0
    dk: float = 0.0

    def inflow(self, U: FloatArray, climb: FloatArray) -> FloatArray:
        """Return climb and induced velocity of axial flight, m/s, for a tip speed U and a climb, m/s."""
        half = 0.5 * U * self.ct2
        root = np.sqrt((climb - half) ** 2 + 2.0 * self.ct1 * U**2)
        return np.asarray(climb + 0.5 * (root - climb - half))

    def thrust(self, U: FloatArray, climb: FloatArray) -> FloatArray:
        """Return the thrust of a rotor, N."""
        return np.asarray(DENSITY * AREA * U * (self.ct1 * U - self.ct2 * self.inflow(U, climb)))

    def drag(self, U: FloatArray, climb: FloatArray) -> FloatArray:
        """Return the force in the plane of the disc, N per m/s.

        Their program adds ch2 in one place and takes it off in another; only the latter gives a drag of the size of
        what they, and we, find (0.28 per second at hover).
        """
        return np.asarray(DENSITY * AREA * (self.ch1 * U - self.ch2 * self.inflow(U, climb)))

    def hover_speed(self) -> float:
        """Return the tip speed at which six rotors carry the weight, m/s."""
        from scipy.optimize import brentq

        still = np.zeros(1)
        share = MASS * 9.81 / ROTORS
        return float(brentq(lambda U: float(self.thrust(np.array([U]), still)[0]) - share, 1.0, 300.0))

    def specific_force(self, flight: Flight) -> FloatArray:
        """Return the specific force (n, 3) on the flight's grid, m/s2; NaN in holes."""
        ground, angles = (np.column_stack([flight.column(c) for c in names]) for names in (VELOCITY, EULER))
        u, v, w = to_body(quaternions_of(angles), ground).T
        tips = [(flight.column(f"pwm_{i}") - IDLE) / RANGE * FULL * RADIUS for i in range(1, ROTORS + 1)]
        lift = np.sum([self.thrust(U, -w) for U in tips], axis=0)
        drag = np.sum([self.drag(U, -w) for U in tips], axis=0)
        body = DENSITY * AREA * np.sqrt(u**2 + v**2 + w**2)
        x, y = -(drag + body * self.di) * u, -(drag + body * self.dj) * v
        return np.column_stack([x, y, -lift - body * self.dk * w]) / MASS


@dataclass(frozen=True, eq=False)
class Log:
    """The flight, and the coefficients and residuals that its authors published."""

    flight: Flight
    blades: Blades
    published: Mapping[str, float]

    @property
    def flights(self) -> Mapping[str, Flight]:
        """The flight by its name."""
        return {self.flight.name: self.flight}

    def window(self, span: Span) -> Window:
        """Return a window of it."""
        return Window(self.flight.name, *span)


def vehicle(text: tuple[str, str] = ("", "")) -> Vehicle:
    """Return the vehicle file, with a text in it replaced by another."""
    return parse_vehicle(vehicle_text("hexacopter").replace(*text), "hexacopter.toml")


def read_log(folder: Path | None, mapped: bool = True) -> Log:
    """Read the log in a folder, or in its folder ``altlnt-hexacopter-px4``.

    Parameters
    ----------
    folder : Path, optional
    mapped : bool
        By the mapping that brings the attitude to the clock of the gyros; else as PX4 logs are read.

    Raises
    ------
    StoopError
        It is not there, or cannot be read.
    """
    places = [] if folder is None else [folder, folder / FOLDER]
    place = next((p for p in places if any(p.glob("log_18_*_sensor_combined_0.csv*"))), None)
    if place is None:
        where = "no folder is named" if folder is None else f"{folder}: holds no flight of the hexacopter"
        raise StoopError(f"hexacopter: {where}; name the folder of {FOLDER} by --data DIR")
    package, file = MAPPING
    with as_file(files(package).joinpath(file)) as mapping:
        flight = load(place, mapping if mapped else None)
    return Log(flight, *published(place))


def published(folder: Path) -> tuple[Blades, dict[str, float]]:
    """Read the authors' table: coefficients, and residuals by axis.

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
        return Blades(**numbers), {f"a{axis}": float(row[f"score_{axis}"]) for axis in "xyz"}
    except (OSError, StopIteration, KeyError, ValueError, UnicodeDecodeError):
        raise StoopError(
            f"hexacopter: {path}: the authors' table cannot be read; fetch altlnt-hexacopter-px4 anew"
        ) from None


@dataclass(frozen=True, eq=False)
class Fitted:
    """One fit of the hexacopter.

    Attributes
    ----------
    log : Log
    fit : Fit
    span : start and stop of what was fitted, s
    """

    log: Log
    fit: Fit
    span: Span

    @cached_property
    def vehicle(self) -> Vehicle:
        """With its estimates."""
        return identified_vehicle(self.fit)

    def value(self, name: str) -> float:
        """Return a number of the vehicle, SI."""
        return float(self.vehicle.value(name))

    def error(self, name: str) -> float:
        """Return the standard error of an estimate; zero of what was fixed."""
        names = [p.name for p in self.fit.problem.layout.parameters]
        if name not in names or self.fit.covariance is None:
            return 0.0
        i = names.index(name)
        return float(np.sqrt(self.fit.covariance[i, i]))

    def curves(self, span: Span) -> ForceCurves:
        """Return measured and modelled specific force below 5 Hz."""
        biases = mean_biases(self.fit, self.log.flight.name)
        return force_curves(self.vehicle, self.log.flights, self.log.window(span), biases)

    def residuals(self, span: Span) -> Mapping[str, ForceResiduals]:
        """Return the residuals in a window by axis: model, constant, static thrust."""
        return ReferenceModels.of([self.curves(self.span)]).residuals(self.curves(span))

    def authors_residuals(self, span: Span) -> dict[str, float]:
        """Return those of the authors' model; a constant per axis is learned from what was fitted, as ours is."""
        force = self.log.blades.specific_force(self.log.flight)
        learned, off = (
            c.measured - self._low_passed(force, c.time) for c in map(self.curves, (self.span, span))
        )
        rms = np.sqrt(np.mean((off - learned.mean(axis=0)) ** 2, axis=0))
        return dict(zip(SPECIFIC_FORCE, rms.tolist(), strict=True))

    def _low_passed(self, force: FloatArray, time: FloatArray) -> FloatArray:
        """Return rows (n, 3) at given times, low-passed as the measurements are."""
        flight = self.log.flight
        dt = 1.0 / flight.rate
        rows = force[np.round((time - flight.time[0]) / dt).astype(int)]
        cuts = np.flatnonzero(np.diff(time) > 1.5 * dt) + 1
        return np.concatenate([low_passed(part, dt) for part in np.split(np.nan_to_num(rows), cuts)])


def fitted(log: Log, span: Span, own: Vehicle | None = None) -> Fitted:
    """Fit one window by equation error; the vehicle is the file's when absent."""
    own, options = own or vehicle(), Options(method=METHOD)
    fit = methods.find(METHOD).fitter()(own, log.flights, (log.window(span),), options, None, None)
    return Fitted(log, fit, span)
