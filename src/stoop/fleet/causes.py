"""What explains a change: events that were recorded, or none, by all figures of the vehicle together.

An event e, an exchange of a part or an update, mattered with the prior probability `MATTERS`, and then changed a figure f with
the probability p(f, e): `DEPENDS` where f depends on the part, `OTHERWISE` where it does not, `UPDATE` for software. With the
Bayes factor B(f, e) of a change of f in the first flight after e, its size normal about zero, the other figures tell by

    G(e) = product over f of 1 - p(f, e) + p(f, e) B(f, e)

whether e mattered; of several events before one flight two may have. Half of the prior probability is that of none, in any
flight, half that of the events, in proportion to p of the figure that changed.

References
----------
.. [1] R. E. Kass, A. E. Raftery, "Bayes factors", Journal of the American Statistical Association 90 (1995) 773.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations, groupby, pairwise
from typing import Final

import numpy as np
from scipy.special import logsumexp

from stoop.base.arrays import FloatArray
from stoop.fleet.changes import Kind, Readings, sizes
from stoop.fleet.parts import Parts
from stoop.fleet.table import FigureTable

AT_EVENTS: Final = 0.5  #: prior probability that a change began with an event
MATTERS: Final = 0.05
DEPENDS: Final = 0.5
UPDATE: Final = 0.1
OTHERWISE: Final = 0.02
SHORTEST: Final = 1e-6  #: days
USUAL: Final = 3.0  #: standard deviation of the size of changes, over that of a flight


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
        readings = self.readings.until(last)
        return Stretch(self.rows.span(first, last), readings.since_flight(first) if first else readings)

    def factors(self, kind: Kind) -> FloatArray:
        """Return the logarithms (n - 1,) of the Bayes factors of a change that began in the second flight to the last."""
        size, variance = sizes(self.readings, kind)
        prior = (USUAL * float(np.median(self.readings.deviations))) ** 2
        if kind == "drift":
            prior /= max(float(np.ptp(self.readings.times)), SHORTEST) ** 2
        told = prior / (prior + variance)  # zero where nothing is known of the size
        return np.asarray(0.5 * np.log1p(-told) + 0.5 * told * size**2 / variance)

    def factor_at(self, event: Event, factors: FloatArray) -> float:
        """Return the logarithm for the first flight after an event; zero where there is no flight before or none after."""
        k = int(np.searchsorted(self.rows.time, event.time))
        return float(factors[k - 1]) if 0 < k < len(self.rows.time) else 0.0


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
    possible = sorted((e for e in recorded if time[0] < e.time <= time[-1]), key=lambda e: e.time)
    share = AT_EVENTS if possible else 0.0
    found: list[tuple[float, str, int, tuple[str, ...]]] = [
        (np.log1p(-share) + logsumexp(factors) - np.log(len(factors)), "", 1 + int(np.argmax(factors)), ())
    ]
    beside = {f: one for f, s in others.items() if (one := s.between(time[0], time[-1] + 1.0)) is not None}
    told = {f: one.factors(kind) for f, one in beside.items()}
    likely = sum(event.matters_to(own.places) for event in possible)
    for k, together in groupby(possible, key=lambda event: int(np.searchsorted(time, event.time))):
        for event, weight, named in _weighed([*together], beside, told):
            prior = float(np.log(share * event.matters_to(own.places) / likely))
            found.append((prior + weight + float(factors[k - 1]), event.what, k, named))
    total = logsumexp([weight for weight, *_ in found])
    made = [
        Cause(what, own.rows.flight[k], float(np.exp(weight - total)), named)
        for weight, what, k, named in found
    ]
    return tuple(sorted(made, key=lambda one: -one.probability))


def _weighed(
    together: Sequence[Event], beside: Mapping[str, Stretch], told: Mapping[str, FloatArray]
) -> Iterator[tuple[Event, float, tuple[str, ...]]]:
    """Yield events before one flight, each with the figures that changed with it.

    Between them stands the logarithm of the probability that it mattered by the other figures, over that before. Two of them may
    have mattered.
    """
    count = len(together)
    subsets = np.array(
        [[i in s for i in range(count)] for k in range(3) for s in combinations(range(count), k)]
    )
    mattered = subsets.sum(axis=1)
    evidence = mattered * np.log(MATTERS) + (count - mattered) * np.log1p(-MATTERS)
    named = [list[str]() for _ in together]
    for f, one in beside.items():
        p = np.array([event.matters_to(one.places) for event in together])
        factor = one.factor_at(together[0], told[f])
        unchanged = subsets @ np.log1p(-p)
        with np.errstate(divide="ignore"):
            evidence = evidence + np.logaddexp(np.log(-np.expm1(unchanged)) + factor, unchanged)
        for own, share in zip(named, p.tolist(), strict=True):
            own += [f] if np.log(share) + factor > np.log1p(-share) else []
    for event, with_it, own in zip(together, subsets.T, named, strict=True):
        ratio = logsumexp(evidence[with_it]) - logsumexp(evidence) - np.log(MATTERS)
        yield event, float(ratio), tuple(own)
