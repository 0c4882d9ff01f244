"""The trivial model beside every figure: a first-order lag with dead time and bias for each channel of each maneuver.

``tau dy/dt + y = K u(t - delay) + b``. Given tau and the delay, the gains K, the bias b of every maneuver and
the initial value of every segment enter linearly and are solved for (variable projection: G. Golub and
V. Pereyra, SIAM J. Numer. Anal. 10, 1973), which leaves a search in two dimensions. A flight-dynamics model
that does not beat it has learned nothing but how late and how strongly the aircraft answers.

In a fit maneuver the lag is given its own axis's command and fitted to that very maneuver: more commands would
make it a regression that can match anything once. In a validation maneuver it is given all commands, its gains
and times come from the fit maneuvers, and only its bias is its own: that favors the lag, for the model under
test gets nothing from the window but its initial state.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.optimize import minimize_scalar
from scipy.signal import lfilter

from stoop.assess.goodness_of_fit import Match, join
from stoop.assess.press import BLOCK, left_out
from stoop.base.arrays import FloatArray
from stoop.results.result import Role

ROLL: Final = ("control_roll", "aileron")
PITCH: Final = ("control_pitch", "elevator")
YAW: Final = ("control_yaw", "rudder")
_MIXED: Final = {
    **dict.fromkeys(("p", "phi", "ve", "ay"), "rotors_roll"),
    **dict.fromkeys(("q", "theta", "vn", "ax"), "rotors_pitch"),
    **dict.fromkeys(("r", "psi"), "rotors_yaw"),
    **dict.fromkeys(("vd", "az"), "rotors_heave"),
}
_SURFACES: Final[Mapping[str, tuple[str, ...]]] = {
    **dict.fromkeys(("p", "phi"), ROLL),
    **dict.fromkeys(("q", "V", "alpha", "theta", "ax", "az"), PITCH),
    **dict.fromkeys(("r", "beta", "psi", "ay"), YAW),
}
OWN_COMMANDS: Final[Mapping[str, tuple[str, ...]]] = {
    c: (*_SURFACES.get(c, ()), *((_MIXED[c],) if c in _MIXED else ())) for c in (*_SURFACES, *_MIXED)
}  #: channel -> its axis's command, the first that there is
SHORTEST: Final = 0.005  #: s; a shorter lag is a plain gain at any usual sample rate
LONGEST: Final = 10.0  #: s; a longer lag is an integrator within any maneuver
TIME_CONSTANTS: Final = np.geomspace(SHORTEST, LONGEST, 20)  #: s, where the search looks first
DEAD_TIMES: Final = np.arange(0.0, 0.29, 0.04)  #: s, where the search looks first
START: Final = 0.2  #: s; a prediction starts from the mean of these first measurements
SAME_RATE: Final = 1e-6  #: in parts; two clocks read back from a file


@dataclass(frozen=True, eq=False)
class BaselineSegment:
    """One segment of a maneuver.

    Attributes
    ----------
    commands : mapping of str to (n,)
        What the pilot or autopilot commanded, or the surfaces; complete; the same names in every segment.
    measured : mapping of str to (n,)
        The channels; NaN where missing; angles unwrapped.
    """

    commands: Mapping[str, FloatArray]
    measured: Mapping[str, FloatArray]


@dataclass(frozen=True, eq=False)
class BaselineManeuver:
    """A maneuver as the trivial model sees it; `rate` is its sample rate, Hz."""

    role: Role
    segments: tuple[BaselineSegment, ...]
    rate: float


def baseline_matches(
    maneuvers: Sequence[BaselineManeuver], channels: Sequence[str]
) -> tuple[dict[str, Match], ...]:
    """Return what the lag makes of every channel of every maneuver.

    Parameters
    ----------
    maneuvers : sequence of BaselineManeuver
        Fit and validation maneuvers in any order. What predicts learns from the fit maneuvers sampled as the first
        of them is; a lag is continuous in time, so it predicts at any rate.
    channels : sequence of str
        Channels wanted; one without enough measurements is left out.

    Returns
    -------
    tuple of dict of str to Match
        For each maneuver its curves, segments joined by one NaN as in `stoop.assess.runs.join`. Without
        any fit maneuver the validation maneuvers have none.
    """
    found: tuple[dict[str, Match], ...] = tuple({} for _ in maneuvers)
    for channel in channels:
        joint = _joint(maneuvers, channel)
        for maneuver, matches in zip(maneuvers, found, strict=True):
            match = _match(maneuver, channel, joint)
            if match is not None:
                matches[channel] = match
    return found


def _joint(maneuvers: Sequence[BaselineManeuver], channel: str) -> Lag | None:
    """Return the lag given all commands, fitted to all fit maneuvers, if something is to be predicted."""
    if all(maneuver.role == "fit" for maneuver in maneuvers):
        return None
    fitted = [m for m in maneuvers if m.role == "fit"]
    alike = [m for m in fitted if abs(m.rate - fitted[0].rate) < SAME_RATE * m.rate]
    records = [r for number, m in enumerate(alike) for r in _records(m, channel, _all(m), number)]
    return fit_lag(records, alike[0].rate) if records else None


def _match(maneuver: BaselineManeuver, channel: str, joint: Lag | None) -> Match | None:
    if maneuver.role == "validation":
        if joint is None:
            return None
        return Match(join(joint.at(maneuver.rate).predicted(_records(maneuver, channel, _all(maneuver)))))
    records = _records(maneuver, channel, _own(maneuver, channel))
    lag = fit_lag(records, maneuver.rate) if records else None
    return Match(join(lag.matched(records)), join(lag.left_out(records))) if lag else None


def _records(
    maneuver: BaselineManeuver, channel: str, commands: Sequence[str], number: int = 0
) -> list[LagRecord]:
    return [
        LagRecord(*_arrays(segment, channel, commands), number) for segment in maneuver.segments if commands
    ]


def _arrays(segment: BaselineSegment, channel: str, commands: Sequence[str]) -> tuple[FloatArray, FloatArray]:
    driving = np.column_stack([segment.commands[name] for name in commands])
    return driving, segment.measured.get(channel, np.full(len(driving), np.nan))


def _all(maneuver: BaselineManeuver) -> list[str]:
    return list(maneuver.segments[0].commands) if maneuver.segments else []


def _own(maneuver: BaselineManeuver, channel: str) -> list[str]:
    """Return the channel's own command where there is one, else all of them."""
    there = _all(maneuver)
    return [name for name in OWN_COMMANDS.get(channel, ()) if name in there][:1] or there


@dataclass(frozen=True, eq=False)
class LagRecord:
    """One segment for one channel.

    Attributes
    ----------
    commands : (n, m)
        What drives the lag; complete.
    measured : (n,), the channel's unit
        NaN where missing.
    maneuver : int
        Segments with the same number share one bias.
    """

    commands: FloatArray
    measured: FloatArray
    maneuver: int = 0


@dataclass(frozen=True, eq=False)
class Lag:
    """A fitted lag.

    Attributes
    ----------
    time_constant, dead_time : float, s
        tau and the delay of the commands.
    gains : (m,), channel unit per command
        K.
    biases : mapping of int to float, the channel's unit
        b by maneuver.
    initial : tuple of float, the channel's unit
        Value at the first sample of every record fitted.
    rate : float, Hz
        Sample rate.
    """

    time_constant: float
    dead_time: float
    gains: FloatArray
    biases: Mapping[int, float]
    initial: tuple[float, ...]
    rate: float

    def respond(self, commands: FloatArray, bias: float, initial: float) -> FloatArray:
        """Return the answer (n,) to `commands` (n, m), starting at `initial`."""
        forced = _forced(commands, self.time_constant, self._delay, self.rate)
        step, decay = _free(len(commands), self.time_constant, self.rate)
        answer: FloatArray = forced @ self.gains + bias * step + initial * decay
        return answer

    def matched(self, records: Sequence[LagRecord]) -> tuple[FloatArray, ...]:
        """Return the fitted curves (n_i,) of the very records that the lag was fitted to."""
        return tuple(
            self.respond(record.commands, self.biases[record.maneuver], initial)
            for record, initial in zip(records, self.initial, strict=True)
        )

    def predicted(self, records: Sequence[LagRecord]) -> tuple[FloatArray, ...]:
        """Return the curves (n_i,) of records of one maneuver not fitted; only their own bias is fitted.

        The initial value is the mean of the first 0.2 s. The bias is granted because a lag knows no trim:
        without it the lag would be no opponent.
        """
        return self._from_start(records, self._own_bias(records))

    def predicted_blind(self, records: Sequence[LagRecord]) -> tuple[FloatArray, ...]:
        """Return the curves (n_i,) of records not fitted, with the mean of the fitted biases."""
        return self._from_start(records, float(np.mean(list(self.biases.values()))))

    def left_out(self, records: Sequence[LagRecord]) -> tuple[FloatArray, ...]:
        """Return the residuals (n_i,) of the very records that the lag was fitted to, each second left out in turn.

        About the optimum; gains, biases, time constant and dead time count as unknowns, see `stoop.assess.press`.
        """
        search = _Search(tuple(records), self.rate)
        sizes = np.cumsum([len(record.measured) for record in records])[:-1]
        residuals = [r.measured - y for r, y in zip(records, self.matched(records), strict=True)]
        sensitivities = np.split(search.sensitivities(self), sizes)
        seen = [s[np.isfinite(e)] for s, e in zip(sensitivities, residuals, strict=True)]
        information = np.sum([s.T @ s for s in seen], axis=0)
        block = round(BLOCK * self.rate)
        return tuple(
            left_out(e[:, None], s[:, None, :], information, block)[:, 0]
            for e, s in zip(residuals, sensitivities, strict=True)
        )

    def at(self, rate: float) -> Lag:
        """Return the same lag for records sampled at another rate, Hz; the dead time to the nearest sample there."""
        return replace(self, rate=rate)

    @property
    def _delay(self) -> int:
        return round(self.dead_time * self.rate)

    def _from_start(self, records: Sequence[LagRecord], bias: float) -> tuple[FloatArray, ...]:
        return tuple(self.respond(r.commands, bias, _start(r.measured, self.rate)) for r in records)

    def _own_bias(self, records: Sequence[LagRecord]) -> float:
        missed = np.concatenate([r.measured for r in records]) - np.concatenate(
            self._from_start(records, 0.0)
        )
        step = np.concatenate([_free(len(r.measured), self.time_constant, self.rate)[0] for r in records])
        there = np.isfinite(missed)
        power = float(np.sum(step[there] ** 2))
        return float(np.sum(step[there] * missed[there])) / power if power > 0.0 else 0.0


def fit_lag(records: Sequence[LagRecord], rate: float) -> Lag | None:
    """Fit one lag to all records of a channel, least squares over the measured samples.

    Parameters
    ----------
    records : sequence of LagRecord
        Segments with the same commands in the same order.
    rate : float, Hz
        Sample rate of all of them.

    Returns
    -------
    Lag or None
        None when there are fewer measured samples than unknowns.
    """
    search = _Search(tuple(records), rate)
    if not search.enough():
        return None
    delay = min(_coarse_delays(rate), key=lambda d: search.best_time_constant(d)[0])
    step = _coarse_delays(rate)[1]
    near = range(max(0, delay - step + 1), delay + step)
    _, tau, delay = min((*search.refine(d), d) for d in near)
    return search.lag(tau, delay)


@dataclass(frozen=True, eq=False)
class _Search:
    """The least-squares problem that is left when tau and the delay are given."""

    records: tuple[LagRecord, ...]
    rate: float

    @property
    def maneuvers(self) -> list[int]:
        return sorted({record.maneuver for record in self.records})

    def enough(self) -> bool:
        measured = sum(int(np.isfinite(record.measured).sum()) for record in self.records)
        return measured > self.width

    @property
    def width(self) -> int:
        """How many unknowns there are: gains, biases, initial values, tau and the delay."""
        return int(self.records[0].commands.shape[1]) + len(self.maneuvers) + len(self.records) + 2

    def sensitivities(self, lag: Lag) -> FloatArray:
        """Return the derivative (N, width - records) of the curves by all unknowns but initial values.

        Those by tau and the delay are differences.
        """
        tau, delay = lag.time_constant, round(lag.dead_time * self.rate)
        solution = np.array([*lag.gains, *lag.biases.values(), *lag.initial])
        later, sooner = self.design(tau, delay + 1), self.design(tau, max(delay - 1, 0))
        by_delay = (later - sooner) @ solution / (delay + 1 - max(delay - 1, 0))
        by_tau = (
            (self.design(tau * 1.001, delay) - self.design(tau / 1.001, delay)) @ solution / np.log(1.001**2)
        )
        return np.column_stack([self.design(tau, delay)[:, : -len(self.records)], by_tau, by_delay])

    def design(self, tau: float, delay: int) -> FloatArray:
        """Return (N, m + maneuvers + records): gains, biases, initial values."""
        maneuvers = self.maneuvers
        blocks = []
        for number, record in enumerate(self.records):
            forced = _forced(record.commands, tau, delay, self.rate)
            step, decay = _free(len(forced), tau, self.rate)
            block = np.zeros((len(forced), forced.shape[1] + len(maneuvers) + len(self.records)))
            block[:, : forced.shape[1]] = forced
            block[:, forced.shape[1] + maneuvers.index(record.maneuver)] = step
            block[:, forced.shape[1] + len(maneuvers) + number] = decay
            blocks.append(block)
        return np.concatenate(blocks)

    def solve(self, tau: float, delay: int) -> tuple[float, FloatArray]:
        """Return the sum of squares and the linear unknowns."""
        measured = np.concatenate([record.measured for record in self.records])
        there = np.isfinite(measured)
        design, measured = self.design(tau, delay)[there], measured[there]
        solution = np.linalg.lstsq(design.T @ design, design.T @ measured, rcond=1e-13)[0]
        return float(np.sum((measured - design @ solution) ** 2)), solution

    def best_time_constant(self, delay: int) -> tuple[float, int]:
        """Return the least sum of squares over the coarse grid, and where it lies."""
        return min((self.solve(float(tau), delay)[0], i) for i, tau in enumerate(TIME_CONSTANTS))

    def refine(self, delay: int) -> tuple[float, float]:
        """Return the least sum of squares for one delay, and its tau."""
        place = self.best_time_constant(delay)[1]
        bracket = np.log(TIME_CONSTANTS[[max(place - 1, 0), min(place + 1, len(TIME_CONSTANTS) - 1)]])
        found = minimize_scalar(
            lambda log_tau: self.solve(float(np.exp(log_tau)), delay)[0],
            bounds=(float(bracket[0]), float(bracket[1])),
            method="bounded",
            options={"xatol": 1e-3},
        )
        return float(found.fun), float(np.exp(found.x))

    def lag(self, tau: float, delay: int) -> Lag:
        solution = self.solve(tau, delay)[1]
        split = self.records[0].commands.shape[1]
        biases = dict(zip(self.maneuvers, map(float, solution[split:]), strict=False))
        initial = tuple(map(float, solution[split + len(biases) :]))
        return Lag(tau, delay / self.rate, solution[:split], biases, initial, self.rate)


def _coarse_delays(rate: float) -> list[int]:
    return sorted({round(delay * rate) for delay in DEAD_TIMES})


def _start(measured: FloatArray, rate: float) -> float:
    """Return the mean of the first 0.2 s, or of the first sample there is."""
    first = measured[: max(1, round(START * rate))]
    there = first[np.isfinite(first)] if np.isfinite(first).any() else measured[np.isfinite(measured)][:1]
    return float(np.mean(there)) if there.size else 0.0


def _free(size: int, tau: float, rate: float) -> tuple[FloatArray, FloatArray]:
    """Return the answers (size,) to a unit bias from zero, and to a unit initial value."""
    decay = np.exp(-np.arange(size) / (rate * tau))
    return 1.0 - decay, decay


def _forced(commands: FloatArray, tau: float, delay: int, rate: float) -> FloatArray:
    """Return the answer (n, m) of a unit lag to each command (n, m) alone, from zero.

    Commands run straight between samples (exact for that hold). Before the first sample, where the delayed
    command would come from, it is taken to have stood still.
    """
    change = commands - commands[0]
    ratio = np.exp(-1.0 / (rate * tau))
    late = 1.0 - rate * tau * (1.0 - ratio)
    moved = lfilter([late, 1.0 - ratio - late], [1.0, -ratio], change, axis=0)
    answer = _free(len(commands), tau, rate)[0][:, None] * commands[0]
    answer[delay:] += moved[: max(0, len(moved) - delay)]
    return np.asarray(answer, dtype=np.float64)
