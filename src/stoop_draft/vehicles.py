"""Drafts of vehicle files, in one call."""

from __future__ import annotations

from pathlib import Path

from stoop.extend.flights import Flights, as_flights
from stoop_draft.vehicle_draft.draft import Drafted, draft
from stoop_draft.vehicle_draft.geometry import Geometry
from stoop_draft.vehicle_draft.request import Request


def new_vehicle(
    flights: Flights = (),
    *,
    template: str | None = None,
    mass: float | None = None,
    span: float | None = None,
    chord: float | None = None,
    area: float | None = None,
    engine: str | None = None,
    geometry: str | Path | None = None,
    name: str | None = None,
    aerodynamics: str = "handbook",
) -> Drafted:
    """Draft a vehicle file; its ``text`` is to be saved, its ``vehicle`` to be used, its ``notices`` to be read.

    Parameters
    ----------
    flights : Flight, path of a log, xarray.Dataset, or a sequence of them, optional
        Of this vehicle; from dimensions alone when absent.
    template : str, optional
        "conventional", "v-tail", "flying-wing", "glider", "quadplane", "quad", "hexa" or "octo"; by the log when absent.
    mass : float, kg
    span : float, m
        Of the wing; of a multirotor the largest distance between motors.
    chord : float, m
        Of the wing, mean.
    area : float, m2, optional
        Of the wing; span times chord when absent.
    engine : str, optional
        "electric", "piston", "jet" or "none".
    geometry : path, optional
        Of a geometry file.
    name : str, optional
        Of the vehicle.
    aerodynamics : str
        Derivatives of the geometry file by "handbook" or "aerosandbox" (extra ``geometry``).

    Raises
    ------
    VehicleError
        Something is missing, contradicts itself, or AeroSandbox is not installed.
    """
    table = None if geometry is None else Geometry.load(geometry)
    request = Request(template, mass, span, chord, area, engine, table, name, aerodynamics)
    return draft(request, as_flights(flights))
