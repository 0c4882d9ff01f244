"""What explains a change: events that were recorded, or none, by all figures of the vehicle together.

An event e, an exchange of a part or an update, mattered with the prior probability `MATTERS`, and then changed a figure f with
the probability p(f, e): `DEPENDS` where f depends on the part, `OTHERWISE` where it does not, `UPDATE` for software. With the
Bayes factor B(f, e) of a change of f in the first flight after e, its size normal about zero, the other figures tell by

    G(e) = product over f of 1 - p(f, e) + p(f, e) B(f, e)

whether e mattered. Half of the prior probability is that of the events, equally, half that of none, in any flight.

References
----------
.. [1] R. E. Kass, A. E. Raftery, "Bayes factors", Journal of the American Statistical Association 90 (1995) 773.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.fleet.changes import Kind, Readings, sizes
from stoop.fleet.parts import Parts
from stoop.fleet.table import FigureTable

AT_EVENTS: Final = 0.5  #: prior probability that a change began with an event
MATTERS: Final = 0.2
DEPENDS: Final = 0.5
UPDATE: Final = 0.2
OTHERWISE: Final = 0.02
USUAL: Final = 3.0  #: standard deviation of the size of changes, over that of a flight
LARGEST: Final = 500.0  #: logarithm of a Bayes factor


@dataclass(frozen=True)
class Event:
    """What was recorded of a vehicle."""

    what: str
    place: str  #: of the part; empty for software
    time: float  #: s since 1970, from when

    def matters_to(self, places: Sequence[str]) -> float:
        """Return the probability with which it changes a figure of these places, if it matters at all."""
        return UPDATE if not self.place else DEPENDS if self.place in places else OTHERWISE


@dataclass(frozen=True)
class Cause:
    """What may explain a change."""

    what: str  #: such as "rotor_1: P17 for P03", "software: 1.2 for 1.1", or empty for none that was recorded
    flight: str  #: in which the change began then
    probability: float
    figures: tuple[str, ...] = ()  #: others of the vehicle that changed with it

    @property
    def name(self) -> str:
        """What it is, in words."""
        return self.what or "nothing that was recorded"


@dataclass(frozen=True, eq=False)
class Stretch:
    """Flights of a vehicle and figure among which a change is to be explained."""

    rows: FigureTable
    readings: Readings

    @property
    def places(self) -> list[str]:
        """Places of the parts on which the figure depends."""
        return self.rows.parts[0].split()

    def between(self, begin: float, end: float) -> Stretch | None:
        """Return the flights from a time to another, s since 1970, their level unknown; None for fewer than two."""
        first, last = np.searchsorted(self.rows.time, [begin, end], side="left").tolist()
        if last - first < 2:
            return None
        inside = (np.arange(len(self.rows.time)) >= first) & (np.arange(len(self.rows.time)) < last)
        readings = self.readings.until(last)
        return Stretch(self.rows.rows(inside), readings.since_flight(first) if first else readings)

    def factors(self, kind: Kind) -> FloatArray:
        """Return the logarithms (n - 1,) of the Bayes factors of a change that began in the second flight to the last."""
        size, variance = sizes(self.readings, kind)
        prior = (USUAL * float(np.median(self.readings.deviations))) ** 2
        if kind == "drift":
            prior /= float(np.ptp(self.readings.times)) ** 2
        told = prior / (prior + variance)  # zero where nothing is known of the size
        return np.minimum(0.5 * np.log1p(-told) + 0.5 * told * size**2 / variance, LARGEST)

    def factor_at(self, event: Event, factors: FloatArray) -> float:
        """Return the Bayes factor of a change in the first flight after an event; one where there is none before or after."""
        k = int(np.searchsorted(self.rows.time, event.time))
        return float(np.exp(factors[k - 1])) if 0 < k < len(self.rows.time) else 1.0


def events(rows: FigureTable, parts: Parts, vehicle: str) -> Iterator[Event]:
    """Yield what was exchanged or updated on a vehicle."""
    for old, new in parts.exchanges(vehicle):
        yield Event(f"{new.part}: {new.serial} for {old.serial}", new.part, new.begin)
    for (before, after), time in zip(pairwise(rows.software), rows.time[1:].tolist(), strict=True):
        if before and after and before != after:
            yield Event(f"software: {after} for {before}", "", time)


def causes(
    own: Stretch, kind: Kind, recorded: Sequence[Event], others: Mapping[str, Stretch]
) -> tuple[Cause, ...]:
    """Return the causes of a change, the likeliest first.

    Parameters
    ----------
    own : Stretch
        Flights from the last change before to the next one after.
    kind : step or drift
    recorded : sequence of Event
    others : figure -> Stretch, all flights of the vehicle
    """
    time, factors = own.rows.time, own.factors(kind)
    possible = [event for event in recorded if time[0] < event.time <= time[-1]]
    share = AT_EVENTS if possible else 0.0
    odds = np.exp(factors)
    likeliest = 1 + int(np.argmax(odds))
    found: list[tuple[float, str, int, tuple[str, ...]]] = [
        ((1.0 - share) * float(np.mean(odds)), "", likeliest, ())
    ]
    beside = {f: one for f, s in others.items() if (one := s.between(time[0], time[-1] + 1.0)) is not None}
    told = {f: one.factors(kind) for f, one in beside.items()}
    for event in possible:
        changed = {}
        for f, one in beside.items():
            p = event.matters_to(one.places)
            changed[f] = p * one.factor_at(event, told[f]), 1.0 - p
        log_evidence = sum(float(np.log(sum(pair))) for pair in changed.values())
        evidence = float(np.exp(min(log_evidence, LARGEST)))
        mattered = evidence / (MATTERS * evidence + 1.0 - MATTERS)
        weight = share / len(possible) * event.matters_to(own.places) / DEPENDS * mattered
        named = tuple(f for f, (with_it, without) in changed.items() if with_it > without)
        k = int(np.searchsorted(time, event.time))
        found.append((weight * own.factor_at(event, factors), event.what, k, named))
    total = sum(weight for weight, *_ in found)
    made = [Cause(what, own.rows.flight[k], weight / total, named) for weight, what, k, named in found]
    return tuple(sorted(made, key=lambda one: -one.probability))
