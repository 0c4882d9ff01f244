"""Open-loop predictions from a given first state, scored beside models that know no flight mechanics.

The score of a channel is the root mean square of the error over the range of the channel in the window; that of a window is
their mean over the channels of position, velocity, attitude and rates. A straight line moves on at the first velocity, all else
held; an ARX model of three lags (Ljung, System Identification, 2nd ed., section 4.2) is fitted to the fitted windows by ridge
regression and simulated freely from the first three samples, with the ridge whose free simulations of these windows are best.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of, to_ground
from stoop.base.variables import EULER, POSITION, WRAPPED
from stoop.estimate.linearization import interpolated, unwrapped
from stoop.prediction.predict import Prediction
from stoop.problem import Piece
from stoop.problem.observation import state_channels
from stoop.vehicle import Vehicle
from stoop.vehicle.channels import rigid_states

LAGS: Final = 3
RIDGES: Final = (
    1e-8,
    1e-6,
    1e-4,
    1e-2,
    1.0,
    1e2,
)  #: over the number of samples, of regressors of unit variance
LINE: Final = "straight line"
ARX: Final = f"ARX, {LAGS} lags"
DIVERGED: Final = 1e6  #: SI, from the start


def channels_of(vehicle: Vehicle, pieces: Sequence[Piece]) -> tuple[str, ...]:
    """Return the channels of motion that all pieces hold."""
    return tuple(
        c
        for c in state_channels(vehicle)
        if c in vehicle.outputs
        and all(np.isfinite(p.whole[:, vehicle.outputs.index(c)]).any() for p in pieces)
    )


def score(measured: FloatArray, predicted: FloatArray) -> float:
    """Return the mean over channels of the rms error over the range, of curves (n, c); infinite where one diverges."""
    size = np.nanmax(measured, axis=0) - np.nanmin(measured, axis=0)
    if not (
        np.isfinite(predicted).all()
        and np.max(np.abs(predicted - measured[0]), initial=0.0, where=size > 0.0) < DIVERGED
    ):
        return float("inf")
    shares = np.sqrt(np.nanmean((predicted - measured) ** 2, axis=0))[size > 0.0] / size[size > 0.0]
    return float(np.mean(shares))


def open_loop_scores(
    vehicle: Vehicle,
    pieces: Sequence[Piece],
    readings: Mapping[str, Sequence[FloatArray]],
    fitted: Sequence[Piece],
) -> list[dict[str, float]]:
    """Return the scores of each piece by name: of models whose readings (n, n_y) are given, of a straight line and of ARX.

    Parameters
    ----------
    vehicle : its outputs are the columns
    pieces : predicted
    readings : model -> readings of each piece
    fitted : pieces from which ARX is estimated; without any there is none
    """
    names = channels_of(vehicle, [*pieces, *fitted])
    columns = [vehicle.outputs.index(c) for c in names]
    turning = [c in WRAPPED for c in names]

    def curves(y: FloatArray) -> FloatArray:
        return np.column_stack(
            [unwrapped(y[:, i]) if on else y[:, i] for i, on in zip(columns, turning, strict=True)]
        )

    weights = _autoregression([(curves(p.whole), p.inputs) for p in fitted])
    found = []
    for k, piece in enumerate(pieces):
        measured = curves(piece.whole)
        every = {name: curves(own[k]) for name, own in readings.items()}
        every[LINE] = _line(vehicle, piece, names, measured)
        if weights is not None:
            every[ARX] = _simulated(weights, measured, piece.inputs)
        found.append({name: score(measured, _near(y, measured, turning)) for name, y in every.items()})
    return found


def scores_by_window(
    vehicle: Vehicle, ahead: Prediction, before: Prediction, fitted: Sequence[Piece]
) -> dict[str, dict[str, float]]:
    """Return the scores of each piece, by the span of its samples: of the model, its draft, a straight line and ARX."""
    pieces = ahead.prepared.pieces
    found = open_loop_scores(vehicle, pieces, {"model": ahead.readings, "draft": before.readings}, fitted)
    windows = [ahead.prepared.windows[p.maneuver].flight for p in pieces]
    spans = (f"{name} {p.time[0]:.1f}:{p.time[-1]:.1f}" for name, p in zip(windows, pieces, strict=True))
    return dict(zip(spans, found, strict=True))


def _near(predicted: FloatArray, measured: FloatArray, turning: Sequence[bool]) -> FloatArray:
    """Return predicted curves with angles by whole turns as near to the measured ones as they begin."""
    turns = np.rint(np.nan_to_num(predicted[0] - measured[0]) / (2.0 * np.pi)) * turning
    return np.asarray(predicted - 2.0 * np.pi * turns)


def _line(vehicle: Vehicle, piece: Piece, names: Sequence[str], measured: FloatArray) -> FloatArray:
    """Return a motion with the first velocity, and all else held."""
    start = rigid_states(piece.start)
    velocity = np.array([float(start[axis][0]) for axis in "uvw"])
    angles = np.array([piece.start.get(a, 0.0) for a in EULER])
    ground = dict(zip(POSITION, to_ground(quaternions_of(angles), velocity), strict=True))
    time = piece.time - piece.time[0]
    first = [interpolated(column)[0] for column in measured.T]
    return np.column_stack([x + ground.get(c, 0.0) * time for c, x in zip(names, first, strict=True)])


def _regressors(y: FloatArray, u: FloatArray) -> FloatArray:
    """Return the regressors (n - LAGS, ...) of all samples from the lag on: earlier readings and commands, and one."""
    count = len(y) - LAGS
    past = [x[LAGS - 1 - lag : LAGS - 1 - lag + count] for lag in range(LAGS) for x in (y, u)]
    return np.column_stack([*past, np.ones(count)])


def _autoregression(records: Sequence[tuple[FloatArray, FloatArray]]) -> FloatArray | None:
    """Return the weights (regressors, c) of the next sample; None where nothing is complete."""
    parts = [(_regressors(y, u), y[LAGS:]) for y, u in records if len(y) > LAGS]
    if not parts:
        return None
    a, b = (np.concatenate(x) for x in zip(*parts, strict=True))
    whole = np.isfinite(a).all(axis=1) & np.isfinite(b).all(axis=1)
    if np.count_nonzero(whole) <= a.shape[1]:
        return None
    a, b = a[whole], b[whole]
    mean, size = np.append(a[:, :-1].mean(axis=0), 0.0), np.append(a[:, :-1].std(axis=0), 1.0) + 1e-12
    scaled, change = (a - mean) / size, b - a[:, : b.shape[1]]  # from the sample before
    tries = list[tuple[float, int, FloatArray]]()
    for ridge in RIDGES:
        penalty = np.diag(np.append(np.full(a.shape[1] - 1, ridge * len(a)), 0.0))
        weights = np.linalg.solve(scaled.T @ scaled + penalty, scaled.T @ change) / size[:, None]
        weights[-1] -= mean @ weights
        weights[: b.shape[1]] += np.eye(b.shape[1])
        error = np.mean([score(y, _simulated(weights, y, u)) for y, u in records])
        tries.append((float(error), len(tries), weights))
    return min(tries)[2]


def _simulated(weights: FloatArray, measured: FloatArray, inputs: FloatArray) -> FloatArray:
    """Return the free simulation (n, c) from the first samples."""
    out = np.column_stack([interpolated(column) for column in measured.T])
    with np.errstate(over="ignore", invalid="ignore"):
        for k in range(LAGS, len(out)):
            out[k] = _regressors(out[k - LAGS : k + 1], inputs[k - LAGS : k + 1])[0] @ weights
    return out
