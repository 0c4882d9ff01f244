"""Delay of commands by a scan: angular accelerations regressed on the recorded states and on commands of every delay.

A search that begins far from the delay ends in a wrong optimum: the phase of the command goes into damping and control
derivatives, and the cost is not convex in the delay. For each delay the regression is linear and needs no model, so that all
delays are compared by their likelihoods (concentrated in the coefficients and in the variance of each acceleration). A control
turns the vehicle about its own axis the right way, or not at all: where an autopilot answers gusts, commands of some delays
explain the accelerations before them, with the other sign.

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., Sunflyte, 2016, section 5.1.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.stats import chi2

from stoop.base.arrays import FloatArray, run_slices
from stoop.base.variables import EFFECTS, RATES
from stoop.estimate.noise import correlation_times
from stoop.estimate.regression.least_squares import TimeDomain
from stoop.problem import Piece
from stoop.vehicle import Vehicle
from stoop.vehicle.delays import delayed, first_order_lag

LONGEST: Final = 0.5  #: s, the longest delay that is looked for
LEVEL: Final = 1e-4  #: of a rise of the likelihood by chance
#: readings on which accelerations depend, where they are recorded
STATES: Final = ("V", "alpha", "beta", *RATES)
#: share of the samples of all pieces in which a reading must be there to be a regressor
PRESENT: Final = 0.9


@dataclass(frozen=True, eq=False)
class Scan:
    """Log-likelihood of each delay."""

    delays: FloatArray  #: (m,) s
    log_likelihood: FloatArray  #: (m,)

    def beyond(self, reach: float) -> float | None:
        """Return the likeliest delay [s] if it exceeds what is within reach by more than chance, and lies within the scan."""
        best, near = int(np.argmax(self.log_likelihood)), self.delays <= reach
        if best in (0, len(self.delays) - 1) or near[best] or not near.any():
            return None
        rise = float(self.log_likelihood[best] - self.log_likelihood[near].max())
        tried = np.count_nonzero(~near)  # by chance each of them may be the likeliest (Bonferroni)
        return float(self.delays[best]) if 2.0 * rise > chi2.isf(LEVEL / tried, 1) else None


def scan_delays(vehicle: Vehicle, pieces: Sequence[Piece], columns: Sequence[int]) -> Scan | None:
    """Return the likelihoods of delays of the inputs `columns` from zero to `LONGEST`; None without a rate or a motion.

    Commands pass the lags that the vehicle has now; inputs that are not among the columns are not delayed.
    """
    dt = pieces[0].dt
    delays = np.asarray(dt * np.arange(round(LONGEST / dt) + 1), dtype=np.float64)
    recorded = np.concatenate([np.isfinite(piece.whole) for piece in pieces]).mean(axis=0) > PRESENT
    states = [c for c in STATES if c in vehicle.outputs and recorded[vehicle.outputs.index(c)]]
    if not set(RATES) & set(states):
        return None
    parts = [part for piece in pieces for part in _regressions(vehicle, piece, columns, delays, states)]
    if not parts or not any(part[2].size for part in parts):
        return None
    # of the effect of columns on angular accelerations about their own axes; zero about others
    known = {(name, rate): sign for rate, controls in EFFECTS.values() for name, sign in controls}
    commands, rates = [vehicle.recorded[i] for i in columns], [c for c in RATES if c in states]
    signs = np.array([[known.get((command, c), 0.0) for c in rates] for command in commands])
    delayed = ([(y, np.column_stack([X, own[m]])) for y, X, own in parts] for m in range(len(delays)))
    errors = [_errors(one, signs) for one in delayed]
    count = sum(len(one) for one in errors[0])
    squares = np.array([np.sum([np.sum(e**2, axis=0) for e in one], axis=0) for one in errors])
    best = int(np.argmin(np.sum(np.log(np.maximum(squares, np.finfo(float).tiny)), axis=1)))
    period = TimeDomain().period(dt)
    independent = count / float(np.median(correlation_times(errors[best], period)))
    variances = np.maximum(squares, np.finfo(float).tiny) / count
    return Scan(delays, -0.5 * independent * np.sum(np.log(variances), axis=1))


def _regressions(
    vehicle: Vehicle, piece: Piece, columns: Sequence[int], delays: FloatArray, states: Sequence[str]
) -> Iterator[tuple[FloatArray, FloatArray, FloatArray]]:
    """Yield smoothed accelerations (n, r), other regressors (n, k), and commands of each delay (m, n, c) of a piece."""
    readings = dict(zip(vehicle.outputs, piece.whole.T, strict=True))
    rates = [c for c in RATES if c in states]
    measured = np.column_stack([readings[c] for c in states])
    others = [i for i in range(len(vehicle.recorded)) if i not in set(columns)]
    commands = lagged_inputs(vehicle, piece, columns)
    lead = len(commands) - len(piece.time)  # samples of commands before the piece
    late = np.stack([delayed(commands, d / piece.dt)[lead:] for d in delays])
    # samples whose latest command was not recorded
    unknown = min(max(round(LONGEST / piece.dt) - lead, 0), len(piece.time) // 4)
    domain = TimeDomain()
    for run in run_slices(np.isfinite(measured).all(axis=1)):
        own = slice(max(run.start, unknown), run.stop)
        if own.stop - own.start < 4 * len(states):
            continue
        t, x = piece.time[own], measured[own]
        turning = CubicSpline(t, x[:, [states.index(c) for c in rates]])(t, 1)
        fixed = np.column_stack([np.ones(len(t)), x, piece.inputs[own][:, others]])
        smooth = domain.rows(np.column_stack([turning, fixed, *late[:, own]]), piece.dt)
        if len(smooth) > fixed.shape[1] + len(columns):
            accelerations, rest = smooth[:, : len(rates)], smooth[:, len(rates) :]
            of_delays = rest[:, fixed.shape[1] :].reshape(len(rest), len(delays), -1)
            yield accelerations, rest[:, : fixed.shape[1]], np.moveaxis(of_delays, 1, 0)


def lagged_inputs(vehicle: Vehicle, piece: Piece, columns: Sequence[int]) -> FloatArray:
    """Return inputs (m + n, c) before and of a piece after the lags of what they move, as the vehicle has them now."""
    commands, lags = piece.commands, dict[int, float]()
    for control in vehicle.controls:
        moved = map(vehicle.inputs.index, vehicle.channels_of(control))
        lags |= dict.fromkeys(moved, vehicle.value(f"controls.{control}.lag", 0.0))
    for rotor in vehicle.file.rotor.values():
        lags[vehicle.inputs.index(rotor.channel)] = vehicle.value("rotors.lag", 0.0)
    own = (first_order_lag(commands[:, i], lags.get(i, 0.0), piece.dt) for i in columns)
    return np.column_stack(list(own))


def _errors(parts: Sequence[tuple[FloatArray, FloatArray]], signs: FloatArray) -> list[FloatArray]:
    """Return the residuals (n, r) of each part after a regression of all parts together.

    The last regressors have the `signs` (c, r), or no effect.
    """
    y, X = (np.concatenate(each) for each in zip(*parts, strict=True))
    scale = np.linalg.norm(X, axis=0)
    X = X / np.where(scale > 0.0, scale, 1.0)
    found = np.linalg.lstsq(X, y, rcond=1e-10)[0]
    left, wrong = y - X @ found, found[-len(signs) :] * signs < 0.0
    for j in np.flatnonzero(wrong.any(axis=0)):
        some = np.delete(X, X.shape[1] - len(signs) + np.flatnonzero(wrong[:, j]), axis=1)
        left[:, j] = y[:, j] - some @ np.linalg.lstsq(some, y[:, j], rcond=1e-10)[0]
    return np.split(left, np.cumsum([len(part[0]) for part in parts])[:-1])
