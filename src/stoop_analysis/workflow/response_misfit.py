"""Frequency responses of the residuals of a fit to the inputs: an independent check of what a controller needs."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from stoop import Flight, Vehicle
from stoop.extend.errors import FlightError
from stoop.extend.fits import ManeuverResult, ManeuverTrace, ResponseMisfit
from stoop.extend.flights import Stretch, Window
from stoop.extend.variables import RATES
from stoop_analysis.response_misfit import response_misfits
from stoop_analysis.workflow.frequency import control_inputs, moving_inputs, steady_model


def model_misfits(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    maneuvers: Sequence[ManeuverResult],
    traces: Sequence[ManeuverTrace],
) -> tuple[ResponseMisfit, ...]:
    """Return what a model leaves of the responses of the rates to the inputs, in maneuvers fitted and held back."""
    outputs = [name for name in RATES if all(name in trace.channels for trace in traces)]
    if not outputs:
        return ()
    axes = None
    if vehicle.rotors:
        windows = [Window(m.flight, m.start, m.stop) for m in maneuvers]
        masks = {
            name: Window.within(flight, [w for w in windows if w.flight == name]) & True
            for name, flight in flights.items()
        }
        axes = steady_model(tuple(flights.values()), masks, vehicle).axes
    columns = [control_inputs(vehicle, trace.inputs, axes) for trace in traces]
    recorded = [np.isfinite(trace.time) for trace in traces]
    try:
        inputs, _ = moving_inputs(columns, recorded, ())
    except FlightError:  # nothing moves
        return ()
    stretches = []
    for trace, own in zip(traces, columns, strict=True):
        measured = np.column_stack([trace.channels[name].measured for name in outputs])
        left = measured - np.column_stack([trace.channels[name].simulated for name in outputs])
        measured[np.isnan(left)] = np.nan  # both have the same gaps, and so the same windows
        rate = 1.0 / float(np.nanmedian(np.diff(trace.time)))
        driven = np.column_stack([own[name] for name in inputs])
        stretches.append(Stretch(rate, driven, np.column_stack([measured, left])))
    return response_misfits(stretches, inputs, outputs)
