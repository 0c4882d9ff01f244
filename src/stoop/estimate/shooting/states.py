"""The states that windows begin with, as they were measured."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.estimate.filter_error.paths import filled, unwrapped
from stoop.estimate.regression.aircraft import first_order_lag
from stoop.estimate.shooting.windows import Shots
from stoop.problem import Piece
from stoop.problem.start import state_channels, through_air
from stoop.simulate import initial_states, parameter_rows
from stoop.simulate.delays import late_inputs
from stoop.simulate.initial import commanded
from stoop.vehicle import Vehicle

SMOOTH: Final = 0.1  #: s over which readings are averaged where a window begins
BENT: Final = 3  #: numbers of a parabola


def measured_states(shots: Shots) -> FloatArray:
    """Return the states (n_x, w) that were measured where the windows begin."""
    piece, vehicle = shots.piece, shots.problem.layout.vehicle
    starts, at = measured_starts(shots), np.array(shots.edges[:-1])
    rows = np.repeat(parameter_rows(vehicle, piece.changes), len(at), axis=1)
    return initial_states(vehicle, starts, rows, np.ascontiguousarray(piece.inputs[at].T))


def measured_starts(shots: Shots) -> dict[str, FloatArray]:
    """Return what :func:`~stoop.simulate.initial_states` takes of every window, (w,) each."""
    piece, vehicle = shots.piece, shots.problem.layout.vehicle
    at = np.array(shots.edges[:-1])
    readings = _smoothed(piece, vehicle, at)
    still = {n: np.full(len(at), piece.start.get(n, 0.0)) for n in vehicle.start_names}
    seen = _over_ground(vehicle, piece, readings) if vehicle.hovers else readings
    return still | seen | _lags(vehicle, piece, at)


def _smoothed(piece: Piece, vehicle: Vehicle, at: NDArray[np.int64]) -> dict[str, FloatArray]:
    """Return the mean reading (w,) about each beginning, of channels that were measured at all."""
    width = max(1, round(SMOOTH / piece.dt))
    out = {}
    for i, channel in enumerate(vehicle.outputs):
        column = piece.measured[:, i]
        if channel in state_channels(vehicle) and np.isfinite(column).any():
            whole = filled(unwrapped(column))
            if vehicle.hovers:
                out[channel] = np.array([_parabola(whole, a, width) for a in at])
                continue
            smooth = np.pad(whole, width, mode="edge")
            out[channel] = np.array([smooth[a : a + 2 * width + 1].mean() for a in at])
    return out


def _parabola(column: FloatArray, at: int, width: int) -> float:
    """Return a parabola through the readings about a sample, there: rates of a multirotor turn within a tenth of a second."""
    first = max(0, at - width)
    near = column[first : at + width + 1]
    if len(near) < 2 * BENT:
        return float(near.mean())
    powers = np.vander(np.arange(len(near)) - float(at - first), BENT)
    return float(np.linalg.lstsq(powers, near, rcond=None)[0][-1])


def _over_ground(vehicle: Vehicle, piece: Piece, readings: Mapping[str, FloatArray]) -> dict[str, FloatArray]:
    """Return the motion through the air, body axes: bias and scale of the piece undone, the wind taken off."""
    rows = parameter_rows(vehicle, piece.changes)[:, 0]
    true = {c: _true(vehicle, rows, c, y) for c, y in readings.items()}
    if not {"vn", "ve", "vd"} & set(true):
        return true
    zero = np.zeros(len(next(iter(true.values()))))
    at_start = {n: zero + piece.start.get(n, 0.0) for n in ("phi", "theta", "psi")}
    return through_air({**dict.fromkeys(("vn", "ve", "vd"), zero), **at_start, **true})


def _true(vehicle: Vehicle, rows: FloatArray, channel: str, reading: FloatArray) -> FloatArray:
    scale = f"sensors.{channel}.scale"
    factor = rows[vehicle.rows[scale]] if scale in vehicle.rows else 1.0
    return np.asarray((reading - rows[vehicle.rows[f"sensors.{channel}.bias"]]) / (factor or 1.0))


def _lags(vehicle: Vehicle, piece: Piece, at: NDArray[np.int64]) -> dict[str, FloatArray]:
    """Return by how much lagged surfaces and rotors are off their commands, (w,) each, with the file's lags."""
    names = [s.removesuffix(".lag") for s in vehicle.states if s.endswith(".lag")]
    if not names:
        return {}
    rows = parameter_rows(vehicle, piece.changes)
    inputs = late_inputs(vehicle, piece.inputs, rows, piece.dt)
    whole, early = np.repeat(rows, len(inputs), axis=1), np.repeat(rows, len(at), axis=1)
    out = {}
    for name in names:
        prefix = "rotors" if name in vehicle.rotors else f"controls.{name}"
        behind = first_order_lag(
            commanded(vehicle, name, whole, inputs.T), float(rows[vehicle.rows[f"{prefix}.lag"], 0]), piece.dt
        )
        out[f"{name}.lag"] = behind[at] - commanded(vehicle, name, early, piece.inputs[at].T)
    return out
