r"""Frequency responses of the residuals of a model to the inputs, over those of the flights.

Residuals of a model that holds respond to no input. Their response is estimated like that of the measured rate, from the same
windows and inputs, so that leakage and inputs that move together act on both alike; it is the difference between the response
of the flights and that of the simulated readings. Over the frequencies at which the response H of the rate is known, the
share that the response E of the residuals is of it, beyond its random error with variance v, is

.. math:: s^2 = \frac{\sum (|E|^2 - v)}{\sum |H|^2}, \qquad
   s_{\min}^2 = \frac{\sum (|E|^2 - v\,F_{0.99}(m, m))}{\sum |H|^2},

with Fisher's distribution F: the variance is estimated from the same few windows. Each frequency that they resolve has two
degrees of freedom (real and imaginary part), of which unequal variances leave :math:`m = 2 n_f \bar v^2 / \overline{v^2}` in
all (Satterthwaite).

References
----------
M. B. Tischler and R. K. Remple, *Aircraft and Rotorcraft System Identification*, 2nd ed., AIAA, 2012, chapters 7 and 14.
L. Ljung, *System Identification: Theory for the User*, 2nd ed., Prentice Hall, 1999, section 16.6 (residuals and inputs).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.stats import f as fisher

from stoop import Flight, Vehicle
from stoop.extend.errors import FlightError
from stoop.extend.fits import ManeuverResult, ManeuverTrace, ResponseMisfit
from stoop.extend.flights import FrequencyResponse, Stretch, Window
from stoop.extend.variables import FAMILIES
from stoop_analysis.frequency import known
from stoop_analysis.workflow.frequency import control_inputs, moving_inputs, steady_model

CHANCE: Final = 0.01  #: that random error alone leaves more than `ResponseMisfit.least`


def model_misfits(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    maneuvers: Sequence[ManeuverResult],
    traces: Sequence[ManeuverTrace],
) -> tuple[ResponseMisfit, ...]:
    """Return what a model leaves of the responses of the rates to the inputs, in maneuvers fitted and held back."""
    outputs = [name for name in FAMILIES["rates"] if all(name in trace.channels for trace in traces)]
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


def response_misfits(
    stretches: Sequence[Stretch], inputs: Sequence[str], outputs: Sequence[str]
) -> tuple[ResponseMisfit, ...]:
    """Return what a model leaves of each response that the flights show.

    Parameters
    ----------
    stretches : sequence of Stretch
        Their outputs (n, 2q) are the measured ones, then the residuals in the same order and with the same gaps.
    inputs, outputs : names of the p inputs and q outputs
    """
    residuals = [f"residual {name}" for name in outputs]
    estimated = FrequencyResponse.estimate(stretches, inputs, [*outputs, *residuals])
    by_pair = {(one.input, one.output): one for one in estimated}
    found = (
        _misfit(by_pair[i, o], by_pair[i, left])
        for o, left in zip(outputs, residuals, strict=True)
        for i in inputs
        if (i, o) in by_pair
    )
    return tuple(one for one in found if one is not None)


def _misfit(flown: FrequencyResponse, left: FrequencyResponse) -> ResponseMisfit | None:
    """Return what a model misses of one response; None where the flights show it at less than two resolved frequencies."""
    at = known(flown) & np.isfinite(left.error)
    frequency = flown.frequency[at]
    if not frequency.size:
        return None
    cycles = float(frequency[-1] - frequency[0]) / (2.0 * np.pi) * float(np.mean(flown.window[at]))
    resolved = cycles / FrequencyResponse.CYCLES
    if resolved < 2.0:
        return None
    size, power = np.abs(flown.response[at]) ** 2, np.abs(left.response[at]) ** 2
    variance = 2.0 * power * left.error[at] ** 2
    freedom = 2.0 * resolved * float(np.mean(variance) ** 2 / np.mean(variance**2))
    chance = float(fisher.isf(CHANCE, freedom, freedom))

    def share(factor: float) -> float:
        return float(np.sqrt(max(float(np.sum(power - factor * variance) / np.sum(size)), 0.0)))

    return ResponseMisfit(
        flown.input, flown.output, float(frequency[0]), float(frequency[-1]),
        float(np.mean(flown.coherence[at])), share(1.0), share(chance),
    )  # fmt: skip
