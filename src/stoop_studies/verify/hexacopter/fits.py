"""The log of the hexacopter, and what is fitted to it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from importlib.resources import as_file, files
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.estimate import methods
from stoop.estimate.fit import Fit, Options
from stoop.estimate.forces import Against, Curves, Simple, force_curves, low_passed
from stoop.estimate.predict import identified_vehicle, mean_biases
from stoop.flight import Flight, load
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle, parse_vehicle
from stoop_studies.verify.hexacopter.authors import Blades, Published, published, specific_force

FOLDER: Final = "altlnt-hexacopter-px4"
PACKAGE: Final = "stoop_studies.verify.hexacopter"
MAPPED, MAPPING = "stoop_studies.problems", "hexacopter_mapping.toml"  #: package and file
LEARNED: Final = (140.0, 214.0)  #: s: hover, two climbs of 6 m/s, slow descents
SPRINTS: Final = (214.0, 260.0)  #: s: forth and back at 10 m/s
WHOLE: Final = (140.0, 281.0)  #: s, all that was in the air
METHOD: Final = "equation-error"


@dataclass(frozen=True, eq=False)
class Log:
    """The flight and what its authors found."""

    flight: Flight
    published: Published

    @property
    def known(self) -> Mapping[str, Flight]:
        """The flight by its name."""
        return {self.flight.name: self.flight}

    def window(self, span: tuple[float, float]) -> Window:
        """Return a window of it."""
        return Window(self.flight.name, *span)


def vehicle(text: tuple[str, str] = ("", "")) -> Vehicle:
    """Return the vehicle file, with a text in it replaced by another."""
    whole = files(PACKAGE).joinpath("hexacopter.toml").read_text(encoding="utf-8")
    return parse_vehicle(whole.replace(*text), "hexacopter.toml")


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
    place = _place(folder)
    with as_file(files(MAPPED).joinpath(MAPPING)) as mapping:
        flight = load(place, mapping if mapped else None)
    return Log(flight, published(place))


def _place(folder: Path | None) -> Path:
    for place in [] if folder is None else [folder, folder / FOLDER]:
        if any(place.glob("log_18_*_sensor_combined_0.csv*")):
            return place
    where = "no folder is named" if folder is None else f"{folder}: holds no flight of the hexacopter"
    raise StoopError(f"hexacopter: {where}; name the folder of {FOLDER} by --data DIR")


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
    span: tuple[float, float]

    @property
    def vehicle(self) -> Vehicle:
        """With its estimates."""
        return identified_vehicle(self.fit)

    def value(self, name: str) -> float:
        """Return a number of the vehicle, SI."""
        return float(self.vehicle.value(name))

    def error(self, name: str) -> float:
        """Return the standard error of an estimate; zero of what was held."""
        names = [p.name for p in self.fit.problem.layout.parameters]
        if name not in names or self.fit.covariance is None:
            return 0.0
        i = names.index(name)
        return float(np.sqrt(self.fit.covariance[i, i]))

    def curves(self, span: tuple[float, float]) -> Curves:
        """Return measured and modelled specific force below 5 Hz."""
        biases = mean_biases(self.fit, self.log.flight.name)
        return force_curves(self.vehicle, self.log.known, self.log.window(span), biases)

    def against(self, span: tuple[float, float]) -> Mapping[str, Against]:
        """Return the residuals in a window: model, constant, static thrust."""
        return Simple.of([self.curves(self.span)]).against(self.curves(span))


def fitted(log: Log, span: tuple[float, float], own: Vehicle | None = None) -> Fitted:
    """Fit one window, by equation error.

    Parameters
    ----------
    log : Log
    span : s
    own : Vehicle, optional
        The file's when absent.
    """
    own = vehicle() if own is None else own
    fit = methods.find(METHOD).fitter()(
        own, log.known, (log.window(span),), Options(method=METHOD), None, None
    )
    return Fitted(log, fit, span)


def of_authors(log: Log, blades: Blades, learned: Curves, curves: Curves) -> dict[str, float]:
    """Return the residuals of the authors' model by axis; a constant per axis is learned as ours is.

    Parameters
    ----------
    log : Log
    blades : Blades
    learned, curves : Curves
        Of the window that teaches the constants, and of the one that is judged.
    """
    force = specific_force(log.flight, blades)
    off = [c.measured - _slow(log, force, c.time) for c in (learned, curves)]
    rms = np.sqrt(np.mean((off[1] - off[0].mean(axis=0)) ** 2, axis=0))
    return dict(zip(("ax", "ay", "az"), rms.tolist(), strict=True))


def _slow(log: Log, force: FloatArray, time: FloatArray) -> FloatArray:
    """Return rows (n, 3) at given times, low-passed as the measurements are."""
    dt = 1.0 / log.flight.rate
    rows = force[np.round((time - log.flight.time[0]) / dt).astype(int)]
    cuts = np.flatnonzero(np.diff(time) > 1.5 * dt) + 1
    return np.concatenate([low_passed(part, dt) for part in np.split(np.nan_to_num(rows), cuts)])
