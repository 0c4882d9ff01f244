"""The trivial model beside every figure: a first-order lag with dead time and bias for each channel of each maneuver.

``tau dy/dt + y = K u(t - delay) + b``. Given tau and the delay, the gains K, the bias b of every maneuver and the initial
value of every segment are linear: variable projection (G. Golub and V. Pereyra, SIAM J. Numer. Anal. 10, 1973) leaves a
search in two dimensions.

In a fit maneuver the lag has its own axis's command and is fitted to that maneuver. In a validation maneuver it has all
commands, gains and times of the fit maneuvers, and its own bias, for a lag knows no trim.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.signal import lfilter

from stoop.assessment.goodness_of_fit import BLOCK, Match, join, left_out
from stoop.base.arrays import FloatArray, IntArray
from stoop.results.result import Role

OWN_COMMANDS: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("p", "phi"), ("control_roll", "aileron", "rotors_roll")),
    "ay": ("control_yaw", "rudder", "rotors_roll"),
    "ve": ("rotors_roll",),
    **dict.fromkeys(("q", "theta", "ax"), ("control_pitch", "elevator", "rotors_pitch")),
    "vn": ("rotors_pitch",),
    **dict.fromkeys(("V", "alpha"), ("control_pitch", "elevator")),
    "az": ("control_pitch", "elevator", "rotors_heave"),
    "vd": ("rotors_heave",),
    **dict.fromkeys(("r", "psi"), ("control_yaw", "rudder", "rotors_yaw")),
    "beta": ("control_yaw", "rudder"),
}  #: channel -> its axis's command, the first that there is
#: s, where the search looks first: a shorter lag is a plain gain at any usual sample rate, a longer one an integrator
TIME_CONSTANTS: Final = np.geomspace(0.005, 10.0, 20)
DEAD_TIMES: Final = np.arange(0.0, 0.29, 0.04)  #: s, where the search looks first
REACH: Final = 3  #: steps of the grid of time constants, to either side, in the search from sample to sample
PARABOLAS: Final = 5  #: steps of the search between samples of the grid of time constants
BLOCK_SIZE: Final = 2**17  #: numbers of designs that are solved together, which a processor's cache holds
START: Final = 0.2  #: s; a prediction starts from the mean of these first measurements


@dataclass(frozen=True, eq=False)
class BaselineSegment:
    """One segment of a maneuver."""

    commands: Mapping[str, FloatArray]  #: (n,), or surfaces; complete; the same names in every segment
    measured: Mapping[str, FloatArray]  #: (n,), by channel; NaN where missing; angles unwrapped


@dataclass(frozen=True, eq=False)
class BaselineManeuver:
    """A maneuver as the trivial model sees it; `rate` is its sample rate, Hz."""

    role: Role
    segments: tuple[BaselineSegment, ...]
    rate: float

    def records(self, channel: str, number: int = 0, own: bool = False) -> list[LagRecord]:
        """Return the segments with all commands, or with the channel's `own` where there is one; none without any."""
        names, out = list(self.segments[0].commands) if self.segments else [], []
        if own:
            names = [name for name in OWN_COMMANDS.get(channel, ()) if name in names][:1] or names
        for segment in self.segments if names else ():
            driving = np.column_stack([segment.commands[name] for name in names])
            measured = segment.measured.get(channel, np.full(len(driving), np.nan))
            out.append(LagRecord(driving, measured, number))
        return out


def baseline_matches(
    maneuvers: Sequence[BaselineManeuver], channels: Sequence[str]
) -> tuple[dict[str, Match], ...]:
    """Return what the lag makes of every channel of every maneuver; a channel without enough measurements is left out.

    What predicts learns from the fit maneuvers sampled as the first of them is; a lag is continuous in time, so it predicts
    at any rate. Segments are joined by one NaN. Without any fit maneuver the validation maneuvers have no curves.
    """
    found: tuple[dict[str, Match], ...] = tuple({} for _ in maneuvers)
    fitted = [m for m in maneuvers if m.role == "fit"]
    alike = [m for m in fitted if abs(m.rate - fitted[0].rate) < 1e-6 * m.rate]  # two clocks read from a file
    joint: Sequence[Lag | None] = [None] * len(channels)
    # the lag that predicts is given all commands of all fit maneuvers
    if alike and len(fitted) < len(maneuvers):
        learned = [[r for i, m in enumerate(alike) for r in m.records(channel, i)] for channel in channels]
        joint = fit_lags(learned, alike[0].rate)
    for maneuver, matches in zip(maneuvers, found, strict=True):
        fits = maneuver.role == "fit"
        records = [maneuver.records(channel, own=fits) for channel in channels]
        lags = fit_lags(records, maneuver.rate) if fits else joint
        for channel, own, lag in zip(channels, records, lags, strict=True):
            if lag is not None and fits:
                matches[channel] = Match(join(lag.matched(own)), join(lag.left_out(own)))
            elif lag is not None:
                matches[channel] = Match(join(replace(lag, rate=maneuver.rate).predicted(own)))
    return found


@dataclass(frozen=True, eq=False)
class LagRecord:
    """One segment for one channel."""

    commands: FloatArray  #: (n, m); what drives the lag; complete
    measured: FloatArray  #: (n,), the channel's unit; NaN where missing
    maneuver: int = 0  #: segments with the same number share one bias


@dataclass(frozen=True, eq=False)
class Lag:
    """A fitted lag."""

    time_constant: float  #: tau, s
    dead_time: float  #: delay of the commands, s; to the nearest sample
    gains: FloatArray  #: K (m,), channel unit per command
    biases: Mapping[int, float]  #: b by maneuver, the channel's unit
    initial: tuple[float, ...]  #: at the first sample of every record fitted, the channel's unit
    rate: float  #: Hz

    def respond(self, commands: FloatArray, bias: float, initial: float) -> FloatArray:
        """Return the answer (n,) to `commands` (n, m), starting at `initial`."""
        lane = np.array([self.time_constant]), np.array([round(self.dead_time * self.rate)])
        (design,) = _designs([LagRecord(commands, np.empty(len(commands)))], *lane, self.rate)
        return np.asarray(np.array([*self.gains, bias, initial]) @ design)

    def matched(self, records: Sequence[LagRecord]) -> tuple[FloatArray, ...]:
        """Return the fitted curves (n_i,) of the very records that the lag was fitted to."""
        pairs = zip(records, self.initial, strict=True)
        return tuple(self.respond(one.commands, self.biases[one.maneuver], begin) for one, begin in pairs)

    def predicted(self, records: Sequence[LagRecord]) -> tuple[FloatArray, ...]:
        """Return the curves (n_i,) of records of one maneuver not fitted, with their own bias, from the first 0.2 s."""
        pairs, memory, first = [], self.rate * self.time_constant, max(1, round(START * self.rate))  # samples
        for record in records:
            measured, seen = record.measured, np.isfinite(record.measured)
            early = measured[:first][seen[:first]] if seen[:first].any() else measured[seen][:1]
            pairs.append((record, float(np.mean(early)) if early.size else 0.0))
        missed = np.concatenate([r.measured - self.respond(r.commands, 0.0, start) for r, start in pairs])
        step = np.concatenate([1.0 - np.exp(-np.arange(len(r.measured)) / memory) for r in records])
        there = np.isfinite(missed)
        power = float(np.sum(step[there] ** 2))
        bias = float(np.sum(step[there] * missed[there])) / power if power > 0.0 else 0.0
        return tuple(self.respond(r.commands, bias, start) for r, start in pairs)

    def sensitivities(self, records: Sequence[LagRecord]) -> FloatArray:
        """Return the derivative (N, u) of the fitted curves by gains, biases, and by differences log tau and delay samples."""
        delay, tau = round(self.dead_time * self.rate), self.time_constant
        sooner, later = max(delay - 1, 0), delay + 1
        delays, taus = np.array([delay, sooner, later, delay, delay]), tau * np.ones(5)
        taus[3:] = tau / 1.001, tau * 1.001
        usual, early, late, fast, slow = _designs(records, taus, delays, self.rate)
        solution = np.array([*self.gains, *self.biases.values(), *self.initial])
        by_delay = solution @ (late - early) / (later - sooner)
        by_tau = solution @ (slow - fast) / np.log(1.001**2)
        return np.column_stack([usual[: -len(records)].T, by_tau, by_delay])

    def left_out(self, records: Sequence[LagRecord]) -> tuple[FloatArray, ...]:
        """Return the residuals (n_i,) of the very records that the lag was fitted to, each second left out in turn."""
        sizes = np.cumsum([len(record.measured) for record in records])[:-1]
        residuals = [r.measured - y for r, y in zip(records, self.matched(records), strict=True)]
        sensitivities = np.split(self.sensitivities(records), sizes)
        seen = [s[np.isfinite(e)] for s, e in zip(sensitivities, residuals, strict=True)]
        information = np.sum([s.T @ s for s in seen], axis=0)
        block = round(BLOCK * self.rate)
        pairs = zip(residuals, sensitivities, strict=True)
        return tuple(left_out(e[:, None], s[:, None, :], information, block)[:, 0] for e, s in pairs)


def fit_lags(channels: Sequence[Sequence[LagRecord]], rate: float) -> list[Lag | None]:
    """Fit one lag to all records of each channel at one rate, Hz, least squares over the measured samples.

    Records of a channel have the same commands in the same order; channels with equal commands share their designs. None where
    a channel has fewer measured samples than unknowns.
    """
    alike: dict[tuple[tuple[object, ...], ...], list[int]] = {}
    for i, records in enumerate(channels):
        measured = sum(int(np.isfinite(record.measured).sum()) for record in records)
        if records and measured > _unknowns(records) + 2:
            bits = ((r.maneuver, r.commands.tobytes(), np.isfinite(r.measured).tobytes()) for r in records)
            alike.setdefault(tuple(bits), []).append(i)
    found: list[Lag | None] = [None] * len(channels)
    for places in alike.values():
        for i, lag in zip(places, _Regression([channels[i] for i in places], rate).lags(), strict=True):
            found[i] = lag
    return found


class _Regression:
    """Least squares of channels with the same commands and the same missing samples, for lanes of time constants and delays."""

    def __init__(self, channels: Sequence[Sequence[LagRecord]], rate: float) -> None:
        self._records, self._rate = channels[0], rate
        measured = np.array([np.concatenate([record.measured for record in records]) for records in channels])
        self._there = np.isfinite(measured[0])
        self._measured = np.ascontiguousarray(measured[:, self._there])

    def lags(self) -> list[Lag]:
        """Return the best lag of each channel: of a coarse grid, of every delay near its best, then between time constants."""
        coarse, every = np.unique(np.round(DEAD_TIMES * self._rate).astype(int)), range(len(self._measured))
        slow, late = np.meshgrid(TIME_CONSTANTS, coarse, indexing="ij")
        costs = self._solve(np.array(every), slow.ravel(), late.ravel(), every=True)[0]
        lanes = [self._near(c, coarse, own.reshape(slow.shape).T) for c, own in enumerate(costs)]
        channels, delays, starts = (np.concatenate(parts) for parts in zip(*lanes, strict=True))
        costs, taus = self._refine(channels, delays, starts)
        best = [int(np.flatnonzero(channels == c)[np.argmin(costs[channels == c])]) for c in every]
        solutions = self._solve(channels[best], taus[best], delays[best])[1]
        count, maneuvers = self._records[0].commands.shape[1], sorted({r.maneuver for r in self._records})
        out = []
        for tau, delay, solved in zip(taus[best].tolist(), delays[best].tolist(), solutions, strict=True):
            gains, biases, initial = np.split(solved, [count, count + len(maneuvers)])
            shared = dict(zip(maneuvers, biases.tolist(), strict=True))
            out.append(Lag(tau, delay / self._rate, gains, shared, tuple(initial.tolist()), self._rate))
        return out

    def _near(self, channel: int, coarse: IntArray, costs: FloatArray) -> tuple[IntArray, IntArray, IntArray]:
        """Return every delay between the neighbors of the best of a grid, with its best time constant's place; lanes (d,)."""
        row, place = (int(i) for i in np.unravel_index(np.argmin(costs), costs.shape))
        delays = np.arange(max(0, coarse[row] - coarse[1] + 1), coarse[row] + coarse[1])
        first = max(place - REACH, 0)
        slow, late = np.meshgrid(TIME_CONSTANTS[first : place + REACH + 1], delays, indexing="ij")
        found = self._solve(np.full(slow.size, channel), slow.ravel(), late.ravel())[0]
        return np.full(len(delays), channel), delays, first + np.argmin(found.reshape(slow.shape), axis=0)

    def _refine(self, channels: IntArray, delays: IntArray, places: IntArray) -> tuple[FloatArray, ...]:
        """Return each lane's least cost (k,) and its time constant, by successive parabolas between neighbors in the grid."""
        ends = np.log(TIME_CONSTANTS[np.clip([places - 1, places + 1], 0, len(TIME_CONSTANTS) - 1)])
        x = np.array([ends[0], ends.mean(axis=0), ends[1]])
        y = np.array([self._solve(channels, np.exp(one), delays)[0] for one in x])
        for _ in range(PARABOLAS):
            new = _vertex(x, y)
            cost = self._solve(channels, np.exp(new), delays)[0]
            x, y = np.insert(x, 1, new, axis=0), np.insert(y, 1, cost, axis=0)
            order = np.argsort(x, axis=0, kind="stable")
            x, y = np.take_along_axis(x, order, axis=0), np.take_along_axis(y, order, axis=0)
            kept = np.where(y[1] <= y[2], 0, 1) + np.arange(3)[:, None]  # about the lower of the inner two
            x, y = np.take_along_axis(x, kept, axis=0), np.take_along_axis(y, kept, axis=0)
        least = np.argmin(y, axis=0)[None]
        return np.take_along_axis(y, least, axis=0)[0], np.exp(np.take_along_axis(x, least, axis=0)[0])

    def _solve(
        self, channels: IntArray, time_constants: FloatArray, delays: IntArray, every: bool = False
    ) -> tuple[FloatArray, FloatArray]:
        """Return sums of squares (lanes,) and linear unknowns (lanes, u) of one channel each; of `every`: (channels, ...)."""
        block = max(1, BLOCK_SIZE // (_unknowns(self._records) * len(self._there)))
        costs, solutions = [], []
        for at in range(0, len(delays), block):
            some = slice(at, at + block)
            designs = _designs(self._records, time_constants[some], delays[some], self._rate)
            if self._measured.shape[1] < len(self._there):
                designs = designs[:, :, self._there]
            turned = designs.transpose(0, 2, 1)
            inverse = np.linalg.pinv(designs @ turned, rcond=1e-13, hermitian=True)
            measured = self._measured[:, None] if every else self._measured[channels[some]][None]
            right = (designs @ measured[..., None])[..., 0]
            solved = (inverse @ right[..., None])[..., 0]
            missed = measured - (turned @ solved[..., None])[..., 0]
            costs.append(np.einsum("cln,cln->cl", missed, missed))
            solutions.append(solved)
        found = np.concatenate(costs, axis=1), np.concatenate(solutions, axis=1)
        return found if every else (found[0][0], found[1][0])


def _vertex(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return where parabolas through three points (3, k) have their minimum; the middle of the wider side where outside."""
    left, right = x[1] - x[0], x[1] - x[2]
    a, b = left * (y[1] - y[2]), right * (y[1] - y[0])
    with np.errstate(divide="ignore", invalid="ignore"):
        found = x[1] - 0.5 * (left * a - right * b) / (a - b)
    wider = np.where(left > -right, 0.5 * (x[0] + x[1]), 0.5 * (x[1] + x[2]))
    inside = (found > x[0]) & (found < x[2]) & (found != x[1])
    return np.asarray(np.where(inside, found, wider))


def _unknowns(records: Sequence[LagRecord]) -> int:
    count: int = records[0].commands.shape[1]
    return count + len({record.maneuver for record in records}) + len(records)


def _designs(
    records: Sequence[LagRecord], time_constants: FloatArray, delays: IntArray, rate: float
) -> FloatArray:
    """Return the effect (lanes, u, N) of gains, biases and initial values for lanes of time constants, s, and delays, samples.

    Commands are linear between samples, and stand still before the first.
    """
    maneuvers, count = sorted({record.maneuver for record in records}), records[0].commands.shape[1]
    out = np.zeros((len(delays), _unknowns(records), sum(len(record.commands) for record in records)))
    taus, which = np.unique(time_constants, return_inverse=True)
    end = 0
    for number, record in enumerate(records):
        part = out[:, :, end : (end := end + len(record.commands))]
        decay = np.exp(-np.arange(len(record.commands)) / (rate * taus[:, None]))
        moved = np.ascontiguousarray((record.commands - record.commands[0]).T)
        answers = [_answers(moved, float(tau), rate) for tau in taus]
        part[:, count + len(maneuvers) + number] = decay[which]
        part[:, count + maneuvers.index(record.maneuver)] = settled = 1.0 - decay[which]
        part[:, :count] = settled[:, None] * record.commands[0][:, None]
        for lane, tau, delay in zip(part, which.tolist(), delays.tolist(), strict=True):
            lane[:count, delay:] += answers[tau][:, : max(0, lane.shape[1] - delay)]
    return out


def _answers(commands: FloatArray, tau: float, rate: float) -> FloatArray:
    """Return the answers (m, n) of a unit lag at rest to commands (m, n), linear between samples."""
    ratio = np.exp(-1.0 / (rate * tau))
    late = 1.0 - rate * tau * (1.0 - ratio)
    return np.asarray(lfilter([late, 1.0 - ratio - late], [1.0, -ratio], commands))
