"""Flights -> windows proposed for fitting and for prediction, with reasons."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.design.windows.by_command import Motion, by_command
from stoop.design.windows.by_vehicle import Posed, Sensitive, by_vehicle, judged, of_flights
from stoop.design.windows.candidates import Candidate, candidates
from stoop.design.windows.choice import Choice, Evidence, choose
from stoop.design.windows.driven import with_motors
from stoop.design.windows.refuse import no_maneuver, nothing_found, require_commands, require_inputs
from stoop.estimate import mismatch
from stoop.flight import Flight
from stoop.flight.maneuvers import Axis, commands, output_families
from stoop.problem.windows import whole
from stoop.vehicle import Vehicle

Use = Literal["fit", "validate"]
JUDGED: Final = 100  #: windows of a flight whose information is worked out, the most active ones
ACTIVE: Final = 2.0  #: times the usual; a window with less is of no axis
REST: Final = "motion"  #: of windows in which no command stands out
SHARPER: Final = 0.8  #: of an error bar before; a parameter that falls below is named as a reason
NAMED: Final = 3
DECLINED: Final = 6  #: windows that are shown beside those that are proposed
TURNED_DOWN: Final = "adds little to the windows chosen"
UNTOLD: Final = (
    0.5  #: share of the free numbers, unknown to their own size, that leaves a calm flight nothing to fit
)
OVERLAPS: Final = "shares samples with a proposed window"


@dataclass(frozen=True)
class Proposed:
    """One window.

    Attributes
    ----------
    flight, start, stop : name, and s on the log's own clock
    axis : which was moved, or "motion"
    why : in plain words
    information : mean logarithm by which it alone shrinks the error bars
    gain : likewise, beside the windows that were chosen before it; 0 for those that are predicted or turned down
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
    """How well a free number will be known.

    Attributes
    ----------
    name : of the parameter
    value : first guess, where the sensitivities were taken, SI; the fit replaces it
    std_error : predicted for the proposed windows together, SI; infinite where they do not tell
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
    notes : plain words
    """

    windows: tuple[Proposed, ...]
    expected: tuple[Expected, ...] = ()
    notes: tuple[str, ...] = field(default=())

    def texts(self, use: Use) -> list[str]:
        """Return the accepted windows of a kind, as the command line takes them."""
        return [f"{w.flight}@{w.start:g}:{w.stop:g}" for w in self.windows if w.accept and w.use == use]


def doubts(flights: Mapping[str, Flight], vehicle: Vehicle) -> list[str]:
    """Say in words why a flight is hardly of this vehicle; quick, and worth saying before any window is looked for.

    Raises
    ------
    FlightError
        A flight lacks what drives the vehicle: then nothing else needs saying.
    """
    for flight in flights.values():
        require_inputs(flight, vehicle)
    flights = _driven(flights, vehicle)
    return mismatch.doubts(vehicle, flights, whole(flights))


def find_windows(
    flights: Mapping[str, Flight],
    vehicle: Vehicle | None = None,
    tell: Callable[[str], None] = lambda _: None,
) -> Found:
    """Propose windows by excitation and by the information in them; what is doubtful of the flights, `doubts` says.

    Parameters
    ----------
    flights : name -> flight, of one vehicle
    vehicle : whose free numbers the windows are to tell; without one, windows that move each axis by itself
    tell : is told what is done at the moment

    Raises
    ------
    FlightError
        No window can be used, with the reason.
    """
    for flight in flights.values():
        if vehicle is None:
            require_commands(flight)
        else:
            require_inputs(flight, vehicle)
    flights = _driven(flights, vehicle)
    motions = {name: m for name, flight in flights.items() if (m := Motion.of(flight)) is not None}
    found = [c for flight in flights.values() for c in _of_flight(flight, vehicle, motions.get(flight.name))]
    if not found:
        raise nothing_found(flights, vehicle)
    if vehicle is None:
        evidence, sensitive = by_command(flights, _alike(motions), found), None
    else:
        found, evidence, sensitive = _judged(vehicle, flights, found, tell)
    choice = choose(found, evidence)
    if not choice.fitted:
        raise nothing_found(flights, vehicle)
    words = _Words(flights, motions, found, evidence, sensitive)
    expected = words.expected(choice)
    untold = [e.name for e in expected if not e.relative < 1.0]
    if words.calm() and len(untold) >= UNTOLD * len(expected):
        raise no_maneuver(flights, untold, len(expected))
    return Found(tuple(words.windows(choice)), tuple(expected), tuple(_notes(choice)))


def _driven(flights: Mapping[str, Flight], vehicle: Vehicle | None) -> dict[str, Flight]:
    return {name: with_motors(flight, vehicle) for name, flight in flights.items()}


def _of_flight(flight: Flight, vehicle: Vehicle | None, motion: Motion | None) -> list[Candidate]:
    """Return the candidates of a flight, the most active first, and no more than can be judged."""
    if vehicle is not None:
        channels = list(vehicle.recorded)
    else:
        direct = [c.variable for c in commands(flight) if c.variable in flight.data]
        channels = direct or next(iter(output_families(flight)), [])
    found = candidates(flight, channels)
    if motion is None:
        return found[:: max(1, len(found) // JUDGED)]
    evidence = by_command({flight.name: flight}, {flight.name: motion}, found)
    order = sorted(range(len(found)), key=lambda i: -evidence.worth(i))
    return [found[i] for i in order[:JUDGED]]


def _judged(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    found: Sequence[Candidate],
    tell: Callable[[str], None],
) -> tuple[list[Candidate], Evidence, Sensitive]:
    posed = of_flights(vehicle, flights, found)
    there = [(c, p) for c, p in zip(found, posed, strict=True) if p is not None]
    if not there:
        raise nothing_found(flights, vehicle)
    sensitive = judged(vehicle, _disjoint(there))
    evidence, told = by_vehicle(sensitive, [p for _, p in there], tell)
    if not told:
        raise nothing_found(flights, vehicle)
    return [there[i][0] for i in told], evidence, sensitive


def _disjoint(there: Sequence[tuple[Candidate, Posed]]) -> list[Posed]:
    kept: list[tuple[Candidate, Posed]] = []
    for one in there:
        if not any(one[0].meets(other) for other, _ in kept):
            kept.append(one)
    return [posed for _, posed in kept]


def _alike(motions: Mapping[str, Motion]) -> dict[str, Motion]:
    """Return the motions with what all flights have."""
    first = next(iter(motions.values()))
    shared = [n for n in first.names if all(n in m.names for m in motions.values())]
    return {name: _only(m, shared) for name, m in motions.items()}


def _only(motion: Motion, names: Sequence[str]) -> Motion:
    kept = [motion.names.index(n) for n in names]
    return Motion(tuple(names), tuple(motion.axes[i] for i in kept), motion.values[:, kept])


def _notes(choice: Choice) -> list[str]:
    if choice.held_out is None:
        return [
            "no window is left to be predicted: whatever is fitted, nothing shows how it does elsewhere; fly more, "
            'or give up one of the windows (use = "validate")'
        ]
    return []


@dataclass(frozen=True, eq=False)
class _Words:
    """Says of candidates what they are good for."""

    flights: Mapping[str, Flight]
    motions: Mapping[str, Motion]
    found: Sequence[Candidate]
    evidence: Evidence
    sensitive: Sensitive | None

    def windows(self, choice: Choice) -> list[Proposed]:
        out = []
        for k, (index, gain) in enumerate(zip(choice.fitted, choice.gains, strict=True)):
            base = self.evidence.with_all(choice.fitted[:k])
            out.append(self._proposed(index, self._why(index, base), gain, True, "fit"))
        if choice.held_out is not None:
            why = f"{self._moved(choice.held_out)}; held out, to be predicted"
            out.append(self._proposed(choice.held_out, why, 0.0, True, "validate"))
        out += [self._proposed(i, why, 0.0, False, "fit") for i, why in self._declined(choice)]
        return sorted(out, key=lambda w: (w.flight, w.start))

    def expected(self, choice: Choice) -> list[Expected]:
        if self.sensitive is None:
            return []
        errors = self.sensitive.errors([self.evidence.told[i] for i in choice.fitted])
        rows = zip(self.sensitive.names, self.sensitive.values, errors, strict=True)
        return [Expected(name, float(value), float(error)) for name, value, error in rows]

    def _proposed(self, index: int, why: str, gain: float, accept: bool, use: Use) -> Proposed:
        one = self.found[index]
        worth = self.evidence.worth(index)
        return Proposed(one.flight, one.start, one.stop, self._axis(index), why, worth, gain, accept, use)

    def _declined(self, choice: Choice) -> list[tuple[int, str]]:
        """Return maneuvers that were seen but are not proposed, and why, the most telling first."""
        taken = [*choice.fitted, *([] if choice.held_out is None else [choice.held_out])]
        shown: list[tuple[int, str]] = []
        for i in sorted(range(len(self.found)), key=self.evidence.worth, reverse=True):
            one = self.found[i]
            if i in taken or one.maneuver is None or len(shown) == DECLINED:
                continue
            clash = any(one.meets(self.found[j]) for j in taken)
            shown.append((i, f"{self._moved(i)}; {OVERLAPS if clash else TURNED_DOWN}"))
        return shown

    def calm(self) -> bool:
        """Whether nothing anywhere in the flights is a maneuver or looks like one."""
        return not any(self._named(i) for i in range(len(self.found)))

    def _axis(self, index: int) -> str:
        return next(iter(self._named(index)), REST)

    def _named(self, index: int) -> list[Axis]:
        """Return the axes that moved, that of a maneuver first, then the strongest."""
        one, sizes = self.found[index], self._strengths(index)
        strongest = [a for a in sorted(sizes, key=lambda a: -sizes[a])[:1] if sizes[a] > ACTIVE]
        own: list[Axis] = [one.maneuver.axis] if one.maneuver is not None else []
        return list(dict.fromkeys([*own, *strongest]))

    def _strengths(self, index: int) -> Mapping[Axis, float]:
        one = self.found[index]
        motion = self.motions.get(one.flight)
        return motion.strengths(self.flights[one.flight], one) if motion is not None else {}

    def _moved(self, index: int) -> str:
        sizes = self._strengths(index)
        said = [f"{axis} command {_times(sizes.get(axis, 0.0))}" for axis in self._named(index)]
        return f"{', '.join(said)} times the usual" if said else "no command stands out"

    def _why(self, index: int, base: FloatArray) -> str:
        words = self._moved(index)
        if self.sensitive is None:
            one = self.found[index]
            condition = self.motions[one.flight].condition(self.flights[one.flight], one)
            return f"{words}; condition of commands and rates {condition:.3g}"
        after = base + self.evidence.told[index]
        before, then = (np.sqrt(np.diag(np.linalg.inv(m))) for m in (base, after))
        ratio = then / before
        best = [int(i) for i in np.argsort(ratio)[:NAMED] if ratio[i] < SHARPER]
        tells = ", ".join(self.sensitive.names[i] for i in best)
        return f"{words}; tells {tells}" if tells else words


def _times(strength: float) -> str:
    return f"{strength:.1f}" if strength < 100.0 else "over 100"
