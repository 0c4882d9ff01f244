"""Steps and drifts in a sequence of flights: generalized likelihood ratios, at a stated rate of false alarms.

The readings of one vehicle and figure are normal with known standard deviations about the sum of effects: the vehicle's level,
those of its parts while it carries them, perhaps a trend. The effects are normal with known deviations, from the fleet, or
nothing is known of them. For every flight k the likelihood of a step, or of a drift that begins there, is compared with that of
no change, its size being unknown. Flights in which a change is likelier to begin, as after an exchange, are favored by the
logarithm of that. The largest ratio over k is the statistic of a flight; the first that exceeds a threshold is an alarm. What
began when is estimated anew with every later flight, until a further change shows.

References
----------
.. [1] G. Lorden, "Procedures for reacting to a change in distribution", Annals of Mathematical Statistics 42 (1971) 1897.
.. [2] D. Siegmund, E. S. Venkatraman, "Using the generalized likelihood ratio statistic for sequential detection of a
   change-point", Annals of Statistics 23 (1995) 255.
.. [3] M. Basseville, I. V. Nikiforov, *Detection of Abrupt Changes*, Prentice Hall, 1993, sections 2.4 and 8.3.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from typing import Final, Literal

import numpy as np

from stoop.extend.arrays import FloatArray, IntArray
from stoop.extend.fits import NORMAL_95

Kind = Literal["step", "drift"]
KINDS: Final[tuple[Kind, ...]] = ("step", "drift")
EXACT: Final = 1e-9  #: share of the information about a size, below which it is none
TAIL: Final = 0.05  #: share of simulated statistics whose excess is taken for exponential
LEAST: Final = 1e-6  #: expected alarms, at least: none at all would need an infinite threshold
FADED: Final = 2.0 * math.log(10.0)  #: see `changes`
DENSE: Final = 64  #: see `_lags`
STEP: Final = 0.05
LANES: Final = 256  #: sequences that are scanned side by side
CELLS: Final = 200_000  #: sizes that are computed together


@dataclass(frozen=True, eq=False)
class Readings:
    """A sequence of one vehicle and figure, in order of time.

    Attributes
    ----------
    values : (n,) less the mean of the fleet
    deviations : (n,) known standard deviations, of flight and estimate together
    times : (n,) by which a drift grows, such as flights or days; rising
    effects : (n, m) of each effect on each reading; the level is a column of ones
    spread : (m,) standard deviations of the effects; infinite where nothing is known
    onsets : (2, n) by kind, twice the logarithm of how much likelier a change begins in a flight than in others; (2, 0) where
        all are alike
    """

    values: FloatArray
    deviations: FloatArray
    times: FloatArray
    effects: FloatArray
    spread: FloatArray
    onsets: FloatArray = field(default_factory=lambda: np.zeros((len(KINDS), 0)))

    @classmethod
    def about_a_level(
        cls, values: FloatArray, deviations: FloatArray, times: FloatArray, spread: float = np.inf
    ) -> Readings:
        """Return readings about the level of the vehicle alone."""
        return cls(values, deviations, times, np.ones((len(values), 1)), np.array([spread]))

    def since(self, change: Change) -> Readings:
        """Return the readings from a change on: of the level nothing is known then, and of the trend after a drift."""
        rows, begun = slice(change.first, None), self.times[change.first :]
        columns, spread = [np.ones(len(begun))], [np.inf]
        if change.kind == "drift":
            columns.append(begun - begun[0])
            spread.append(np.inf)
        own = np.isfinite(self.spread)
        effects = np.column_stack([*columns, self.effects[rows, own]])
        return Readings(
            self.values[rows],
            self.deviations[rows],
            begun,
            effects,
            np.concatenate([spread, self.spread[own]]),
            self.onsets[:, rows],
        )

    def since_flight(self, first: int) -> Readings:
        """Return the readings from a flight on, of whose level nothing is known."""
        return self.since(Change("step", first, first, np.nan, np.nan, np.nan))

    def until(self, end: int) -> Readings:
        """Return the readings before a flight."""
        own = slice(None, end)
        return Readings(
            self.values[own],
            self.deviations[own],
            self.times[own],
            self.effects[own],
            self.spread,
            self.onsets[:, own],
        )

    @property
    def favor(self) -> FloatArray:
        """What is added to the statistic of a change (2, n) that begins in a flight."""
        return self.onsets if self.onsets.shape[1] else np.zeros((len(KINDS), len(self.values)))

    def drawn(self, count: int, rng: np.random.Generator) -> FloatArray:
        """Return values (count, n) without a change; effects of which nothing is known are zero."""
        known = np.where(np.isfinite(self.spread), self.spread, 0.0)
        effects = rng.standard_normal((count, len(known))) * known
        return effects @ self.effects.T + self.deviations * rng.standard_normal((count, len(self.values)))


@dataclass(frozen=True)
class Change:
    """A change that was found.

    Attributes
    ----------
    kind : step or drift
    first : index of the flight in which it began
    found : index of the flight in which the threshold was exceeded
    size : of a step, unit of the figure; of a drift per unit of time; by all flights before a further change
    error : standard error of the size
    statistic : in the flight of the alarm: twice the logarithm of the likelihood ratio, and what favors its beginning
    """

    kind: Kind
    first: int
    found: int
    size: float
    error: float
    statistic: float

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval of the size."""
        return self.size - NORMAL_95 * self.error, self.size + NORMAL_95 * self.error

    def takes_back(self, other: Change) -> bool:
        """Tell whether its step rather takes back the one before than leads to a further level.

        Bayes factor of a sum of zero over one that is normal about zero with the size of the steps.
        """
        if {self.kind, other.kind} != {"step"} or self.size * other.size >= 0.0:
            return False
        left, variance = (self.size + other.size) ** 2, self.error**2 + other.error**2
        spread = variance + 0.5 * (self.size**2 + other.size**2)
        return left * (1.0 / variance - 1.0 / spread) < math.log(spread / variance)

    def course(self, times: FloatArray) -> FloatArray:
        """Return what the change adds to readings at times (n,) of its sequence."""
        if self.kind == "step":
            return np.where(np.arange(len(times)) >= self.first, self.size, 0.0)
        return np.asarray(self.size * np.maximum(times - times[self.first - 1], 0.0))


@dataclass(frozen=True, eq=False)
class Scan:
    """Likelihood ratios after each flight.

    Attributes
    ----------
    statistic : (B, n) largest over kind and first flight of the change, with what favors these
    first : (B, n) flight in which the likeliest change began
    kind : (B, n) index in `KINDS`
    """

    statistic: FloatArray
    first: IntArray
    kind: IntArray


def scan(readings: Readings, values: FloatArray | None = None) -> Scan:
    """Return the likelihood ratios of a sequence, or of others (B, n) with its times, deviations and effects."""
    lanes = readings.values[None, :] if values is None else values
    found = [_scanned(readings, lanes[i : i + LANES]) for i in range(0, len(lanes), LANES)]
    names = ("statistic", "first", "kind")
    return Scan(*(np.concatenate([getattr(one, name) for one in found]) for name in names))


def _scanned(readings: Readings, values: FloatArray) -> Scan:
    sums, favor = _Sums.of(readings, values), readings.favor
    lanes, flights = values.shape
    shape = flights, lanes
    statistic, first, kind = np.zeros(shape), np.zeros(shape, np.intp), np.zeros(shape, np.intp)
    lags, favored = _lags(flights), np.flatnonzero(favor.any(axis=0))
    together = max(1, CELLS // ((len(lags) + len(favored)) * lanes))
    for begin in range(1, flights, together):
        own = slice(begin, min(begin + together, flights))
        t = np.arange(own.start, own.stop)
        begun = np.hstack([t[:, None] + 1 - lags, np.where(favored <= t[:, None], favored, 0)])
        for which, (size, variance) in enumerate(sums.sizes(t, np.maximum(begun, 1))):
            told = np.isfinite(variance) & (begun > 0)
            ratio = size**2 / np.where(told, variance, np.inf)[:, :, None]
            ratio += np.where(told, favor[which, np.maximum(begun, 1)], 0.0)[:, :, None]
            k = np.argmax(ratio, axis=1)
            best = np.take_along_axis(ratio, k[:, None], axis=1)[:, 0]
            better = best > statistic[own]
            statistic[own][better], kind[own][better] = best[better], which
            first[own][better] = np.take_along_axis(begun, k, axis=1)[better]
    return Scan(statistic.T, first.T, kind.T)


def _lags(flights: int) -> IntArray:
    """Return how many flights ago a change may have begun: each of the last `DENSE`, further back in steps of `STEP` of them."""
    steps = np.arange(math.log(max(flights / DENSE, 1.0)) / math.log(1.0 + STEP) + 1.0)
    sparse = (DENSE * (1.0 + STEP) ** steps).astype(np.intp)
    return np.unique(np.concatenate([np.arange(1, DENSE + 1), sparse]))


@dataclass(frozen=True, eq=False)
class _Sums:
    """Cumulative weighted sums, from which the regression on a change follows for every stretch.

    The entry i of each is the sum over the flights before i.
    """

    times: FloatArray
    weights: FloatArray  #: (3, n + 1) of w, w x and w x^2
    values: FloatArray  #: (2, n + 1, B) of w y and w x y
    effects: FloatArray  #: (2, n + 1, m) of w N and w x N
    inverses: FloatArray  #: (n + 1, m, m) of the sum of w N N' and the precisions of the effects
    projected: FloatArray  #: (n + 1, B, m) of w y N

    @classmethod
    def of(cls, readings: Readings, values: FloatArray) -> _Sums:
        w, x, N = readings.deviations**-2.0, readings.times - readings.times[:1], readings.effects

        def summed(terms: FloatArray, axis: int) -> FloatArray:
            width = [(0, 0)] * terms.ndim
            width[axis] = (1, 0)
            return np.cumsum(np.pad(terms, width), axis=axis)

        normal = summed(w[:, None, None] * N[:, :, None] * N[:, None, :], 0) + np.diag(readings.spread**-2.0)
        diagonal = np.diagonal(normal, axis1=1, axis2=2)
        scale = np.sqrt(diagonal) + (diagonal == 0.0)
        scales = scale[:, :, None] * scale[:, None, :]
        return cls(
            x,
            summed(np.array([w, w * x, w * x**2]), 1),
            summed(np.array([w[:, None] * values.T, (w * x)[:, None] * values.T]), 1),
            summed(np.array([w[:, None] * N, (w * x)[:, None] * N]), 1),
            np.linalg.pinv(normal / scales, EXACT, hermitian=True) / scales,
            summed((w * values).T[:, :, None] * N[:, None, :], 0),
        )

    def sizes(self, t: IntArray, begun: IntArray) -> list[tuple[FloatArray, FloatArray]]:
        """Return size (T, k, B) and variance (T, k) of each kind of change, by when it began (T, k), up to each of flights (T,).

        A step regresses on one, a drift on the time since the flight before it began. Where the flights tell nothing of a size
        its variance is infinite.
        """
        end = t + 1
        w, wx, wxx = self.weights[:, end, None] - self.weights[:, begun]
        wy, wxy = self.values[:, end, None] - self.values[:, begun]
        wN, wxN = self.effects[:, end, None] - self.effects[:, begun]
        origin = self.times[begun - 1]
        regressors = (
            (w, wy, wN),
            (
                wxx - 2.0 * origin * wx + origin**2 * w,
                wxy - origin[..., None] * wy,
                wxN - origin[..., None] * wN,
            ),
        )
        out = []
        for square, slope, on_effects in regressors:
            along = on_effects @ self.inverses[end]
            information = square - np.sum(along * on_effects, axis=-1)
            known = information > EXACT * square
            with np.errstate(divide="ignore", invalid="ignore"):
                left = slope - along @ self.projected[end].transpose(0, 2, 1)
                size = np.where(known[..., None], left / information[..., None], 0.0)
                out.append((size, np.where(known, 1.0 / information, np.inf)))
        return out


def sizes(readings: Readings, kind: Kind) -> tuple[FloatArray, FloatArray]:
    """Return size and variance (n - 1,) of a change that began in the second flight to the last, by all of them."""
    sums, last = _Sums.of(readings, readings.values[None, :]), len(readings.values) - 1
    size, variance = sums.sizes(np.array([last]), np.arange(1, last + 1)[None])[KINDS.index(kind)]
    return size[0, :, 0], variance[0]


def changes(readings: Readings, threshold: float) -> Iterator[Change]:
    """Yield the changes whose likelihood ratio exceeds a threshold, and a tenth of it by the last flight before a further one."""
    begin, own = 0, readings
    while len(own.values) > 1:
        change = _first_change(own, threshold)
        if change is None:
            return
        yield replace(change, first=begin + change.first, found=begin + change.found)
        begin, own = begin + change.first, own.since(change)


def _first_change(own: Readings, threshold: float) -> Change | None:
    found, begin = scan(own), 0
    for alarm in np.flatnonzero(found.statistic[0] > threshold).tolist():
        if alarm < begin:
            continue
        change, last = _estimated(own, found, alarm, threshold)
        if found.statistic[0, last] > threshold - FADED:
            return change
        begin = last + 1  # later flights speak against it
    return None


def _estimated(own: Readings, found: Scan, alarm: int, threshold: float) -> tuple[Change, int]:
    """Return a change that began by an alarm, as the flights tell it before a further one shows, and the last of these."""
    further: dict[tuple[int, Kind], FloatArray] = {}

    def likeliest(t: int) -> Change:
        kind, ratio = KINDS[int(found.kind[0, t])], float(found.statistic[0, alarm])
        return Change(kind, int(found.first[0, t]), alarm, np.nan, np.nan, ratio)

    change, last = likeliest(alarm), alarm
    for t in range(alarm + 1, len(own.values)):
        now = likeliest(t)
        place = now.first, now.kind
        if place not in further:
            further[place] = scan(own.since(now)).statistic[0]
        if now.first > alarm or further[place][t - now.first] > threshold:
            break
        change, last = now, t
    size, variance = (one[:alarm] for one in sizes(own.until(last + 1), change.kind))
    at = int(np.argmax(size**2 / variance + own.favor[KINDS.index(change.kind), 1 : alarm + 1]))
    return replace(change, first=at + 1, size=float(size[at]), error=float(np.sqrt(variance[at]))), last


def peaks(readings: Readings, draws: int, rng: np.random.Generator) -> FloatArray:
    """Return the largest statistic (1 + draws,) of a sequence, and of sequences without a change that are drawn like it."""
    lanes = np.vstack([readings.values, readings.drawn(draws, rng)])
    return np.asarray(scan(readings, lanes).statistic.max(axis=1, initial=0.0))


def threshold(drawn: FloatArray, expected: float) -> float:
    """Return the threshold that `expected` of the largest statistics (m,) without a change exceed on average.

    Beyond the largest of them that `TAIL` tells the excess is exponential, as that of chi-square is nearly.
    """
    every = np.sort(drawn)[::-1]
    k = min(max(round(expected), math.ceil(TAIL * len(every))), len(every) - 1)
    if k < 1 or expected >= k:
        return float(every[k])
    return float(every[k] + np.mean(every[:k] - every[k]) * np.log(k / max(expected, LEAST)))
