"""Simulation and linear model of a fitted model or a vehicle."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stoop.base.arrays import FloatArray
from stoop.base.packages import hook
from stoop.errors import ManeuverError, StoopWarning
from stoop.flight import Flight
from stoop.simulation import LinearModel, Trim, trim
from stoop.simulation import linearize as linearized
from stoop.simulation.fly import simulate as simulated
from stoop.simulation.maneuver import Maneuver, load_maneuver
from stoop.vehicle import Vehicle
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.load import takes_model_or_vehicle

if TYPE_CHECKING:
    import xarray as xr


@takes_model_or_vehicle
def linearize(
    model: FittedModel | Vehicle,
    point: Trim | None = None,
    airspeed: float | None = None,
    altitude: float = 200.0,
) -> LinearModel:
    """Return A, B, C, D and the modes of a model about a steady flight.

    Inputs are control deflections in rad (the mixer is undone) and the channels of thrust and rotors, if any. On rotors the
    states are velocities along the body axes in place of airspeed and flow angles.

    Parameters
    ----------
    model : FittedModel, the folder of one, Vehicle, built-in vehicle or vehicle file
    point : Trim, optional
        As of :func:`stoop.trim`; the steady flight of `airspeed` and `altitude` when absent.
    airspeed : float, m/s, optional
        V* of the vehicle when absent.
    altitude : float, m

    Returns
    -------
    LinearModel
        ``states``, ``inputs`` and ``outputs`` (names), ``A``, ``B``, ``C``, ``D``, ``modes``, ``input_delays`` and
        ``output_delays``, s; SI and rad.
    """
    vehicle = model.vehicle if isinstance(model, FittedModel) else model
    point = point or trim(vehicle, airspeed, altitude)
    warn_of_extrapolation(model, point)
    return linearized(vehicle, point)


def warn_of_extrapolation(model: FittedModel | Vehicle, point: Trim) -> None:
    """Warn where a fitted model did not fly at the airspeed of a steady flight."""
    for one in (
        model.extrapolation(point.start["V"]) if isinstance(model, FittedModel) and point.on_wings else ()
    ):
        warnings.warn(str(one), StoopWarning, stacklevel=3)


@takes_model_or_vehicle
def simulate(
    model: FittedModel | Vehicle,
    inputs: Maneuver | str | Path | Mapping[str, Any] | xr.Dataset | Flight,
    time: FloatArray | None = None,
    *,
    airspeed: float | None = None,
    altitude: float = 200.0,
    seed: int = 0,
    noise: bool = False,
    name: str = "simulated",
    initial_state: Mapping[str, float] | None = None,
    autopilot: str | Path | Sequence[str | Path] | Mapping[str, float] | None = None,
) -> Flight:
    """Simulate a model from trimmed flight.

    Parameters
    ----------
    model : FittedModel, the folder of one, Vehicle, built-in vehicle or vehicle file
    inputs : Maneuver, path of a maneuver file, mapping of str to (n,) array, table, dataset or Flight
        Arrays by recorded channel, as a log holds them, or by control: deflection, rad. Absent inputs keep their
        trimmed values. Open loop; only a maneuver is flown by the autopilot that flight on rotors needs.
    time : (n,) array, s, optional
        At one rate; needed where `inputs` has no ``time``.
    airspeed : float, m/s, optional
        Of the trimmed flight, V* of the vehicle file when absent.
    altitude : float, m
    seed : int
        Of gusts and sensor noise.
    noise : bool
        Of the sensors, with the standard deviations of the vehicle file.
    name : str
        As in ``FLIGHT@START:STOP``.
    initial_state : mapping, optional
        States at the start, SI, in place of the trimmed ones, such as ``{"alpha": 0.05}``; of inputs as arrays.
    autopilot : path, paths or mapping, optional
        Log or files that hold the parameters of an autopilot, later ones over earlier ones, or these by name: its law flies the
        maneuver.

    Returns
    -------
    Flight

    Raises
    ------
    ManeuverError
        An input that the vehicle does not have, of another length than the time, or not finite.
    SimulationError
        No trim, or the flight diverges.
    """
    vehicle = model.vehicle if isinstance(model, FittedModel) else model
    if autopilot is not None:
        maneuver = load_maneuver(inputs) if isinstance(inputs, str | Path) else inputs
        if not isinstance(maneuver, Maneuver):
            raise ManeuverError(
                "autopilot: its law flies a maneuver; give a maneuver, or its file, as inputs"
            )
        if initial_state is not None or time is not None or airspeed is not None:
            raise ManeuverError(
                "autopilot: a maneuver has its own time and steady flight; remove time, airspeed and initial_state"
            )
        under_law = hook("simulate_under_law", "the law of an autopilot", Flight)
        flight: Flight = under_law(vehicle, maneuver, autopilot, seed, noise, name)
        return flight
    return simulated(vehicle, inputs, time, airspeed, altitude, seed, noise, name, initial_state)
