"""Find windows of flights for fitting and for validation, with reasons: by commanded excitation, then by information.

Every verb takes its windows from here. Candidates are windows in which a command stands out (a flight without commands is
tried all along). Without a vehicle their excitation chooses among them. With one, its free numbers are fitted to those windows,
the information at these estimates chooses, and the standard errors of the fit to the chosen windows are what to expect.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from stoop import Flight, Notice
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import FlightError
from stoop.extend.files import by_name
from stoop.extend.flights import (
    Flights,
    Found,
    Proposed,
    as_flights,
    moves,
)
from stoop.extend.notices import notice
from stoop.extend.text import remaining
from stoop.extend.variables import FAMILIES
from stoop_plan.input_design.candidates import Candidate, Excitation, candidates, with_motors

if TYPE_CHECKING:  # fits are imported where a vehicle is given: without one nothing is fitted
    from stoop import Vehicle
    from stoop_plan.input_design.sensitivity import CandidateProblem, VehicleInformation


@dataclass(frozen=True)
class Expected:
    """A free number and its standard error by a quick fit of the proposed windows together, SI.

    The value is NaN and the error infinite for a number that the fit leaves at a bound.
    """

    name: str
    value: float
    std_error: float

    @property
    def relative(self) -> float:
        """Standard error over the size of the value."""
        return self.std_error / abs(self.value) if self.value else float("inf")


@dataclass(frozen=True)
class FoundWindows(Found):
    """Windows, and the expected errors of the vehicle's free numbers (none without one)."""

    expected: tuple[Expected, ...] = ()


@dataclass(frozen=True)
class SelectionLimits:
    """Thresholds of the selection of windows."""

    prior_span: float = 8.0  #: s of usual flight that count as prior information
    #: per parameter, below which a window is not worth fitting: error bars 5 % smaller
    min_gain: float = 0.05
    max_windows: int = 8  #: to fit; each has an initial state and biases of its own
    window_cost: float = 2.0  #: s that a window costs besides its length
    maneuver_weight: float = 1.5  #: of a whole maneuver, over a window that may cut one
    redundant: float = 0.25  #: loss per parameter at which a fitted window may be held out instead
    validation_worth: float = 0.5  #: of the fitted windows' gain, at which a window that is left is held out
    max_candidates: int = 100  #: of a flight, the most excited ones
    sharper: float = 0.8  #: ratio of standard errors, below which a parameter is named as a reason
    max_named: int = 3
    max_declined: int = 6  #: windows that are shown beside those that are proposed


LIMITS: Final = SelectionLimits()

NO_AXIS: Final = "motion"  #: of windows in which no command stands out


@dataclass(frozen=True, eq=False)
class CandidateInformation:
    """Fisher information (D, D) before any flight, and of each candidate alone."""

    prior: FloatArray
    matrices: tuple[FloatArray, ...]

    def gain(self, base: FloatArray, index: int) -> float:
        """Return by how much the mean logarithm of the error bars falls when a candidate is added."""
        after, before = (float(np.linalg.slogdet(m)[1]) for m in (base + self.matrices[index], base))
        return (after - before) / (2.0 * len(base))

    def total(self, chosen: Sequence[int]) -> FloatArray:
        """Return the information (D, D) with some candidates."""
        return np.asarray(self.prior + sum((self.matrices[i] for i in chosen), np.zeros_like(self.prior)))

    def loss(self, fitted: Sequence[int], out: int) -> float:
        """Return by how much the mean logarithm of the error bars of the fitted candidates grows without one of them."""
        whole, rest = (self.total(chosen) for chosen in (fitted, [i for i in fitted if i != out]))
        return float(np.linalg.slogdet(whole)[1] - np.linalg.slogdet(rest)[1]) / (2.0 * len(whole))

    def gain_alone(self, index: int) -> float:
        """Return the gain of a candidate alone."""
        return self.gain(self.prior, index)


@dataclass(frozen=True)
class Selection:
    """Candidates to fit in the order of selection, with the gain of each, and those to validate with."""

    fitted: tuple[int, ...]
    gains: tuple[float, ...]
    held_out: tuple[int, ...]


def select(found: Sequence[Candidate], information: CandidateInformation) -> Selection:
    """Select windows until one more adds little; hold some out.

    D-optimality: each step takes the window that shrinks the uncertainty ellipsoid most for its length. For a sum of
    information matrices log det is submodular, so the greedy selection is within 1 - 1/e of the best of its size.

    References
    ----------
    V. V. Fedorov, *Theory of Optimal Experiments*, Academic Press, 1972. G. L. Nemhauser, L. A. Wolsey and M. L. Fisher,
    "An analysis of approximations for maximizing submodular set functions", *Mathematical Programming* 14, 1978.
    """

    def weight(one: Candidate) -> float:
        return (1.0 if one.maneuver is None else LIMITS.maneuver_weight) / (one.seconds + LIMITS.window_cost)

    fitted: list[int] = []
    gains: list[float] = []
    base = information.prior
    while len(fitted) < LIMITS.max_windows:
        free = [i for i in range(len(found)) if not any(found[i].meets(found[j]) for j in fitted)]
        rated = {i: information.gain(base, i) for i in free}
        rated = {i: g for i, g in rated.items() if g >= LIMITS.min_gain}
        if not rated:
            break
        best = max(rated, key=lambda i: rated[i] * weight(found[i]))
        fitted.append(best)
        gains.append(rated[best])
        base = base + information.matrices[best]
    held = _held_out(found, information, fitted)
    left = [(i, g) for i, g in zip(fitted, gains, strict=True) if i not in held]
    return Selection(tuple(i for i, _ in left), tuple(g for _, g in left), held)


def _held_out(
    found: Sequence[Candidate], information: CandidateInformation, fitted: Sequence[int]
) -> tuple[int, ...]:
    """Return the windows to validate with: of each fitted axis a maneuver that is left; where none is, one that is fitted.

    That one is of an axis that is fitted twice, and the cheapest; a second one is not taken from the fit, since what
    maneuvers disagree about (gusts) takes many to show: intervals of four windows are too narrow where those of six hold.
    The most informative maneuver of an axis is never held out.
    """
    best_of: dict[str, int] = {}
    for i in sorted(range(len(found)), key=information.gain_alone):
        if (m := found[i].maneuver) is not None:
            best_of[m.axis] = i
    kept = set(best_of.values())
    free = [i for i in range(len(found)) if not any(found[i].meets(found[j]) for j in fitted)]
    free = [i for i in free if i not in kept]
    usual = float(np.median([information.gain_alone(i) for i in fitted])) if fitted else np.inf
    eligible = [i for i in free if information.gain_alone(i) >= LIMITS.validation_worth * usual]

    flown = [_axis(found[i]) for i in fitted]
    held: list[int] = []
    for i in sorted(eligible, key=information.gain_alone, reverse=True):
        seen = {None, *(_axis(found[j]) for j in held)}
        apart = not any(found[i].meets(found[j]) for j in held)
        if apart and (axis := _axis(found[i])) in flown and axis not in seen:
            held.append(i)
    if held:
        return tuple(held)
    twice = [i for i, axis in zip(fitted, flown, strict=True) if axis is not None and flown.count(axis) > 1]
    for among in (twice, [*eligible, *(fitted if len(fitted) > 1 else ())]):
        losses = {i: information.loss(fitted, i) for i in among if i not in kept}
        losses = {i: x for i, x in losses.items() if x < LIMITS.redundant}
        if losses:  # whose absence costs least, then the most informative one
            return (min(losses, key=lambda i: (losses[i], -information.gain_alone(i))),)
    worth = [i for i in free if information.gain_alone(i) > LIMITS.min_gain]
    return (max(worth, key=information.gain_alone),) if worth else ()


def _axis(one: Candidate) -> str | None:
    return None if one.maneuver is None else one.maneuver.axis


def excitation_information(
    flights: Mapping[str, Flight], excitations: Mapping[str, Excitation], found: Sequence[Candidate]
) -> CandidateInformation:
    """Return the information of windows about any vehicle that responds linearly to commands and rates.

    All flights have the same commands.
    """
    out = []
    for one in found:
        flight = flights[one.flight]
        rows = excitations[one.flight].inside(flight, one)
        out.append(rows.T @ rows / (LIMITS.prior_span * flight.rate))
    size = len(next(iter(excitations.values())).names)
    return CandidateInformation(np.eye(size), tuple(out))


def doubts(flights: Mapping[str, Flight], vehicle: Vehicle) -> list[Notice]:
    """Return why a flight is hardly of this vehicle; a FlightError where it lacks an input of it."""
    from stoop.extend.vehicles import check_vehicle

    for flight in flights.values():
        _check_inputs(flight, vehicle)
    return check_vehicle(vehicle, {n: with_motors(f, vehicle) for n, f in flights.items()})


def find_windows(
    flights: Mapping[str, Flight] | Flights,
    vehicle: Vehicle | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> FoundWindows:
    """Propose windows by excitation and by the information in them.

    Parameters
    ----------
    flights : Flight, path of a log, or a sequence or mapping of them, of one vehicle
    vehicle : whose free numbers are to be estimated; without one, windows that excite each axis by itself
    tell : called with the progress

    Raises
    ------
    FlightError
        No window can be used, with the reason.
    """
    given = by_name(as_flights([*flights.values()] if isinstance(flights, Mapping) else flights), "windows")
    for flight in given.values():
        _check_inputs(flight, vehicle)
    flights = {name: with_motors(flight, vehicle) for name, flight in given.items()}
    excitations = {name: e for name, flight in flights.items() if (e := Excitation.of(flight)) is not None}
    found = [c for f in flights.values() for c in _candidates(f, vehicle, excitations.get(f.name))]
    if not found or not (vehicle is None or excitations or _driven(flights, vehicle)):
        raise _nothing_found(flights, vehicle, unmeasured=not found and not excitations)
    choose = partial(_by_excitation, flights, excitations)
    model, notices = None, list[Notice]()
    if vehicle is None:
        information = choose(found)
    else:
        from stoop_plan.input_design.quick_fit import first_fit, quick_fit, with_assumptions
        from stoop_plan.input_design.sensitivity import candidate_problem

        usable = [c for c in found if candidate_problem(vehicle, flights[c.flight], c) is not None]
        if not usable:
            raise _nothing_found(flights, vehicle, unmeasured=True)
        first = [c.window for c in _first_windows(usable, choose(usable) if excitations else None)]
        tell("first fit of the windows that stand out")
        vehicle = with_assumptions(vehicle, flights, first)
        estimates = first_fit(vehicle, flights, first)
        found, information, model = _about_vehicle(vehicle, flights, usable, estimates, tell)
    selection = select(found, information)
    if not selection.fitted:
        raise _nothing_found(flights, vehicle, unmeasured=True)
    expected = list[Expected]()
    if vehicle is not None:
        tell("fit of the proposed windows")
        fitted = quick_fit(vehicle, flights, [found[i].window for i in selection.fitted], estimates)
        expected = [Expected(name, value, fitted.errors[name]) for name, value in fitted.values.items()]
        if fitted.failure:
            notices.append(notice("windows-not-fitted", reason=fitted.failure))
    report = _Report(flights, excitations, found, information, model)
    if not selection.held_out:
        notices.append(notice("no-validation-window"))
    return FoundWindows(tuple(report.windows(selection)), tuple(notices), tuple(expected))


def _driven(flights: Mapping[str, Flight], vehicle: Vehicle) -> bool:
    """Tell whether an input of the vehicle moves in a flight, or it has none that could."""
    inputs = [name for name in vehicle.recorded if name not in ("voltage", "density")]
    return not inputs or any(moves(f.column(n)) for f in flights.values() for n in inputs if n in f.names)


def _by_excitation(
    flights: Mapping[str, Flight], excitations: Mapping[str, Excitation], found: Sequence[Candidate]
) -> CandidateInformation:
    """Return the information of windows about commands and rates that all flights have."""
    first = next(iter(excitations.values()))
    shared = [n for n in first.names if all(n in e.names for e in excitations.values())]
    common = {name: e.only(shared) for name, e in excitations.items()}
    return excitation_information(flights, common, found)


def _first_windows(found: Sequence[Candidate], information: CandidateInformation | None) -> list[Candidate]:
    """Return the windows of the first fit: those that excitation chooses, or the first that share no samples."""
    chosen = [] if information is None else [found[i] for i in select(found, information).fitted]
    if not chosen:
        for one in found:
            if len(chosen) < LIMITS.max_windows and not any(one.meets(other) for other in chosen):
                chosen.append(one)
    return chosen


def _candidates(flight: Flight, vehicle: Vehicle | None, excitation: Excitation | None) -> list[Candidate]:
    """Return the maneuvers of a flight, the most excited first, and at most `LIMITS.max_candidates`.

    A flight without commands (or rates) has windows all along, and so has one in which no command stands out, as all are busy
    throughout and move the vehicle. One on rotors has them beside its maneuvers: thrust and drag show in climbs and moves.
    """
    on_rotors = vehicle is not None and bool(vehicle.rotors)
    if vehicle is not None:
        channels = list(vehicle.recorded)
    else:
        direct = [c.variable for c in flight.commands() if c.variable in flight.names]
        channels = direct or next(iter(flight.output_families()), [])
    found = candidates(flight, channels)
    if excitation is None:
        return found[:: max(1, len(found) // LIMITS.max_candidates)]
    maneuvers = [c for c in found if c.maneuver is not None]
    if not (maneuvers and on_rotors):
        found = maneuvers or (found if excitation.moves(flight) else [])
    if not found:
        return []
    information = excitation_information({flight.name: flight}, {flight.name: excitation}, found)
    order = sorted(range(len(found)), key=lambda i: -information.gain_alone(i))
    return [found[i] for i in order[: LIMITS.max_candidates]]


def _about_vehicle(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    usable: Sequence[Candidate],
    estimates: Mapping[str, float],
    tell: Callable[[str], None],
) -> tuple[list[Candidate], CandidateInformation, VehicleInformation]:
    """Return the candidates that can be simulated, and their information about the vehicle's free numbers."""
    from stoop_plan.input_design.sensitivity import BOX_INFORMATION, candidate_problem, linearization_point

    each = ((c, candidate_problem(vehicle, flights[c.flight], c)) for c in usable)
    problems = [(candidate, problem) for candidate, problem in each if problem is not None]
    disjoint: list[tuple[Candidate, CandidateProblem]] = []
    for one in problems:
        if not any(one[0].meets(other) for other, _ in disjoint):
            disjoint.append(one)
    kept, matrices = [], []
    model = linearization_point(vehicle, [p for _, p in disjoint], estimates)
    began = time.perf_counter()
    for i, (candidate, problem) in enumerate(problems):
        left = remaining(time.perf_counter() - began, i, len(problems))
        tell(f"information of window {i + 1} of {len(problems)}{left}")
        matrix = model.information(problem)
        if matrix is not None:
            kept.append(candidate)
            matrices.append(matrix)
    if not kept:
        raise _nothing_found(flights, vehicle, unmeasured=True)
    prior = model.prior + BOX_INFORMATION * np.eye(len(model.unit))
    return kept, CandidateInformation(prior, tuple(matrices)), model


@dataclass(frozen=True, eq=False)
class _Report:
    """Turns a selection into proposed windows with reasons."""

    flights: Mapping[str, Flight]
    excitations: Mapping[str, Excitation]
    found: Sequence[Candidate]
    information: CandidateInformation
    model: VehicleInformation | None

    def windows(self, selection: Selection) -> list[Proposed]:
        """Return the windows to fit, those to predict, and maneuvers that were declined, in order of time."""
        rows: list[tuple[int, str, float, bool, Literal["fit", "validate"]]] = []
        for k, (index, gain) in enumerate(zip(selection.fitted, selection.gains, strict=True)):
            rows.append(
                (index, self._why(index, self.information.total(selection.fitted[:k])), gain, True, "fit")
            )
        words = "held out, to be predicted"
        rows += [(i, f"{self._excited(i)}; {words}", 0.0, True, "validate") for i in selection.held_out]
        taken = [index for index, *_ in rows]
        left = [i for i, one in enumerate(self.found) if one.maneuver is not None and i not in taken]
        for i in sorted(left, key=self.information.gain_alone, reverse=True)[: LIMITS.max_declined]:
            clash = any(self.found[i].meets(self.found[j]) for j in taken)
            reason = "shares samples with a proposed window" if clash else "adds little to the windows chosen"
            rows.append((i, f"{self._excited(i)}; {reason}", 0.0, False, "fit"))
        out = []
        for index, why, gain, accept, use in rows:
            one, alone = self.found[index], self.information.gain_alone(index)
            axis = next(iter(self.axes(index)), NO_AXIS)
            span = (one.flight, one.start, one.stop)
            out.append(Proposed(*span, axis, why, alone, gain, accept, use, one.maneuver))
        return sorted(out, key=lambda w: (w.flight, w.start))

    def axes(self, index: int) -> dict[str, float]:
        """Return how many times the usual the excited axes move, that of a maneuver first, then the strongest."""
        one = self.found[index]
        excitation = self.excitations.get(one.flight)
        sizes = {} if excitation is None else excitation.strengths(self.flights[one.flight], one)
        real = {} if excitation is None else excitation.commanded(self.flights[one.flight], one)
        own: list[str] = [one.maneuver.axis] if one.maneuver is not None else []
        return {a: sizes.get(a, 0.0) for a in (*own, *sorted(real, key=lambda a: -real[a])[:1])}

    def _excited(self, index: int) -> str:
        axes = self.axes(index).items()
        parts = [f"{a} command {x:.1f}" for a, x in axes]
        return f"{', '.join(parts)} times the usual" if parts else "no command stands out"

    def _why(self, index: int, base: FloatArray) -> str:
        words = self._excited(index)
        if self.model is None:
            one = self.found[index]
            condition = self.excitations[one.flight].condition(self.flights[one.flight], one)
            return f"{words}; condition of commands and rates {condition:.3g}"
        after = base + self.information.matrices[index]
        before, then = (np.sqrt(np.diag(np.linalg.inv(m))) for m in (base, after))
        ratio = then / before
        best = [int(i) for i in np.argsort(ratio)[: LIMITS.max_named] if ratio[i] < LIMITS.sharper]
        names = ", ".join(self.model.names[i] for i in best)
        return f"{words}; determines {names}" if names else words


def _check_inputs(flight: Flight, vehicle: Vehicle | None) -> None:
    """Refuse a flight that lacks an input of the vehicle's equations; without a vehicle, rates or commands of any kind."""
    missing = [
        r for r in FAMILIES["rates"] if r not in flight.names or not np.isfinite(flight.column(r)).any()
    ]
    if vehicle is not None:
        from stoop.extend.vehicles import require_channels

        require_channels(vehicle, flight)
        if vehicle.rotors:
            flight.require_motors_ran()
        return
    if missing:
        raise FlightError(
            f"{flight.name}: {', '.join(missing)} {'was' if len(missing) == 1 else 'were'} not recorded, and without "
            "body rates no maneuver shows; log the gyros, or name their columns in a mapping ([variables] p, q, r)"
        )
    flight.require_motors_ran()
    if not flight.commands():
        raise FlightError(
            f"{flight.name}: no command was recorded that moves (surfaces, control_roll/pitch/yaw, motor_n, servo_n, "
            "pwm_n); log them, or name their columns in a mapping (stoop map drafts one)"
        )


def _nothing_found(
    flights: Mapping[str, Flight], vehicle: Vehicle | None, unmeasured: bool = False
) -> FlightError:
    """Return the error for flights in which no window can be used, or none where inputs and state were measured."""
    name, flight = next(iter(flights.items()))
    airborne = float(flight.flying().sum()) / flight.rate
    if airborne < 2.0:
        return FlightError(
            f"{name}: the vehicle is in the air for {airborne:.1f} s only, as speed and commands show; give a log of a flight, "
            "or name windows yourself: --maneuver START:STOP"
        )
    if unmeasured and vehicle is not None:
        reason = f"no window in which the inputs ({', '.join(vehicle.recorded)}) and the state were measured is informative"
    else:
        reason = (
            "no maneuver here: no command moves out of the usual beyond what feedback of the motion explains"
        )
    return FlightError(
        f"{', '.join(flights)}: {reason}; fly doublets about each axis (stoop design proposes them), or name windows yourself: "
        "--maneuver START:STOP"
    )
