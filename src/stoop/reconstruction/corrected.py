"""The flight as it would have been logged by sensors without the errors that were found."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import EULER, QUATERNION, VARIABLES, WRAPPED
from stoop.flight import Flight
from stoop.flight.air_data import RECONSTRUCTED, flow, with_air
from stoop.flight.flight import dataset, on_circle, with_attitude
from stoop.flight.instrument_errors import DELAYED, RATES_DELAY
from stoop.reconstruction.estimate import Estimate
from stoop.reconstruction.kinematics import INPUTS
from stoop.simulation.delays import delayed
from stoop.simulation.initial import rigid_states

MIN_SIGMAS: Final = 2.0  #: standard errors; a shorter delay is left, for shifting smooths
_LATE: Final = {c: f"{name}.delay" for name, group in DELAYED.items() for c in group} | dict.fromkeys(
    "pqr", RATES_DELAY
)


def corrected_flight(found: Estimate) -> Flight:
    """Undo biases, scales, delays and positions of vanes; air data without vanes are reconstructed anew.

    Biases and scales are undone together, as they were estimated; delays where they are evident.
    """
    flight, values = found.pieces.flight, found.values
    evident = {one.name for one in found.identifiability if one.identifiable and one.name.endswith(".delay")}
    delays = {n: values[n] for n in evident if abs(values[n]) > MIN_SIGMAS * found.errors[n]}
    kept = {
        n: flight.column(n)
        for n in VARIABLES
        if n in flight.data and flight.sources[n].source != RECONSTRUCTED
    }
    columns = {name: _early(name, x, delays, flight.rate) for name, x in kept.items()}
    columns = {name: _undone(name, x, values) for name, x in columns.items()}
    columns = _flow_at_reference(columns, values)
    if "wind.n" in values:
        steady = {f"wind_{axis}": np.full(flight.time.size, values[f"wind.{axis}"]) for axis in "ne"}
        columns |= {name: x for name, x in steady.items() if name in columns}
    angles = {name: x for name, x in columns.items() if name not in QUATERNION}
    whole = with_attitude(on_circle(angles))
    ordered = {name: whole[name] for name in VARIABLES if name in whole}
    sources = {name: flight.sources[name] for name in ordered}
    made = replace(
        flight,
        data=dataset(flight.time, ordered),
        sources=sources,
        air=None,
        notices=(*_notices(flight), notice("corrected", flight.name)),
    )
    return with_air(made)


def _notices(flight: Flight) -> tuple[Notice, ...]:
    """Return what was said of the log, without what was said of the old air data."""
    told = () if flight.air is None else flight.air.notices
    return tuple(found for found in flight.notices if found not in told)


def _early(name: str, x: FloatArray, delays: Mapping[str, float], rate: float) -> FloatArray:
    samples = -delays.get(_LATE.get(name, ""), 0.0) * rate
    if name in WRAPPED:  # between pi and -pi there is no value: interpolate on the circle
        return np.asarray(np.arctan2(delayed(np.sin(x), samples), delayed(np.cos(x), samples)))
    return delayed(x, samples)


def _undone(name: str, x: FloatArray, values: Mapping[str, float]) -> FloatArray:
    """Undo reading = scale * truth + bias."""
    if name not in (*INPUTS, *EULER, "V", "airspeed_pitot", "alpha", "beta"):
        return x
    return np.asarray((x - values.get(f"{name}.bias", 0.0)) / values.get(f"{name}.scale", 1.0))


def _flow_at_reference(columns: dict[str, FloatArray], values: Mapping[str, float]) -> dict[str, FloatArray]:
    """Take measured flow from the vanes to the reference point, where speed and both angles were measured."""
    if not {"V", "alpha", "beta"} <= columns.keys() or "vane.x" not in values:
        return columns
    moving = rigid_states({name: columns[name] for name in ("V", "alpha", "beta")})
    omega = np.column_stack([columns[name] for name in "pqr"])
    arm = np.array([values[f"vane.{axis}"] for axis in "xyz"])
    velocity = np.column_stack([moving[name] for name in "uvw"]) - np.cross(omega, arm)
    return {**columns, **dict(zip(("V", "alpha", "beta"), flow(velocity), strict=True))}
