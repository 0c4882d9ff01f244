"""Channels of one flight against each other: rates turn the attitude, velocity moves the position, force makes velocity.

The residuals hold for any vehicle. Offsets of sensors contradict nothing: means are taken off. Force makes the velocity through
the air as well, which tells of air data, and of all where no velocity over ground was recorded: a steady wind drops out of
accelerations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Hashable, Mapping
from dataclasses import dataclass, field
from typing import Final, TypeAlias

import numpy as np

from stoop import Notice
from stoop.extend import arrays
from stoop.extend.arrays import rotations
from stoop.extend.notices import notice
from stoop.extend.units import STANDARD_GRAVITY
from stoop.extend.variables import FAMILIES
from stoop_draft.checks.engine import Evidence, Key, Range, Residual, Residuals
from stoop_draft.checks.entries import Lines, where
from stoop_draft.checks.lines import AIRSPEEDS, VANES, Assignment, reading

EULER, QUATERNION, RATES, SPECIFIC_FORCE, VELOCITY = (
    FAMILIES[name] for name in ("euler", "quaternion", "rates", "specific force", "velocity")
)
MOVED_BY: Final = {"pn": "vn", "pe": "ve", "pd": "vd", "altitude": "vd"}  #: position <- its rate of change


@dataclass(frozen=True)
class Agreement:
    """How motions are compared, and limits for rates that follow the attitude, once wrong lines are corrected."""

    rate: float = 50.0  #: Hz at which motions are compared
    longest: int = 30_000  #: samples of that, ten minutes: the part of a longer record that moves most
    turn: float = 0.2  #: s over which rates are compared
    move: float = 1.0  #: s over which velocities and accelerations are
    #: rad/s, m/s2, m/s, m/s2; less is no motion
    floors: Mapping[str, float] = field(
        default_factory=lambda: {"turn": 0.01, "force": 0.05, "place": 0.1, "air": 0.3}
    )
    samples: int = 200  #: spans that are compared, at least
    turning: float = math.radians(3.0)  #: rad/s rms; less turning shows nothing
    followed: float = 0.8  #: share of the turning that a matching pair of channels explains
    gain: float = 0.15  #: departure from one that calibrated sensors do not have
    calibration: float = 0.03  #: departure of the gain of rates from one that no calibrated gyros have
    errors: float = 3.0  #: standard errors of that gain
    odds: float = 15.0  #: of such a gain
    separation: float = 0.05  #: s between attitudes whose noise is independent


LIMITS: Final = Agreement()
Columns: TypeAlias = Mapping[str, arrays.FloatArray]  #: variable -> (n,) SI, on one uniform grid


def thinned(data: Columns, rate: float) -> tuple[Columns, float]:
    """Return at most ten minutes of columns at about 50 Hz, those with most motion, and the rate [Hz]."""
    step = max(1, round(rate / LIMITS.rate))
    size, many = next(iter(data.values())).size, LIMITS.longest * step
    watched = [data[name] for name in (*RATES, *VELOCITY) if name in data]
    starts = range(0, max(size - many // 2, 1), many)
    parts = [[x[start : start + many] for x in watched] for start in starts]
    motions = [sum(float(np.std(x[np.isfinite(x)])) for x in part if np.isfinite(x).any()) for part in parts]
    first = starts[int(np.argmax(motions))]
    thin = {name: x[first : first + many : step] for name, x in data.items()}
    if set(QUATERNION) <= thin.keys() and not set(EULER) & thin.keys():
        angles = rotations.euler_angles(np.column_stack([thin[name] for name in QUATERNION]))
        thin |= dict(zip(EULER, angles.T, strict=True))
    return thin, rate / step


class Motion:
    """The kinematic residuals of columns at one rate [Hz]; what edits share is computed once."""

    def __init__(self, data: Columns, rate: float) -> None:
        self.data, self.rate = data, rate
        self.steps = max(2, round(LIMITS.move * rate))
        there = data.keys()
        self.turned = {*RATES, *EULER} <= there
        self.felt = {*SPECIFIC_FORCE, *EULER} <= there
        self.flown = self.felt and set(VELOCITY) <= there
        self.speed = next((name for name in AIRSPEEDS if name in there), "")
        self._kept: dict[Hashable, arrays.FloatArray] = {}
        self.turn = max(2, round(LIMITS.turn * rate))

    def __call__(self, state: Assignment, changed: Collection[str] | None) -> Residuals:
        """Return what disagrees in each channel that others predict, where some of those that changed take part."""

        def concerned(*names: str) -> bool:
            return changed is None or bool(set(names) & set(changed))

        out: dict[Key, Evidence] = {}
        parts: dict[
            Key, tuple[arrays.FloatArray, arrays.FloatArray]
        ] = {}  # measured, and predicted by the others
        if self.turned and concerned(*RATES, *EULER):
            implied = self._implied(state)
            for i, name in enumerate(RATES):
                parts["turn", name] = implied[:, i], self._mean(state, name, self.turn)
            out |= self._of_gains(state)
        for name, cause in MOVED_BY.items():
            if {name, cause} <= self.data.keys() and concerned(name, cause):
                moved = self._slope(state, name) * (-1.0 if name == "altitude" else 1.0)
                parts["place", name] = moved, self._mean(state, cause, self.steps)
        if self.flown and concerned(*EULER, *SPECIFIC_FORCE, *VELOCITY):
            felt = self._felt(state)
            for i, name in enumerate(VELOCITY):
                parts["force", name] = self._slope(state, name), felt[:, i]
        # accelerations over ground tell of forces and attitude already
        others = () if self.flown else (*EULER, *SPECIFIC_FORCE)
        if self.felt and self.speed and concerned(*AIRSPEEDS, *VANES, *others):
            felt, slopes = self._felt(state), self._air_slopes(state)
            for i, axis in enumerate("ned"):
                parts["air", axis] = slopes[:, i], felt[:, i]
        for key, (y, x) in parts.items():
            left = y - x
            known = left[np.isfinite(left)]
            if key[0] != "place" and known.size:
                left = left - float(known.mean())
            span = self.turn if key[0] == "turn" else LIMITS.move * self.rate
            out[key] = Residual(left, y, span, LIMITS.floors[key[0]] ** 2)
        return out

    def scales(self, state: Assignment) -> dict[tuple[str, ...], float]:
        """Return by what the attitude turns faster than the rates say, each and all, where that is no calibration."""
        gains = self._gains(state) if self.turned else {}
        return {
            names: gain for names, (gain, nearest) in gains.items() if abs(nearest - 1.0) > LIMITS.calibration
        }

    def attitude(self, state: Assignment) -> arrays.FloatArray:
        """Return the quaternions (n, 4), of edited angles where they are."""
        columns = tuple(reading(state, name) for name in EULER)
        if set(QUATERNION) <= self.data.keys() and columns == tuple((name, 1.0) for name in EULER):
            return self._keep("q", lambda: np.column_stack([self.data[name] for name in QUATERNION]))
        angles = (factor * self.data[column] for column, factor in columns)
        return self._keep(("q", columns), lambda: rotations.quaternions_of(np.column_stack([*angles])))

    def _keep(self, key: Hashable, make: Callable[[], arrays.FloatArray]) -> arrays.FloatArray:
        if key not in self._kept:
            self._kept[key] = make()
        return self._kept[key]

    def _readings(self, state: Assignment, names: Collection[str]) -> tuple[tuple[str, float], ...]:
        return tuple(reading(state, name) for name in names)

    def _slope(self, state: Assignment, name: str) -> arrays.FloatArray:
        (column, factor), steps = reading(state, name), self.steps
        x = self.data[column]
        return factor * self._keep(("slope", column), lambda: (x[steps:] - x[:-steps]) * self.rate / steps)

    def _mean(self, state: Assignment, name: str, steps: int) -> arrays.FloatArray:
        column, factor = reading(state, name)
        return factor * self._keep(("mean", column, steps), lambda: _means(self.data[column], steps))

    def _implied(self, state: Assignment) -> arrays.FloatArray:
        """Return the mean rates (m, 3) over a span that the attitude implies, rad/s."""
        steps, q = self.turn, self.attitude(state)
        return self._keep(
            ("implied", *self._readings(state, EULER)),
            lambda: rotations.between(q[:-steps], q[steps:]) * self.rate / steps,
        )

    def _gains(self, state: Assignment) -> dict[tuple[str, ...], tuple[float, float]]:
        """Return the gain of the attitude over each rate, and over all, and the gain nearest to one that is not excluded.

        Both are averaged over a second: the noise of angles divides by that, and what filters leave out is slow.
        """
        steps = max(2, self.steps - self.turn)
        implied = self._keep(
            ("slow", *self._readings(state, EULER)),
            lambda: np.column_stack([_means(x, steps) for x in self._implied(state).T]),
        )
        moments: dict[tuple[str, ...], arrays.FloatArray] = {}
        for y, name in zip(implied.T, RATES, strict=True):
            moments[name,] = _moments(y, _means(self._mean(state, name, self.turn), steps))
        moments[RATES] = np.sum([*moments.values()], axis=0)
        return {names: _gain(own, self.steps, len(names)) for names, own in moments.items()}

    def _of_gains(self, state: Assignment) -> Residuals:
        """Return the gains as evidence against calibrated sensors."""
        bounds = 1.0 - LIMITS.calibration, 1.0 + LIMITS.calibration
        gains = self._gains(state).items()
        return {("gain", *names): Range(nearest, *bounds, LIMITS.odds) for names, (_, nearest) in gains}

    def _felt(self, state: Assignment) -> arrays.FloatArray:
        """Return the mean acceleration (m, 3) over a span, north, east, down, that the specific force makes."""
        columns = self._readings(state, SPECIFIC_FORCE)

        def make() -> arrays.FloatArray:
            body = np.column_stack([factor * self.data[column] for column, factor in columns])
            felt = rotations.to_ground(self.attitude(state), body)
            felt[:, 2] += STANDARD_GRAVITY
            return np.column_stack([_means(x, self.steps) for x in felt.T])

        return self._keep(("felt", *self._readings(state, EULER), *columns), make)

    def _air_slopes(self, state: Assignment) -> arrays.FloatArray:
        """Return the mean change (m, 3) of the velocity through the air, north, east, down."""
        measured, steps = (self.speed, *VANES), self.steps

        def make() -> arrays.FloatArray:
            speed, alpha, beta = (self._column(state, name) for name in measured)
            side, ahead = speed * np.sin(beta), speed * np.cos(beta)
            body = np.column_stack([ahead * np.cos(alpha), side, ahead * np.sin(alpha)])
            through = rotations.to_ground(self.attitude(state), body)
            return np.asarray((through[steps:] - through[:-steps]) * self.rate / steps)

        return self._keep(("air", *self._readings(state, (*EULER, *measured))), make)

    def _column(self, state: Assignment, name: str) -> arrays.FloatArray:
        column, factor = reading(state, name)
        size = next(iter(self.data.values())).size
        return factor * self.data[column] if column in self.data else np.zeros(size)


def _moments(y: arrays.FloatArray, x: arrays.FloatArray) -> arrays.FloatArray:
    """Return count, yx, xx, yy, and yy and xx of neighbors, in which white noise is not, of two columns (n,)."""
    known = np.isfinite(x) & np.isfinite(y)
    y, x = y[known], x[known]
    if not x.size:
        return np.zeros(6)
    y, x = y - y.mean(), x - x.mean()
    return np.array([x.size, y @ x, x @ x, y @ y, y[1:] @ y[:-1], x[1:] @ x[:-1]])


def _gain(moments: arrays.FloatArray, span: float, axes: int) -> tuple[float, float]:
    """Return the gain of y over x, and the gain nearest to one that is not excluded; NaN where x hardly moves, or y otherwise.

    Both regressions bound the gain, whatever is late or noisy [1]_; samples of `span`, about each of the axes, are as good as
    one.

    References
    ----------
    .. [1] Fuller, *Measurement Error Models*, section 1.1.
    """
    count, yx, xx, yy, next_yy, next_xx = moments
    if min(yx, next_yy, next_xx) <= 0.0 or axes * xx < LIMITS.turning**2 * count:
        return math.nan, math.nan
    slope, power = yx / xx, next_yy / next_xx
    if slope**2 < LIMITS.followed * power:  # they have too little in common
        return math.nan, math.nan
    error = LIMITS.errors * math.sqrt(max(yy - yx * slope, 0.0) * span / (count * xx))
    low, high = min(slope, power / slope) - error, max(slope, power / slope) + error
    return math.sqrt(power), min(max(low, 1.0), high)


def _means(x: arrays.FloatArray, steps: int) -> arrays.FloatArray:
    """Return the mean over each span by the trapezoidal rule, NaN where a sample is missing."""
    known = np.nan_to_num(x)
    running = np.concatenate([[0.0], np.cumsum(0.5 * (known[1:] + known[:-1]))])
    gone = np.concatenate([[0], np.cumsum(~np.isfinite(x))])
    out: arrays.FloatArray = (running[steps:] - running[:-steps]) / steps
    out[gone[steps + 1 :] != gone[: -steps - 1]] = np.nan
    return out


def _mean_rates(
    data: Columns, span: float, rate: float
) -> tuple[arrays.FloatArray, arrays.FloatArray, arrays.FloatArray]:
    """Return the mean rates (n, 3) over a span [s] that the attitude implies and those measured, rad/s; and where."""
    steps = max(2, round(span * rate))
    attitude = np.column_stack([data[name] for name in QUATERNION])
    rates = np.column_stack([data[name] for name in RATES])
    running = np.concatenate([np.zeros((1, 3)), np.cumsum(np.nan_to_num(rates), axis=0)])
    known = np.isfinite(rates).all(axis=1) & np.isfinite(attitude).all(axis=1)
    gone = np.concatenate([[0], np.cumsum(~known)])
    first = np.arange(len(attitude) - steps)
    first = first[gone[first + steps + 1] == gone[first]]
    mean = (running[first + steps + 1] - running[first] - 0.5 * (rates[first] + rates[first + steps])) / steps
    turned = rotations.between(attitude[first], attitude[first + steps])
    return turned * rate / steps, mean, first


def check_rates(data: Columns, rate: float, lines: Lines) -> list[Notice]:
    """Compare body rates with those that the attitude implies: scale, clipping, lag, or nothing in common.

    The columns are gridded at `rate` [Hz], SI, signs and axes already corrected.
    """
    if not {*RATES, *QUATERNION} <= data.keys():
        return []
    implied, measured, first = _mean_rates(data, LIMITS.turn, rate)
    if len(first) < LIMITS.samples:
        return []
    # How far the attitude scatters beside what the rates say: second differences over a time longer than the grid's
    # filter remembers, and their median, which passes over maneuvers in which both disagree.
    steps = max(1, round(LIMITS.separation * rate))
    close, rates, at = _mean_rates(data, LIMITS.separation, rate)
    left = np.full((len(data["q0"]), 3), np.nan)
    left[at] = (close - rates) * max(2, steps) / rate
    jumps = left[steps:] - left[:-steps]
    known = jumps[np.isfinite(jumps).all(axis=1)]
    noise = 1.4826 * np.median(np.abs(known), axis=0) / np.sqrt(6.0) if len(known) else np.zeros(3)
    noise = noise * np.sqrt(2.0) * rate / max(2, round(LIMITS.turn * rate))
    implied, measured = implied - implied.mean(axis=0), measured - measured.mean(axis=0)
    out = []
    for i, name in enumerate(RATES):
        y, x = implied[:, i], measured[:, i]
        size = float(np.sqrt(np.mean(y**2)))
        turning = np.sqrt(max(size**2 - noise[i] ** 2, 0.0))
        if turning < max(LIMITS.turning, noise[i]):
            continue
        power = float(y @ y) * float(x @ x)
        correlation = float(y @ x) / np.sqrt(power) * size / turning if power > 0.0 else 0.0
        gain = float(y @ x) / float(x @ x) if power > 0.0 else 0.0
        unlike = abs(correlation) ** 2 < LIMITS.followed
        if unlike or abs(gain - 1.0) > LIMITS.gain:
            values = {"correlation": float(correlation), "gain": float(gain)}
            code = "rate-unlike-attitude" if unlike else "rate-scale"
            out.append(notice(code, name, **values, line=where((name,), lines)))
    return out
