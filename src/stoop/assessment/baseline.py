"""The trivial model beside every figure: a first-order lag with dead time and bias for each channel of each maneuver.

``tau dy/dt + y = K u(t - delay) + b``. Given tau and the delay, the gains K, the bias b of every maneuver and the initial
value of every segment enter linearly and are solved for (variable projection: G. Golub and V. Pereyra, SIAM J. Numer.
Anal. 10, 1973), which leaves a search in two dimensions. A flight-dynamics model that does not beat it has learned nothing
but how late and how strongly the aircraft answers.

In a fit maneuver the lag is given its own axis's command and fitted to that very maneuver. In a validation maneuver it is
given all commands, its gains and times come from the fit maneuvers, and only its bias is its own, for a lag knows no trim.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from stoop.assessment.goodness_of_fit import BLOCK, Match, join, left_out
from stoop.base.arrays import FloatArray
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
        names = list(self.segments[0].commands) if self.segments else []
        if own:
            names = [name for name in OWN_COMMANDS.get(channel, ()) if name in names][:1] or names
        out = []
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
    for channel in channels:
        joint = None
        if len(fitted) < len(maneuvers):  # the lag that predicts is given all commands of all fit maneuvers
            learned = [r for number, m in enumerate(alike) for r in m.records(channel, number)]
            joint = fit_lag(learned, alike[0].rate) if learned else None
        for maneuver, matches in zip(maneuvers, found, strict=True):
            if maneuver.role == "fit":
                records = maneuver.records(channel, own=True)
                lag = fit_lag(records, maneuver.rate) if records else None
                if lag is not None:
                    matches[channel] = Match(join(lag.matched(records)), join(lag.left_out(records)))
            elif joint is not None:
                predicted = replace(joint, rate=maneuver.rate).predicted(maneuver.records(channel))
                matches[channel] = Match(join(predicted))
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
        answers, forced = _answers(commands, self.time_constant, self.rate), np.empty(commands.shape)
        answers.write(forced, round(self.dead_time * self.rate))
        return np.asarray(forced @ self.gains + bias * (1.0 - answers.decay) + initial * answers.decay)

    def matched(self, records: Sequence[LagRecord]) -> tuple[FloatArray, ...]:
        """Return the fitted curves (n_i,) of the very records that the lag was fitted to."""
        return tuple(
            self.respond(record.commands, self.biases[record.maneuver], initial)
            for record, initial in zip(records, self.initial, strict=True)
        )

    def predicted(self, records: Sequence[LagRecord]) -> tuple[FloatArray, ...]:
        """Return the curves (n_i,) of records of one maneuver not fitted, with their own bias, from the first 0.2 s."""
        starts = []
        for measured in (r.measured for r in records):
            seen, first = np.isfinite(measured), max(1, round(START * self.rate))
            early = measured[:first][seen[:first]] if seen[:first].any() else measured[seen][:1]
            starts.append(float(np.mean(early)) if early.size else 0.0)
        pairs = list(zip(records, starts, strict=True))
        missed = np.concatenate([r.measured - self.respond(r.commands, 0.0, start) for r, start in pairs])
        memory = self.rate * self.time_constant  # samples
        step = np.concatenate([1.0 - np.exp(-np.arange(len(r.measured)) / memory) for r in records])
        there = np.isfinite(missed)
        power = float(np.sum(step[there] ** 2))
        bias = float(np.sum(step[there] * missed[there])) / power if power > 0.0 else 0.0
        return tuple(self.respond(r.commands, bias, start) for r, start in pairs)

    def sensitivities(self, records: Sequence[LagRecord]) -> FloatArray:
        """Return the derivative (N, u) of the fitted curves by gains, biases, log tau and the delay in samples.

        Those by tau and the delay are differences.
        """
        delay, tau = round(self.dead_time * self.rate), self.time_constant
        slow, usual, fast = (
            [_answers(record.commands, t, self.rate) for record in records]
            for t in (tau * 1.001, tau, tau / 1.001)
        )
        solution = np.array([*self.gains, *self.biases.values(), *self.initial])
        later, sooner = (_design(records, usual, d) for d in (delay + 1, max(delay - 1, 0)))
        by_delay = (later - sooner) @ solution / (delay + 1 - max(delay - 1, 0))
        by_tau = (_design(records, slow, delay) - _design(records, fast, delay)) @ solution / np.log(1.001**2)
        return np.column_stack([_design(records, usual, delay)[:, : -len(records)], by_tau, by_delay])

    def left_out(self, records: Sequence[LagRecord]) -> tuple[FloatArray, ...]:
        """Return the residuals (n_i,) of the very records that the lag was fitted to, each second left out in turn."""
        sizes = np.cumsum([len(record.measured) for record in records])[:-1]
        residuals = [r.measured - y for r, y in zip(records, self.matched(records), strict=True)]
        sensitivities = np.split(self.sensitivities(records), sizes)
        seen = [s[np.isfinite(e)] for s, e in zip(sensitivities, residuals, strict=True)]
        information = np.sum([s.T @ s for s in seen], axis=0)
        block = round(BLOCK * self.rate)
        return tuple(
            left_out(e[:, None], s[:, None, :], information, block)[:, 0]
            for e, s in zip(residuals, sensitivities, strict=True)
        )


def fit_lag(records: Sequence[LagRecord], rate: float) -> Lag | None:
    """Fit one lag to all records of a channel at one rate, Hz, least squares over the measured samples.

    They have the same commands in the same order. None when there are fewer measured samples than unknowns.
    """
    count, maneuvers = records[0].commands.shape[1], sorted({record.maneuver for record in records})
    measured = sum(int(np.isfinite(record.measured).sum()) for record in records)
    if measured <= count + len(maneuvers) + len(records) + 2:
        return None
    problem = _Regression(records, rate)
    delays = sorted({round(delay * rate) for delay in DEAD_TIMES})
    costs = problem.grid(delays)
    row, place = (int(i) for i in np.unravel_index(np.argmin(costs), costs.shape))
    near = range(max(0, delays[row] - delays[1] + 1), delays[row] + delays[1])
    taus = slice(max(place - REACH, 0), place + REACH + 1)
    costs = problem.grid(near, TIME_CONSTANTS[taus])
    _, tau, delay = min(
        problem.refine(delay, taus.start + int(np.argmin(own)))
        for delay, own in zip(near, costs, strict=True)
    )
    gains, biases, initial = np.split(problem.solve(tau, delay)[1], [count, count + len(maneuvers)])
    shared = dict(zip(maneuvers, biases.tolist(), strict=True))
    return Lag(tau, delay / rate, gains, shared, tuple(initial.tolist()), rate)


class _Regression:
    """Least squares of a channel's records for any time constant and delay; what delays have in common is made once."""

    def __init__(self, records: Sequence[LagRecord], rate: float) -> None:
        self._records, self._rate = records, rate
        measured = np.concatenate([record.measured for record in records])
        self._there = np.isfinite(measured)
        self._measured = measured[self._there]

    def grid(self, delays: Sequence[int], time_constants: FloatArray = TIME_CONSTANTS) -> FloatArray:
        """Return the least sums of squares (delays, time constants)."""
        costs = np.empty((len(delays), len(time_constants)))
        for j, tau in enumerate(time_constants.tolist()):
            answers = [_answers(record.commands, tau, self._rate) for record in self._records]
            for i, delay in enumerate(delays):
                costs[i, j] = self._least(answers, delay)[0]
        return costs

    def refine(self, delay: int, place: int) -> tuple[float, float, int]:
        """Return the least sum of squares of a delay, its time constant near that of a place in the grid, and the delay."""
        bracket = np.log(TIME_CONSTANTS[[max(place - 1, 0), min(place + 1, len(TIME_CONSTANTS) - 1)]])
        end = minimize_scalar(
            lambda log_tau: self.solve(float(np.exp(log_tau)), delay)[0],
            bounds=(float(bracket[0]), float(bracket[1])),
            method="bounded",
            options={"xatol": 1e-3},
        )
        return float(end.fun), float(np.exp(end.x)), delay

    def solve(self, tau: float, delay: int) -> tuple[float, FloatArray]:
        """Return the sum of squares and the linear unknowns."""
        return self._least([_answers(record.commands, tau, self._rate) for record in self._records], delay)

    def _least(self, answers: Sequence[_Answers], delay: int) -> tuple[float, FloatArray]:
        design, measured = _design(self._records, answers, delay), self._measured
        if len(measured) < len(design):
            design = design[self._there]
        solution = np.linalg.lstsq(design.T @ design, design.T @ measured, rcond=1e-13)[0]
        return float(np.sum((measured - design @ solution) ** 2)), solution


@dataclass(frozen=True, eq=False)
class _Answers:
    """Answers of a unit lag to the commands of a record.

    Before the first sample, where a delayed command would come from, it is taken to have stood still. The decay is the
    answer to a unit initial value; one minus it that to a unit bias.
    """

    change: FloatArray  #: (n, m), to what commands change from their first sample, linear between samples
    first: FloatArray  #: (m,), commands at the first sample
    decay: FloatArray  #: (n,)

    def write(self, out: FloatArray, delay: int) -> None:
        """Write the answers (n, m) to the commands from zero, so many samples late."""
        np.multiply((1.0 - self.decay)[:, None], self.first, out=out)
        out[delay:] += self.change[: max(0, len(out) - delay)]


def _answers(commands: FloatArray, tau: float, rate: float) -> _Answers:
    ratio, decay = np.exp(-1.0 / (rate * tau)), np.exp(-np.arange(len(commands)) / (rate * tau))
    late = 1.0 - rate * tau * (1.0 - ratio)
    change = lfilter(
        [late, 1.0 - ratio - late], [1.0, -ratio], np.ascontiguousarray((commands - commands[0]).T)
    )
    return _Answers(change.T, commands[0], decay)


def _design(records: Sequence[LagRecord], answers: Sequence[_Answers], delay: int) -> FloatArray:
    """Return the linear unknowns' effect (N, m + maneuvers + records): gains, biases, initial values."""
    maneuvers, count = sorted({record.maneuver for record in records}), records[0].commands.shape[1]
    out = np.zeros((count + len(maneuvers) + len(records), sum(len(a.decay) for a in answers))).T
    end = 0
    for number, (record, one) in enumerate(zip(records, answers, strict=True)):
        rows = out[end : (end := end + len(one.decay))]
        one.write(rows[:, :count], delay)
        rows[:, count + maneuvers.index(record.maneuver)] = 1.0 - one.decay
        rows[:, count + len(maneuvers) + number] = one.decay
    return out
