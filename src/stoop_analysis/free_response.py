"""Modes as the record itself shows them: damped oscillations fitted to the free response after the input.

No flight-dynamics model takes part. Once the controls rest, every channel is

    y(t) = exp(-zeta w t) (a cos(w_d t) + b sin(w_d t)) + c + d t,   w_d = w sqrt(1 - zeta^2),

with one frequency w and one damping zeta for all channels that the mode moves, and a, b, c, d of each channel's own; the
straight line stands for what is slower (the phugoid, the slowest, has none: d = 0). Two periods are used; what comes later
is mostly the slower modes. a, b, c and d enter linearly and are solved for (variable projection: G. Golub and V. Pereyra,
SIAM J. Numer. Anal. 10, 1973), which leaves a search in two dimensions, from a grid of starts.

The error bars contain noise, what is no single damped oscillation (see `_Oscillation.drift`) and that the response is flown
about another airspeed than the condition's (`elsewhere`).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import least_squares

from stoop.extend import fits
from stoop.extend.arrays import FloatArray
from stoop.extend.notices import notice

CHANNELS: Final[Mapping[str, tuple[str, ...]]] = {
    "short period": ("q", "alpha"),
    "phugoid": ("V", "theta"),
    "Dutch roll": ("r", "beta"),
}  #: mode -> the channels in which it is best seen
REST: Final = 0.15  #: of the largest excursion in the maneuver: a control that stays within it rests
MIN_PERIODS: Final = 0.75  #: that must be recorded
MAX_PERIODS: Final = 2.0  #: that are used
MIN_SAMPLES: Final = 25
DAMPINGS: Final = (0.05, 0.2, 0.4, 0.6, 0.8)  #: where the search begins
MAX_DAMPING: Final = 0.98
MIN_EXPLAINED: Final = 0.7  #: of what the slower motion leaves, by the oscillation
MAX_ERRORS: Final = (0.2, 0.15)  #: standard errors of frequency, in parts of it, and damping
#: of the response, by shares of its length, fitted alone
PARTS: Final = ((0.1, 1.0), (0.2, 1.0), (0.3, 1.0), (0.0, 0.9), (0.0, 0.8), (0.0, 0.7))


def measured_modes(
    fit: fits.Estimate, maneuvers: Sequence[int], airspeed: float, mode: str, expected: float
) -> tuple[fits.MeasuredMode, ...]:
    """Return what followed the last motion of the controls in the last piece of each maneuver shows of a mode."""
    vehicle, out = fit.problem.layout.vehicle, []
    names = dict.fromkeys(c for control in vehicle.controls for c in vehicle.channels_of(control))
    for maneuver in maneuvers:
        piece = fit.prepared.pieces[fit.prepared.of_maneuver(maneuver)[-1]]
        controls = piece.inputs[:, [vehicle.inputs.index(c) for c in names]]
        channels = dict(zip(vehicle.outputs, piece.measured.T, strict=True))
        free = free_response(piece.time, controls, channels)
        out.append(measured_mode(mode, maneuver, free, expected, airspeed))
    return tuple(out)


@dataclass(frozen=True, eq=False)
class FreeResponse:
    """What the channels did once the controls rested: time (n,), s, and channels (n,), NaN where missing."""

    time: FloatArray
    channels: Mapping[str, FloatArray]


def free_response(time: FloatArray, controls: FloatArray, channels: Mapping[str, FloatArray]) -> FreeResponse:
    """Return what follows the last motion of the controls (n, m), recorded commands or surfaces of like units."""
    largest = float(np.max(np.ptp(controls, axis=0), initial=0.0))
    away = np.any(np.abs(controls - np.median(controls[-5:], axis=0)) > REST * largest, axis=1)
    first = int(np.flatnonzero(away)[-1]) + 1 if away.any() else 0
    return FreeResponse(time[first:], {name: values[first:] for name, values in channels.items()})


def measured_mode(
    name: str, maneuver: int, free: FreeResponse, expected: float, airspeed: float = math.nan
) -> fits.MeasuredMode:
    """Return frequency and damping of a mode as the free response shows them, or why it does not.

    The frequency `expected` of the model, rad/s, decides only how long a response is used, and whether there is enough of it;
    `airspeed`, m/s, is that of the flight condition, see :func:`elsewhere`; NaN where it does not matter.
    """
    if not len(free.time):
        return fits.MeasuredMode(maneuver, remark=notice("response-no-rest", name))
    if name not in CHANNELS:
        return fits.MeasuredMode(maneuver, remark=notice("response-no-oscillation", name))
    whole, period = float(free.time[-1] - free.time[0]), 2.0 * math.pi / max(expected, 1e-6)
    used = free.time - free.time[0] <= MAX_PERIODS * period
    free = FreeResponse(free.time[used], {channel: y[used] for channel, y in free.channels.items()})
    columns = {c: free.channels[c] for c in CHANNELS[name] if c in free.channels}
    place = fits.MeasuredMode(maneuver, float(free.time[0]), float(free.time[-1]), tuple(columns))
    if whole < MIN_PERIODS * period:
        short = notice("response-too-short", name, duration=whole, periods=whole / period)
        return replace(place, remark=short)
    columns = {c: values for c, values in columns.items() if np.isfinite(values).sum() >= MIN_SAMPLES}
    if not columns:
        return replace(place, remark=notice("response-not-recorded", name))
    place, t = replace(place, channels=tuple(columns)), free.time - free.time[0]
    y = np.column_stack(list(columns.values()))
    slower = np.column_stack([np.ones_like(t), *([] if name == "phugoid" else [t])])
    spread = np.array([float(np.std(e[np.isfinite(e)])) or 1.0 for e in _rest(slower, y).T])
    search = _Oscillation(t, y / spread, slower)
    x = search.solved()
    frequency, damping = math.exp(x[0]), float(x[1])
    away = elsewhere(free, airspeed) * np.array([1.0, abs(damping)])
    error = np.hypot(np.hypot(search.errors(x), search.drift(x)), away)
    if 1.0 - float(np.mean(search.residuals(x) ** 2)) < MIN_EXPLAINED:
        return replace(place, remark=notice("response-not-explained", name))
    if not (np.all(error < MAX_ERRORS) and damping < MAX_DAMPING - 1e-6):
        return replace(place, remark=notice("response-inaccurate", name))
    pairs = ((frequency, frequency * float(error[0])), (damping, float(error[1])))
    found = [fits.DerivedValue(v, s, v - fits.NORMAL_95 * s, v + fits.NORMAL_95 * s) for v, s in pairs]
    return replace(place, frequency=found[0], damping=found[1])


def elsewhere(free: FreeResponse, airspeed: float) -> float:
    """Return how far, as a share of `airspeed`, a response was flown from it; 0 where no airspeed was recorded.

    Natural frequencies go with the airspeed or its inverse: the mean's departure counts, and the square of the swing.
    """
    V = free.channels.get("V", np.empty(0))
    V = V[np.isfinite(V)]
    if not V.size or not math.isfinite(airspeed):
        return 0.0
    return abs(float(np.mean(V)) / airspeed - 1.0) + float(np.var(V)) / airspeed**2


def _rest(basis: FloatArray, y: FloatArray) -> FloatArray:
    """Return what a basis (n, b) leaves of columns (n, m); NaN where nothing was measured."""
    out = np.full_like(y, np.nan)
    for left, column in zip(out.T, y.T, strict=True):
        seen = np.isfinite(column)
        solution = np.linalg.lstsq(basis[seen], column[seen], rcond=1e-12)[0]
        left[seen] = column[seen] - basis[seen] @ solution
    return out


@dataclass(frozen=True, eq=False)
class _Oscillation:
    """The problem in log w and zeta; about `slower` (n, 1 or 2) the channels `y` (n, m) have unit variance."""

    t: FloatArray
    y: FloatArray
    slower: FloatArray

    def residuals(self, x: FloatArray) -> FloatArray:
        """Return what the best oscillation and slower motion of each channel leave, flat, where something was measured."""
        w, zeta = math.exp(x[0]), x[1]
        decay, angle = np.exp(-zeta * w * self.t), w * math.sqrt(1.0 - zeta**2) * self.t
        basis = np.column_stack([decay * np.cos(angle), decay * np.sin(angle), self.slower])
        return _rest(basis, self.y)[np.isfinite(self.y)]

    def solved(self, start: FloatArray | None = None) -> FloatArray:
        """Return the optimum from `start`, which may lie beyond what this record can tell, or from a grid."""
        slowest, fastest = math.pi / self.t[-1], 0.5 * math.pi * (len(self.t) - 1) / self.t[-1]  # rad/s
        box = [math.log(0.5 * slowest), -0.5], [math.log(fastest), MAX_DAMPING]
        grid = [np.array([math.log(w), z]) for w in np.geomspace(slowest, fastest, 24) for z in DAMPINGS]
        starts = [] if start is None else [start]
        starts = starts or sorted(grid, key=lambda x: float(np.sum(self.residuals(x) ** 2)))[:3]
        ends = [
            least_squares(self.residuals, np.clip(x, *box), bounds=box, x_scale=(0.1, 0.1)) for x in starts
        ]
        return np.asarray(min(ends, key=lambda end: end.cost).x, dtype=np.float64)

    def drift(self, x: FloatArray) -> FloatArray:
        """Return by how much (2,) parts of the response give other log w and zeta than the whole.

        Beyond the difference of their variances that is no noise (J. A. Hausman, Econometrica 46(6), 1978).
        """
        whole, beyond = self.errors(x) ** 2, []
        for first, last in PARTS:
            inside = (self.t >= first * self.t[-1]) & (self.t <= last * self.t[-1])
            t, y, slower = self.t[inside], self.y[inside], self.slower[inside]
            part = _Oscillation(t - t[0], y, slower)
            here = part.solved(x)
            beyond.append((here - x) ** 2 - np.maximum(part.errors(here) ** 2 - whole, 0.0))
        return np.asarray(np.sqrt(np.maximum(np.mean(beyond, axis=0), 0.0)), dtype=np.float64)

    def errors(self, x: FloatArray) -> FloatArray:
        """Return the standard errors of log w and zeta, for residuals as correlated as these are."""
        step = 1e-5 * np.eye(2)
        J = np.column_stack([(self.residuals(x + d) - self.residuals(x - d)) / 2e-5 for d in step])
        left = np.full_like(self.y, np.nan)
        left[np.isfinite(self.y)] = self.residuals(x)
        longer = fits.correlation_times([left], float(self.t[1] - self.t[0]))
        taken = 2.0 / left.shape[1] + 2.0 + self.slower.shape[1]
        free = np.maximum(np.isfinite(left).sum(axis=0) - taken, 1.0)
        power = longer * np.nansum(left**2, axis=0) / free
        inverse = np.linalg.pinv(J.T @ J) @ J.T
        own = power[np.nonzero(np.isfinite(self.y))[1]]  # each channel has its own noise
        return np.asarray(np.sqrt(np.einsum("in,n,in->i", inverse, own, inverse)), dtype=np.float64)
