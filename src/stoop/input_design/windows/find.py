"""Find windows of flights for fitting and for validation, with reasons."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import RATES
from stoop.checks.vehicle import check_vehicle, require_channels
from stoop.errors import FlightError, listed
from stoop.flight import Flight
from stoop.flight.airborne import flying, lift_command, motors_ran
from stoop.flight.maneuvers import Axis, commands, output_families
from stoop.input_design.windows.candidates import Candidate, candidates, with_motors
from stoop.input_design.windows.excitation import Excitation, excitation_information
from stoop.input_design.windows.selection import CandidateInformation, Selection, select
from stoop.input_design.windows.sensitivity import (
    CandidateProblem,
    VehicleInformation,
    candidate_problem,
    linearization_point,
)
from stoop.problem.windows import whole
from stoop.vehicle import Vehicle

Use = Literal["fit", "validate"]
MAX_CANDIDATES: Final = 100  #: of a flight, the most excited ones
MIN_EXCITATION: Final = 2.0  #: times the usual; a window with less is of no axis
NO_AXIS: Final = "motion"  #: of windows in which no command stands out
SHARPER: Final = 0.8  #: ratio of standard errors, below which a parameter is named as a reason
MAX_NAMED: Final = 3
MAX_DECLINED: Final = 6  #: windows that are shown beside those that are proposed
MAX_UNKNOWN: Final = (
    0.5  #: share of the free numbers, unknown to their own size, that leaves a calm flight nothing to fit
)


@dataclass(frozen=True)
class Proposed:
    """One window.

    Attributes
    ----------
    flight, start, stop : name, and s on the log's own clock
    axis : which was excited, or "motion"
    why : in plain words
    information : mean logarithm by which it alone shrinks the error bars
    gain : likewise, beside the windows that were selected before it; 0 for those that are predicted or declined
    accept : whether it is proposed
    use : "fit" or "validate"
    """

    flight: str
    start: float
    stop: float
    axis: str
    why: str
    information: float
    gain: float
    accept: bool
    use: Use


@dataclass(frozen=True)
class Expected:
    """The predicted standard error of a free number.

    Attributes
    ----------
    name : of the parameter
    value : first guess, where the sensitivities were taken, SI; the fit replaces it
    std_error : predicted for the proposed windows together, SI; infinite where it is not identifiable
    """

    name: str
    value: float
    std_error: float

    @property
    def relative(self) -> float:
        """Standard error over the size of the value."""
        return self.std_error / abs(self.value) if self.value else float("inf")


@dataclass(frozen=True)
class Found:
    """Windows of flights.

    Attributes
    ----------
    windows : in order of flight and time
    expected : of the vehicle's free numbers; none without a vehicle
    notices : what to mind
    """

    windows: tuple[Proposed, ...]
    expected: tuple[Expected, ...] = ()
    notices: tuple[Notice, ...] = ()

    def texts(self, use: Use) -> list[str]:
        """Return the accepted windows of a kind, as the command line takes them."""
        return [f"{w.flight}@{w.start:g}:{w.stop:g}" for w in self.windows if w.accept and w.use == use]


def doubts(flights: Mapping[str, Flight], vehicle: Vehicle) -> list[Notice]:
    """Return why a flight is hardly of this vehicle; quick, before any search.

    Raises
    ------
    FlightError
        A flight lacks an input of the vehicle.
    """
    for flight in flights.values():
        _check_vehicle_inputs(flight, vehicle)
    return check_vehicle(vehicle, {n: with_motors(f, vehicle) for n, f in flights.items()}, whole(flights))


def find_windows(
    flights: Mapping[str, Flight],
    vehicle: Vehicle | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> Found:
    """Propose windows by excitation and by the information in them.

    Parameters
    ----------
    flights : name -> flight, of one vehicle
    vehicle : whose free numbers are to be estimated; without one, windows that excite each axis by itself
    tell : called with what is being done

    Raises
    ------
    FlightError
        No window can be used, with the reason.
    """
    for flight in flights.values():
        if vehicle is None:
            _check_commands(flight)
        else:
            _check_vehicle_inputs(flight, vehicle)
    flights = {name: with_motors(flight, vehicle) for name, flight in flights.items()}
    excitations = {name: e for name, flight in flights.items() if (e := Excitation.of(flight)) is not None}
    found = [c for f in flights.values() for c in _candidates(f, vehicle, excitations.get(f.name))]
    if not found:
        raise _nothing_found(flights, vehicle)
    model: VehicleInformation | None = None
    if vehicle is None:
        first = next(iter(excitations.values()))
        shared = [n for n in first.names if all(n in e.names for e in excitations.values())]
        common = {name: e.only(shared) for name, e in excitations.items()}
        information = excitation_information(flights, common, found)
    else:
        found, information, model = _about_vehicle(vehicle, flights, found, tell)
    selection = select(found, information)
    if not selection.fitted:
        raise _nothing_found(flights, vehicle)
    report = _Report(flights, excitations, found, information, model)
    expected = report.expected(selection)
    unknown = [e.name for e in expected if not e.relative < 1.0]
    if report.calm() and len(unknown) >= MAX_UNKNOWN * len(expected):
        raise _no_maneuver(flights, unknown, len(expected))
    notices = (notice("no-validation-window"),) if selection.held_out is None else ()
    return Found(tuple(report.windows(selection)), tuple(expected), notices)


def _candidates(flight: Flight, vehicle: Vehicle | None, excitation: Excitation | None) -> list[Candidate]:
    """Return the candidates of a flight, the most excited first, and at most `MAX_CANDIDATES`."""
    if vehicle is not None:
        channels = list(vehicle.recorded)
    else:
        direct = [c.variable for c in commands(flight) if c.variable in flight.data]
        channels = direct or next(iter(output_families(flight)), [])
    found = candidates(flight, channels)
    if excitation is None:
        return found[:: max(1, len(found) // MAX_CANDIDATES)]
    information = excitation_information({flight.name: flight}, {flight.name: excitation}, found)
    order = sorted(range(len(found)), key=lambda i: -information.gain_alone(i))
    return [found[i] for i in order[:MAX_CANDIDATES]]


def _about_vehicle(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    found: Sequence[Candidate],
    tell: Callable[[str], None],
) -> tuple[list[Candidate], CandidateInformation, VehicleInformation]:
    """Return the candidates that can be simulated, and their information about the vehicle's free numbers."""
    problems = [(c, p) for c in found if (p := candidate_problem(vehicle, flights[c.flight], c)) is not None]
    if not problems:
        raise _nothing_found(flights, vehicle)
    disjoint: list[tuple[Candidate, CandidateProblem]] = []
    for one in problems:
        if not any(one[0].meets(other) for other, _ in disjoint):
            disjoint.append(one)
    model = linearization_point(vehicle, [p for _, p in disjoint])
    kept, matrices = [], []
    for i, (candidate, problem) in enumerate(problems, 1):
        tell(f"information of window {i} of {len(problems)}")
        matrix = model.information(problem)
        if matrix is not None:
            kept.append(candidate)
            matrices.append(matrix)
    if not kept:
        raise _nothing_found(flights, vehicle)
    return kept, CandidateInformation(model.weak_prior, tuple(matrices)), model


@dataclass(frozen=True, eq=False)
class _Report:
    """Turns a selection into proposed windows with reasons."""

    flights: Mapping[str, Flight]
    excitations: Mapping[str, Excitation]
    found: Sequence[Candidate]
    information: CandidateInformation
    model: VehicleInformation | None

    def windows(self, selection: Selection) -> list[Proposed]:
        """Return the windows to fit, the one to predict, and maneuvers that were declined, in order of time."""
        out = []
        for k, (index, gain) in enumerate(zip(selection.fitted, selection.gains, strict=True)):
            why = self._why(index, self.information.total(selection.fitted[:k]))
            out.append(self._proposed(index, why, gain, True, "fit"))
        if selection.held_out is not None:
            why = f"{self._excited(selection.held_out)}; held out, to be predicted"
            out.append(self._proposed(selection.held_out, why, 0.0, True, "validate"))
        taken = [*selection.fitted, *([] if selection.held_out is None else [selection.held_out])]
        declined = 0
        for i in sorted(range(len(self.found)), key=self.information.gain_alone, reverse=True):
            one = self.found[i]
            if i not in taken and one.maneuver is not None and declined < MAX_DECLINED:
                clash = any(one.meets(self.found[j]) for j in taken)
                reason = (
                    "shares samples with a proposed window" if clash else "adds little to the windows chosen"
                )
                out.append(self._proposed(i, f"{self._excited(i)}; {reason}", 0.0, False, "fit"))
                declined += 1
        return sorted(out, key=lambda w: (w.flight, w.start))

    def expected(self, selection: Selection) -> list[Expected]:
        """Return the predicted standard errors of the windows to fit."""
        if self.model is None:
            return []
        errors = self.model.errors([self.information.matrices[i] for i in selection.fitted])
        rows = zip(self.model.names, self.model.values, errors, strict=True)
        return [Expected(name, float(value), float(error)) for name, value, error in rows]

    def calm(self) -> bool:
        """Whether nothing anywhere in the flights is a maneuver or looks like one."""
        return not any(self._axes(i) for i in range(len(self.found)))

    def _proposed(self, index: int, why: str, gain: float, accept: bool, use: Use) -> Proposed:
        one, alone = self.found[index], self.information.gain_alone(index)
        axis = next(iter(self._axes(index)), NO_AXIS)
        return Proposed(one.flight, one.start, one.stop, axis, why, alone, gain, accept, use)

    def _axes(self, index: int) -> list[Axis]:
        """Return the axes that were excited, that of a maneuver first, then the strongest."""
        one, sizes = self.found[index], self._strengths(index)
        strongest = [a for a in sorted(sizes, key=lambda a: -sizes[a])[:1] if sizes[a] > MIN_EXCITATION]
        own: list[Axis] = [one.maneuver.axis] if one.maneuver is not None else []
        return list(dict.fromkeys([*own, *strongest]))

    def _strengths(self, index: int) -> Mapping[Axis, float]:
        one = self.found[index]
        excitation = self.excitations.get(one.flight)
        return excitation.strengths(self.flights[one.flight], one) if excitation is not None else {}

    def _excited(self, index: int) -> str:
        sizes = self._strengths(index)
        times = {a: sizes.get(a, 0.0) for a in self._axes(index)}
        parts = [f"{a} command {f'{x:.1f}' if x < 100.0 else 'over 100'}" for a, x in times.items()]
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
        best = [int(i) for i in np.argsort(ratio)[:MAX_NAMED] if ratio[i] < SHARPER]
        names = ", ".join(self.model.names[i] for i in best)
        return f"{words}; tells {names}" if names else words


def _check_commands(flight: Flight) -> None:
    """Refuse a flight without rates, or without anything that commands them."""
    missing = [r for r in RATES if r not in flight.data or not np.isfinite(flight.column(r)).any()]
    if missing:
        raise FlightError(
            f"{flight.name}: {', '.join(missing)} {'was' if len(missing) == 1 else 'were'} not recorded, and without "
            "body rates no maneuver shows; log the gyros, or name their columns in a mapping ([variables] p, q, r)"
        )
    _check_motors(flight)
    if not commands(flight):
        raise FlightError(
            f"{flight.name}: no command was recorded that moves (surfaces, control_roll/pitch/yaw, motor_n, servo_n, "
            "pwm_n); log them, or name their columns in a mapping (stoop map drafts one)"
        )


def _check_vehicle_inputs(flight: Flight, vehicle: Vehicle) -> None:
    """Refuse a flight that lacks an input of the vehicle's equations."""
    require_channels(vehicle, flight)
    if vehicle.rotors:
        _check_motors(flight)


def _check_motors(flight: Flight) -> None:
    """Refuse a flight in which no rotor was ever commanded to turn."""
    if not motors_ran(flight):
        command = lift_command(flight)
        most = 0.0 if command is None else float(np.nanmax(np.append(command, 0.0)))
        raise FlightError(
            f"{flight.name}: the motors never ran (their commands reach {100.0 * most:.0f} % at most): nothing flew in this "
            "log; give a log of a flight, or check the scale of the motor channels in the mapping"
        )


def _nothing_found(flights: Mapping[str, Flight], vehicle: Vehicle | None) -> FlightError:
    """Return the error for flights in which no window can be used."""
    name, flight = next(iter(flights.items()))
    airborne = float(flying(flight).sum()) / flight.rate
    other = "or name windows yourself: --maneuver START:STOP"
    if airborne < 2.0:
        return FlightError(
            f"{name}: the vehicle is in the air for {airborne:.1f} s only, as speed and commands show; give a log of a "
            f"flight, {other}"
        )
    if vehicle is None:
        reason = "no window moves the vehicle out of the usual"
    else:
        reason = f"no window in which the inputs ({', '.join(vehicle.recorded)}) and the state were measured is informative"
    return FlightError(
        f"{name}: {reason}; fly doublets about each axis (stoop design proposes them), {other}"
    )


def _no_maneuver(flights: Mapping[str, Flight], unknown: Sequence[str], free: int) -> FlightError:
    """Return the error for flights in which nobody moved anything."""
    share = f", and {len(unknown)} of {free} free numbers would not be known to their own size ({listed(unknown, MAX_NAMED)})"
    return FlightError(
        f"{', '.join(flights)}: no maneuver here: no command moves out of the usual{share if unknown else ''}; fly doublets "
        "about each axis (stoop design proposes them), or name windows yourself: --maneuver START:STOP"
    )
