"""Output error over the kinematics: the least-squares problem that Levenberg-Marquardt sees.

The vector holds the unknowns, then the initial states of all pieces, each as (value - prior mean) / prior
standard deviation. Nothing is bounded.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.base.rotations import quaternions_of
from stoop.base.variables import EULER, WRAPPED
from stoop.flight.instrument_errors import DELAYED, RATES_DELAY, InstrumentError
from stoop.kernels import Kernel
from stoop.optimize import forward_jacobian
from stoop.problem import on_circle
from stoop.reconstruct.kinematics import INPUTS, OUTPUTS, PARAMETERS, SCALED, kernel
from stoop.reconstruct.pieces import Piece
from stoop.simulate.delays import delayed

STEP: Final = 1e-6  #: of a prior's standard deviation
START: Final = {
    "u": 2.0, "v": 2.0, "w": 2.0, "phi": 0.05, "theta": 0.05, "psi": 0.1, "pn": 5.0, "pe": 5.0, "pd": 5.0,
}  #: m/s, rad, m: prior standard deviation of an initial state about its guess, wide  # fmt: skip
_LATE: Final = {channel: f"{name}.delay" for name, channels in DELAYED.items() for channel in channels}


@dataclass(frozen=True, eq=False)
class Problem:
    """See :class:`stoop.optimize.Problem`; one rung, no box.

    Attributes
    ----------
    unknowns : tuple of InstrumentError
    pieces : tuple of Piece
    sigma : (13,)
        By which each channel is weighted.
    """

    unknowns: tuple[InstrumentError, ...]
    pieces: tuple[Piece, ...]
    sigma: FloatArray
    dimension: int = 0
    prices: tuple[float, ...] = (1.0,)

    @property
    def shared(self) -> int:
        """Number of unknowns that all pieces share."""
        return len(self.unknowns)

    @property
    def extra(self) -> int:
        """Length of the vector."""
        return self.shared + len(START) * len(self.pieces)

    def weighted(self, sigma: FloatArray) -> Problem:
        """Return the same problem with other weights."""
        return replace(self, sigma=sigma)

    def values(self, Z: FloatArray) -> FloatArray:
        """Return the unknowns (B, k) of vectors (B, E) or their first k entries, SI."""
        return np.asarray(self.means + Z[:, : self.shared] * self.scales)

    @cached_property
    def means(self) -> FloatArray:
        """Prior means (k,), SI."""
        return np.array([unknown.mean for unknown in self.unknowns])

    @cached_property
    def scales(self) -> FloatArray:
        """Prior standard deviations (k,), SI."""
        return np.array([unknown.std for unknown in self.unknowns])

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return the cost (B,) with everything at its prior mean: there is no box to search."""
        return np.asarray(np.sum(self.residuals(np.zeros((len(X), self.extra)), rung) ** 2, axis=1))

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted residuals (B, n_r), those of the priors last."""
        blocks = [self._block(Z, i) for i in range(len(self.pieces))]
        return np.concatenate([*blocks, Z], axis=1)

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Differentiate by forward steps; a piece moves with the unknowns and its own initial state only."""
        out = np.zeros((self.extra, len(r)))
        first = 0
        for i, piece in enumerate(self.pieces):
            block = slice(first, first + piece.measured.size)
            entries = np.array([*range(self.shared), *self._own(i)], dtype=np.intp)
            part = _Part(self, z, i, entries)
            out[entries, block] = forward_jacobian(part, z[entries], 0, r[block], STEP)[0].T
            first = block.stop
        out[:, first:] = np.eye(self.extra)
        return out.T, float(self.shared + len(START))

    def reference(self, rung: int) -> float:
        """Return the cost of channels that stay at their first value."""
        held = [_first_values(piece.measured) - piece.measured for piece in self.pieces]
        return float(sum(np.nansum((error / self.sigma) ** 2) for error in held))

    def outputs(self, z: FloatArray, index: int) -> FloatArray:
        """Return what the sensors of one piece would have read where it is compared (m, 13)."""
        return np.asarray(self.trajectories(z[None, :], index)[0, :: self.pieces[index].every])

    def trajectories(self, Z: FloatArray, index: int) -> FloatArray:
        """Return the readings (B, n, 13) of one piece; gyros of the same delay are integrated together."""
        piece, values = self.pieces[index], self._named(Z)
        rows, start = self._rows(values, len(Z)), self._start(Z, index)
        late = values.get(RATES_DELAY, np.zeros(len(Z)))
        out = np.empty((len(Z), len(piece.time), len(OUTPUTS)))
        for delay in np.unique(late):
            lanes = late == delay
            inputs = _early_rates(piece, float(delay))
            out[lanes] = self._kernel.trajectories(rows[:, lanes], start[:, lanes], inputs, piece.dt)
        return _late(out, values, piece.dt)

    def _block(self, Z: FloatArray, index: int) -> FloatArray:
        measured = self.pieces[index].measured
        seen = np.isfinite(measured)
        simulated = self.trajectories(Z, index)[:, :: self.pieces[index].every]
        with np.errstate(invalid="ignore", over="ignore"):
            error = on_circle((simulated - np.where(seen, measured, 0.0)) * seen, OUTPUTS)
            return np.asarray((error / self.sigma).reshape(len(Z), -1))

    def _own(self, index: int) -> range:
        first = self.shared + len(START) * index
        return range(first, first + len(START))

    def _named(self, Z: FloatArray) -> dict[str, FloatArray]:
        return dict(zip((u.name for u in self.unknowns), self.values(Z).T, strict=True))

    def _rows(self, values: Mapping[str, FloatArray], count: int) -> FloatArray:
        scales = {f"{name}.scale" for name in SCALED}
        rows = np.repeat([[1.0 if name in scales else 0.0] for name in PARAMETERS], count, axis=1)
        for i, name in enumerate(PARAMETERS):
            if name in values:
                rows[i] = values[name]
        return rows

    def _start(self, Z: FloatArray, index: int) -> FloatArray:
        guess, own = self.pieces[index].start, Z[:, self._own(index)]
        at = {name: guess[name] + std * own[:, j] for j, (name, std) in enumerate(START.items())}
        turned = quaternions_of(np.column_stack([at[name] for name in EULER])).T
        motion = [at[name] for name in ("u", "v", "w")]
        return np.array([*motion, *turned, *(at[name] for name in ("pn", "pe", "pd"))])

    @cached_property
    def _kernel(self) -> Kernel:
        return kernel()


@dataclass(frozen=True, eq=False)
class _Part:
    """One piece as a function of the entries that move it, for `forward_jacobian`."""

    whole: Problem
    z: FloatArray
    index: int
    entries: NDArray[np.intp]
    dimension: int = 0
    prices: tuple[float, ...] = (1.0,)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return weighted residuals (B, n) of the piece."""
        moved = np.repeat(self.z[None, :], len(Z), axis=0)
        moved[:, self.entries] = Z
        return self.whole._block(moved, self.index)


def _first_values(measured: FloatArray) -> FloatArray:
    return np.array([column[np.isfinite(column)][:1].sum() for column in measured.T])


def _early_rates(piece: Piece, delay: float) -> FloatArray:
    """Return the inputs with the gyros read as much earlier as they are late."""
    if delay == 0.0:
        return piece.inputs
    gyro = INPUTS.index("p")
    out = piece.inputs.copy()
    out[:, gyro:] = delayed(piece.inputs[:, gyro:], -delay / piece.dt)
    return out


def _late(out: FloatArray, values: Mapping[str, FloatArray], dt: float) -> FloatArray:
    """Return readings (B, n, 13) as late as each sensor delivers them; the array is changed in place."""
    for column, channel in enumerate(OUTPUTS):
        delays = values.get(_LATE[channel], np.zeros(len(out)))
        for delay in np.unique(delays[delays != 0.0]):
            lanes = delays == delay
            readings = out[lanes, :, column].T
            readings = np.unwrap(readings, axis=0) if channel in WRAPPED else readings
            out[lanes, :, column] = delayed(readings, float(delay) / dt).T
    return out
