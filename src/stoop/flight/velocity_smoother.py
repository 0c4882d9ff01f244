"""Ground velocity at the rate of the accelerometers: strapdown integration tied to the logged velocity.

A navigation velocity is logged at about 5 to 10 Hz, too slow for the incidence angles of a doublet; the
accelerometers are fast but drift. A fixed-interval smoother joins them [1]_, [2]_::

    dv/dt   = R (f - b) + g + e (z x R f) + white noise of density q     v  ground velocity, NED
    db/dt   = slow random walk                                           b  accelerometer bias, body
    de/dt   = slow random walk                                           e  error of the heading
    logged  = v(t - delay) + white noise of variance r                   R  body -> NED, f specific force

The filter steps from knot to knot at the velocity's own rate (the dataset holds interpolated values: taking
each of them would count the same information ten times). Between knots the specific force is integrated
beforehand [3]_, and the mismatch left at the two ends is spread linearly, which is the exact conditional
mean under white noise. Across a gap of the inertial data the velocity is forgotten and the bias remembered.

References
----------
.. [1] Rauch, Tung, Striebel, "Maximum likelihood estimates of linear dynamic systems", AIAA J. 3 (1965) 1445.
.. [2] Klein, Morelli, "Aircraft System Identification", 2nd ed., ch. 10 (data compatibility).
.. [3] Forster et al., "On-manifold preintegration for real-time visual-inertial odometry", IEEE Trans.
   Robotics 33 (2017) 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import BoolArray, FloatArray, IntArray
from stoop.base.units import DEGREE, STANDARD_GRAVITY
from stoop.flight.gridding import complete
from stoop.flight.instrument_errors import prior_std

SIZE: Final = 7  #: of the state: velocity (3), accelerometer bias (3), heading error (1)


class Priors:
    """Initial standard deviations of the state, and its random walks per square root of a second."""

    velocity: Final = 100.0  #: m/s, nothing is known
    bias: Final = 0.5  #: m/s2; wider than that of the instrument: errors of roll and pitch look like a bias
    heading: Final = prior_std("psi.bias")
    bias_walk: Final = 0.01  #: m/s2: 0.1 m/s2 in 100 s
    heading_walk: Final = 0.1 * DEGREE  #: of a compass and its filter


class Limits:
    """How noise and delay are estimated, and what is given."""

    rate: Final = 0.1  #: Hz; a velocity without a rate of its own is taken this seldom
    lags: Final = 20  #: knots over which the two kinds of noise are separated
    logged: Final = 5e-3  #: m/s, least noise of the logged velocity
    force: Final = 0.03  #: m/s2 per square root of Hz, least noise of the specific force
    chi2: Final = 2.366  #: median of a chi-square variable of three degrees of freedom
    passes: Final = 5  #: to find the delay
    delay: Final = 0.015  #: s; a shorter one is reported but not corrected
    std: Final = 1.0  #: m/s; where the standard deviation is above, the velocity is not given


@dataclass(frozen=True)
class Smoothed:
    """Result of the smoother."""

    velocity: FloatArray  #: (N, 3) m/s, NED, NaN where the inertial data are missing or the velocity is not tied down
    std: FloatArray  #: (N,) m/s, standard deviation per axis
    bias: FloatArray  #: (3,) m/s2, accelerometer bias in body axes, mean over the flight
    bias_std: FloatArray
    heading_error: float  #: rad; true heading = logged heading + error
    heading_error_std: float
    delay: float  #: s, by which the logged velocity is late
    delay_std: float
    logged_noise: float  #: m/s, white noise of the logged velocity
    force_noise: float  #: m/s2 per square root of Hz, density of the noise of the specific force


@dataclass(frozen=True)
class _Path:
    """Running integrals (trapezoidal) that stand still outside the stretches of inertial data.

    n = sample: label (n,) of the stretch, clock (n,) s, force (n, 3) of R f, turn (n, 3, 3) of R, velocity (n, 3) m/s
    gained without bias, NED; ends: first and last sample of each stretch.
    """

    step: float
    label: IntArray
    clock: FloatArray
    force: FloatArray
    turn: FloatArray
    velocity: FloatArray
    ends: IntArray


_Ties = tuple[IntArray, FloatArray]  #: logged velocities (k, 3) m/s NED, each at the sample where it was true


def smooth_velocity(
    time: FloatArray, rotation: FloatArray, force: FloatArray, logged: FloatArray, rate: float
) -> Smoothed | None:
    """Smooth the ground velocity over a whole flight; NaN where there is no data.

    Parameters
    ----------
    time : (N,) s, uniform
    rotation : (N, 3, 3), body -> NED
    force : (N, 3) m/s2, specific force, body
    logged : (N, 3) m/s, NED, over ground
    rate : Hz at which the velocity was recorded, before it was interpolated

    Returns
    -------
    Smoothed, or None where no stretch of inertial data holds a logged velocity
    """
    path = _integrate(time, rotation, force)
    stride = max(1, round(1.0 / (max(rate, Limits.rate) * path.step)))
    late, delay, delay_std = 0, 0.0, np.inf
    ties = _ties(logged, path, stride, 0)
    for _ in range(Limits.passes):
        more, delay_std = _delay(path, ties, stride)
        delay = late * path.step + more
        shift = round(delay / path.step) if abs(delay) > max(3.0 * delay_std, Limits.delay) else 0
        if shift == late:
            break
        late, ties = shift, _ties(logged, path, stride, shift)
    if ties[0].size < 2:
        return None
    logged_noise, force_noise = _noise_levels(path, ties)
    holes = np.flatnonzero((path.label >= 0) & ~complete(logged))[::stride]
    knots = np.unique(np.concatenate([ties[0], path.ends, holes]))
    states, covariances = _smooth(path, knots, ties, logged_noise, force_noise)
    variances = np.diagonal(covariances, axis1=1, axis2=2)
    mean, spread = states[:, 3:].mean(axis=0), np.sqrt(variances[:, 3:].mean(axis=0))
    # Between knots: the integral with the mean bias, and what is left over spread linearly
    course = path.velocity - path.turn @ mean[:3]
    course += mean[3] * np.column_stack([-path.force[:, 1], path.force[:, 0], np.zeros(path.clock.size)])
    sample = np.arange(path.clock.size)
    left = states[:, :3] - course[knots]
    velocity = course + np.column_stack([np.interp(sample, knots, column) for column in left.T])
    std = np.interp(sample, knots, np.sqrt(np.maximum(variances[:, :3].mean(axis=1), 0.0)))
    bad = (path.label < 0) | (std > Limits.std)
    velocity[bad], std[bad] = np.nan, np.nan
    return Smoothed(
        velocity, std, mean[:3], spread[:3], float(mean[3]), float(spread[3]),
        delay, delay_std, logged_noise, force_noise,
    )  # fmt: skip


def _labels(valid: BoolArray) -> IntArray:
    """Give each run of valid samples its number, from 0; -1 elsewhere."""
    before = np.concatenate([[False], valid[:-1]])
    return np.where(valid, np.cumsum(valid & ~before) - 1, -1).astype(np.intp)


def _integrate(time: FloatArray, rotation: FloatArray, force: FloatArray) -> _Path:
    step = float(np.median(np.diff(time)))
    force = np.einsum("nij,nj->ni", rotation, force)
    valid = complete(force)
    label = _labels(valid)
    inside = (label[1:] == label[:-1]) & valid[1:]
    edges = valid & ~(np.append(inside, False) & np.insert(inside, 0, False))
    # columns: clock, R f, R
    values = np.column_stack([np.ones(valid.size), force, rotation.reshape(-1, 9)])
    pieces = np.where(inside[:, None], 0.5 * step * (values[1:] + values[:-1]), 0.0)
    integral = np.concatenate([np.zeros((1, 13)), np.cumsum(pieces, axis=0)])
    clock, gained, turn = integral[:, 0], integral[:, 1:4], integral[:, 4:].reshape(-1, 3, 3)
    fallen = np.column_stack([np.zeros((clock.size, 2)), STANDARD_GRAVITY * clock])
    return _Path(step, label, clock, gained, turn, gained + fallen, np.flatnonzero(edges))


def _ties(logged: FloatArray, path: _Path, stride: int, late: int) -> _Ties:
    """Take the logged velocities at their own rate, `late` samples later than they were true."""
    label = _labels(complete(logged))
    start = np.flatnonzero((label >= 0) & (np.insert(label[:-1], 0, -1) != label))
    count = np.arange(label.size) - start[label] if start.size else np.zeros(label.size, dtype=np.intp)
    taken = np.flatnonzero((label >= 0) & (count % stride == 0))
    taken = taken[(taken >= late) & (taken - late < label.size)]
    taken = taken[path.label[taken - late] >= 0]
    return taken - late, logged[taken]


def _delay(path: _Path, ties: _Ties, stride: int) -> tuple[float, float]:
    """Regress the mismatch of successive velocities on the change of acceleration.

    logged(t) = v(t - delay) ~ v(t) - delay dv/dt, so d(logged - v) = -delay d(dv/dt).
    """
    index, velocity = ties
    mismatch = velocity - path.velocity[index]
    same = path.label[index[1:]] == path.label[index[:-1]]
    jump = np.diff(mismatch, axis=0)[same].ravel()
    span = max(1, stride // 2)
    low, high = (np.clip(index + side, 0, path.clock.size - 1) for side in (-span, span))
    lapse = np.maximum(path.clock[high] - path.clock[low], path.step)
    acceleration = (path.velocity[high] - path.velocity[low]) / lapse[:, None]
    change = np.diff(acceleration, axis=0)[same].ravel()
    power = float(change @ change)
    if jump.size < 10 or power <= 0.0:
        return 0.0, np.inf
    delay = -float(jump @ change) / power
    return delay, float(np.std(jump + delay * change) / np.sqrt(power))


def _noise_levels(path: _Path, ties: _Ties) -> tuple[float, float]:
    """Tell the noise of the velocity from that of the force by how their mismatch grows with time.

    Structure function per axis over a lag h: E[(m(t + h) - m(t))^2] = 2 r + q h, with m the logged velocity
    minus the integrated one. Medians keep jumps of the navigation filter out. Bias and tilt, which grow
    with h^2, are left in q: they vary slowly, and a filter that took them for constant would be overconfident.

    Returns
    -------
    sqrt(r) m/s, sqrt(q) m/s2 per square root of Hz
    """
    from scipy.optimize import nnls  # heavy, and only here

    index, velocity = ties
    mismatch = velocity - path.velocity[index]
    rows = []
    for lag in range(1, Limits.lags + 1):
        later, earlier = index[lag:], index[:-lag]
        same = path.label[later] == path.label[earlier]
        if np.count_nonzero(same) >= 10:
            squares = np.sum((mismatch[lag:] - mismatch[:-lag]) ** 2, axis=1)[same]
            elapsed = float(np.mean((path.clock[later] - path.clock[earlier])[same]))
            rows.append((elapsed, max(float(np.median(squares)) / Limits.chi2, Limits.logged**2)))
    if len(rows) < 3:
        return 0.1, 0.3
    lapse, growth = np.array(rows).T
    design = np.column_stack([np.full_like(lapse, 2.0), lapse]) / growth[:, None]
    (logged, force), _ = nnls(design, np.ones_like(lapse))
    return max(float(np.sqrt(logged)), Limits.logged), max(float(np.sqrt(force)), Limits.force)


def _smooth(
    path: _Path, knots: IntArray, ties: _Ties, logged_noise: float, force_noise: float
) -> tuple[FloatArray, FloatArray]:
    """Run the Kalman filter from knot to knot, and back the Rauch-Tung-Striebel recursion.

    x[k+1] = transition[k] x[k] + (gain[k], 0) + noise; returns mean (K, 7) and covariance (K, 7, 7).
    """
    before, after, count = knots[:-1], knots[1:], knots.size
    lapse = path.clock[after] - path.clock[before]
    broken = path.label[after] != path.label[before]
    force = path.force[after] - path.force[before]
    transition = np.tile(np.eye(SIZE), (before.size, 1, 1))
    transition[:, :3, 3:6] = path.turn[before] - path.turn[after]
    transition[:, 0, 6], transition[:, 1, 6] = -force[:, 1], force[:, 0]
    noise = np.zeros((before.size, SIZE))
    noise[:, :3] = np.where(broken, Priors.velocity**2, force_noise**2 * lapse)[:, None]
    elapsed = path.step * (after - before)
    noise[:, 3:] = elapsed[:, None] * np.array([Priors.bias_walk] * 3 + [Priors.heading_walk]) ** 2
    gain = path.velocity[after] - path.velocity[before]
    index, velocity = ties
    logged = np.full((count, 3), np.nan)
    logged[np.searchsorted(knots, index)] = velocity
    tied = np.isfinite(logged[:, 0]).tolist()

    x = np.concatenate([velocity[0], np.zeros(SIZE - 3)])
    P = np.diag(np.array([Priors.velocity] * 3 + [Priors.bias] * 3 + [Priors.heading]) ** 2)
    predicted_x, predicted_P = np.empty((count, SIZE)), np.empty((count, SIZE, SIZE))
    smooth_x, smooth_P = np.empty((count, SIZE)), np.empty((count, SIZE, SIZE))
    for k in range(count):
        if k:
            F = transition[k - 1]
            x, P = F @ x, F @ P @ F.T
            x[:3] += gain[k - 1]
            P.flat[:: SIZE + 1] += noise[k - 1]
        predicted_x[k], predicted_P[k] = x, P
        if tied[k]:
            innovation = P[:3, :3].copy()
            innovation.flat[::4] += logged_noise**2
            K = P[:, :3] @ np.linalg.inv(innovation)
            x, P = x + K @ (logged[k] - x[:3]), P - K @ P[:3, :]
            P = 0.5 * (P + P.T)
        smooth_x[k], smooth_P[k] = x, P
    gains = np.linalg.solve(predicted_P[1:], transition @ smooth_P[:-1]).transpose(0, 2, 1)
    for k in range(count - 2, -1, -1):
        smooth_x[k] += gains[k] @ (smooth_x[k + 1] - predicted_x[k + 1])
        smooth_P[k] += gains[k] @ (smooth_P[k + 1] - predicted_P[k + 1]) @ gains[k].T
    return smooth_x, smooth_P
