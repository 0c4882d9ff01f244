"""A model in calm air with what is known of its parameters, and the condition in which it flew."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from stoop import FittedModel, Notice, Vehicle, trim
from stoop.extend.errors import StoopError
from stoop.extend.fits import Piece, Prepared
from stoop.extend.flights import Window
from stoop.extend.motion import Trim
from stoop.extend.notices import notice
from stoop_analysis.derivatives import ParameterCovariance


@dataclass(frozen=True)
class Condition:
    """The steady flight: m/s (the vehicle's V* when absent), m (the flight's), rad."""

    airspeed: float | None = None
    altitude: float | None = None
    climb_angle: float = 0.0


@dataclass(frozen=True, eq=False)
class KnownModel:
    """A vehicle with what is known of its parameters and of the flight that identified them."""

    vehicle: Vehicle  #: without turbulence
    covariance: ParameterCovariance | None = (
        None  #: of the estimates; None of a vehicle that was not identified
    )
    altitude: float = 200.0  #: m, of the flight
    density: float | None = None  #: kg/m3, likewise, where a channel gives it
    notes: tuple[str, ...] = ()  #: for the user
    pieces: tuple[tuple[Piece, ...], ...] = ()  #: of each maneuver, fitted or predicted

    def altitude_of(self, condition: Condition) -> float:
        """Return the altitude of a condition, m; the flight's where it gives none."""
        return self.altitude if condition.altitude is None else condition.altitude

    def trim(self, condition: Condition) -> Trim:
        """Return the steady flight of a condition; raises `SimulationError`: there is none."""
        altitude = self.altitude_of(condition)
        return trim(self.vehicle, condition.airspeed, altitude, condition.climb_angle, self.density)


def known_model(model: FittedModel | Vehicle) -> KnownModel:
    """Return what is known of a fitted model or a vehicle."""
    if isinstance(model, Vehicle):
        vehicle, notices = without_turbulence(model.without_positions())
        return KnownModel(vehicle, notes=tuple(map(str, notices)))
    vehicle, notices = without_turbulence(model.vehicle.without_positions())
    notes = tuple(map(str, [*model.refusal, *notices]))
    covariance = model.result.covariance
    # What is known of the numbers that the vehicle has; those of its gusts are left with them.
    kept = [i for i, name in enumerate(covariance.names) if name in vehicle.rows]
    names = tuple(covariance.names[i] for i in kept)
    matrix = covariance.matrix[np.ix_(kept, kept)].copy()
    for i, name in enumerate(names):  # a standard error that is the prior's is no evidence of the flight
        if not model.result.parameters[name].identifiable:
            matrix[i], matrix[:, i] = np.nan, np.nan
            matrix[i, i] = np.inf
    known = KnownModel(vehicle, ParameterCovariance(names, matrix) if kept else None, notes=notes)
    windows = [Window(m.flight, m.start, m.stop, m.loading or None) for m in model.result.maneuvers]
    try:
        pieces = tuple(tuple(Prepared.of(vehicle, model.by_name, [window]).pieces) for window in windows)
    except StoopError as error:
        return replace(known, notes=(*notes, f"No comparison with the flight: {error}."))
    first, density = pieces[0][0], None
    if "density" in vehicle.inputs:
        density = float(np.mean(first.inputs[:, vehicle.inputs.index("density")]))
    return replace(known, altitude=first.start["h"], density=density, pieces=pieces)


def without_turbulence(vehicle: Vehicle) -> tuple[Vehicle, tuple[Notice, ...]]:
    """Return the vehicle in calm air, and a notice where it had turbulence: gusts are weather, not aircraft."""
    if vehicle.file.turbulence is None:
        return vehicle, ()
    loadings = {
        loading: {name: value for name, value in numbers.items() if not name.startswith("turbulence.")}
        for loading, numbers in vehicle.file.loadings.items()
    }
    file = vehicle.file.model_copy(update={"turbulence": None, "loadings": loadings})
    return replace(vehicle, file=file), (notice("turbulence-not-exported", vehicle.name),)
