r"""What explains a change: events that were recorded, or none, by all figures of the vehicle together.

A hypothesis is a source s, the flight k in which it began to change figures, and how large its changes are, a. Sources are
events, an exchange of a part or an update, which begin in the first flight after them and mattered with the prior probability
`MATTERS`; and, in any flight, with the prior probability `BY_ITSELF` for each, what was not recorded: of the part in every
place, and of anything else. A source changes a figure f, if it matters, with the probability p(f, s): `DEPENDS` where f
depends on its part, `OTHERWISE` where it does not, `ANYTHING` for what stands in no table and for software, unless f depends
on that. What an event changes it mostly changes at once: a drift has `GRADUAL` of its prior probability. Sizes are normal
about zero, with a deviation of `USUAL` times one of `SIZES`, each as likely: the same for all figures, over what flights
scatter, but the next smaller one where f depends on another part first, as a rotor's share of the thrust does on the other
rotors. With the Bayes factor B(f, k, a) of a step, or a drift, of f that begins in flight k, a hypothesis about a change of f
has the weight

.. math:: \pi(s)\, p(f, s)\, B(f, k, a) \prod_{g \ne f} \left(1 - p(g, s) + p(g, s)\, B(g, k, a) / A(g)\right), \quad
   A(g) = 1 + \sum_{s, k, a} \pi(s)\, p(g, s)\, B(g, k, a)

A(g) is what the other figure g makes of the hypotheses as a whole: one that changed on another day speaks for nothing here.

References
----------
.. [1] R. E. Kass, A. E. Raftery, "Bayes factors", Journal of the American Statistical Association 90 (1995) 773.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Final

import numpy as np
from scipy.special import logsumexp, softmax

from stoop.extend.arrays import FloatArray, IntArray
from stoop_fleet.changes import KINDS, Kind, Readings, sizes
from stoop_fleet.parts import Parts
from stoop_fleet.table import FigureTable

MATTERS: Final = 0.05
BY_ITSELF: Final = 1.0 / 3000.0  #: in a flight, each
GRADUAL: Final = 0.2
DEPENDS: Final = 0.5
ANYTHING: Final = 0.1
OTHERWISE: Final = 0.002  #: times `MATTERS` it is below `BY_ITSELF`: alone it explains no more
SHORTEST: Final = 1e-6  #: days
SOFTWARE: Final = "software"  #: its place
EVERY: Final = "all vehicles"  #: the vehicle of what an update changed in all that had it
#: standard deviation of the size of a step, and of what a drift reaches in all flights, over that of a flight
USUAL: Final[Mapping[Kind, float]] = {"step": 3.0, "drift": 10.0}
#: sizes over these that a source may have, each as likely, for all figures alike; the first is the least of lesser changes,
#: those of figures that depend on another part first
SIZES: Final = 3.0 ** np.arange(-1, 3)


@dataclass(frozen=True)
class Event:
    """What was recorded of a vehicle, or what may have happened without a record in any flight."""

    what: str  #: empty for what was not recorded
    place: str  #: of the part; empty for what stands in no table
    time: float = math.nan  #: s since 1970, from when

    def prior(self, kind: Kind) -> float:
        """Return the probability that it matters, so; of what was not recorded, that it happens before a flight."""
        return BY_ITSELF if not self.what else MATTERS * (GRADUAL if kind == "drift" else 1.0)

    def matters_to(self, places: Sequence[str]) -> float:
        """Return the probability with which it changes a figure of these places, if it matters at all."""
        known = DEPENDS if self.place in places else OTHERWISE
        return ANYTHING if self.place in ("", SOFTWARE) and self.place not in places else known

    def sizes(self, places: Sequence[str]) -> slice:
        """Return which of `SIZES` it has in a figure of these places."""
        return slice(0, -1) if self.place in places[1:] else slice(1, None)

    def flights(self, time: FloatArray) -> IntArray:
        """Return the first flights (k,) after it, of flights at times (n,); none where none is before or none after."""
        if not self.what:
            return np.arange(1, len(time))
        k = int(np.searchsorted(time, self.time))
        return np.arange(k, k + (0 < k < len(time)))


@dataclass(frozen=True)
class Cause:
    """What may explain a change."""

    what: str  #: such as "rotor_1: P17 for P03", "software: 1.2 for 1.1", or empty for none that was recorded
    flight: str  #: in which the change began then
    probability: float
    figures: tuple[str, ...] = ()  #: others of the vehicle that changed with it
    #: of the part, even of one that was not exchanged; empty where nothing in a table is likeliest
    place: str = ""

    @property
    def name(self) -> str:
        """What it is, in words."""
        of = f", most likely of {self.place}" if self.place else ""
        return self.what or f"nothing that was recorded{of}"


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
        """Return the logarithms (4, n - 1) of the Bayes factors of a change of each of `SIZES`.

        It began in the second flight to the last.
        """
        size, variance = sizes(self.readings, kind)
        prior = (SIZES[:, None] * USUAL[kind] * float(np.median(self.readings.deviations))) ** 2
        if kind == "drift":
            prior /= max(float(np.ptp(self.readings.times)), SHORTEST) ** 2
        told = prior / (prior + variance)  # zero where nothing is known of the size
        return np.asarray(0.5 * np.log1p(-told) + 0.5 * told * size**2 / variance)

    def probabilities(self, kind: Kind, sources: Sequence[Event]) -> FloatArray:
        """Return the prior probabilities (n,) that one of the sources changes the figure from each flight on."""
        out = np.zeros(len(self.rows.time))
        for source in sources:
            out[source.flights(self.rows.time)] += source.prior(kind) * source.matters_to(self.places)
        return out

    def onsets(self, recorded: Sequence[Event]) -> FloatArray:
        """Return how much likelier a change begins in each flight than without a record, see `Readings`."""
        alone = unrecorded(self.places)
        with np.errstate(invalid="ignore"):
            odds = [
                self.probabilities(kind, [*recorded, *alone]) / self.probabilities(kind, alone)
                for kind in KINDS
            ]
        return 2.0 * np.log(np.nan_to_num(odds, nan=1.0))


def unrecorded(places: Iterable[str]) -> list[Event]:
    """Return what may happen without a record: of the parts in these places, and of anything else."""
    return [Event("", place) for place in ("", *sorted(set(places)))]


def events(rows: FigureTable, parts: Parts, vehicle: str) -> Iterator[Event]:
    """Yield what was exchanged or updated on a vehicle."""
    for old, new in parts.exchanges(vehicle):
        yield Event(f"{new.part}: {new.serial} for {old.serial}", new.part, new.begin)
    for k, before, after in updates(rows):
        yield Event(software_event(before, after), SOFTWARE, float(rows.time[k]))


def updates(rows: FigureTable) -> Iterator[tuple[int, str, str]]:
    """Yield the first flight with each update of a vehicle, and the versions before and after."""
    for k, (before, after) in enumerate(pairwise(rows.software), 1):
        if before and after and before != after:
            yield k, before, after


def software_event(before: str, after: str) -> str:
    """Return what an update is called."""
    return f"{SOFTWARE}: {after} for {before}"


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
    beside = {f: one for f, s in others.items() if (one := s.between(time[0], time[-1] + 1.0)) is not None}
    sources = [e for e in recorded if time[0] < e.time <= time[-1]]
    sources += unrecorded(place for one in (own, *beside.values()) for place in one.places)
    told = {f: _told(one, kind, sources) for f, one in beside.items()}
    weighed: list[tuple[float, Cause]] = []
    for source in sources:
        at = source.flights(time)
        begun = np.array([source.time]) if source.what else time[at]
        weight = np.log(source.prior(kind) * source.matters_to(own.places))
        weight = weight + factors[source.sizes(own.places), at - 1]
        shares = {f: source.matters_to(one.places) for f, one in beside.items()}
        changed = {f: np.log(share) + told[f](source, begun) for f, share in shares.items()}
        for f, share in shares.items():
            weight = weight + np.logaddexp(np.log1p(-share), changed[f])
        best = np.unravel_index(np.argmax(weight), weight.shape)
        named = [f for f, share in shares.items() if changed[f][best] > np.log1p(-share)]
        cause = Cause(source.what, own.rows.flight[at[best[1]]], 0.0, tuple(named), source.place)
        weighed.append((float(logsumexp(weight) - np.log(len(weight))), cause))
    by_itself = [one for one in weighed if not one[1].what]
    together = (
        float(logsumexp([weight for weight, _ in by_itself])),
        max(by_itself, key=lambda one: one[0])[1],
    )
    every = [together, *(one for one in weighed if one[1].what)]
    probabilities = softmax([weight for weight, _ in every]).tolist()
    found = [replace(one, probability=p) for p, (_, one) in zip(probabilities, every, strict=True)]
    return tuple(sorted(found, key=lambda one: -one.probability))


def _told(one: Stretch, kind: Kind, sources: Sequence[Event]) -> Callable[[Event, FloatArray], FloatArray]:
    """Return the logarithms (3, m) of B(g, k) / A(g), by size, for changes by a source that began at times (m,)."""
    factors = np.pad(one.factors(kind), ((0, 0), (1, 1)))
    every = [np.zeros(1)]
    for source in sources:
        prior = np.log(source.prior(kind) * source.matters_to(one.places) / (len(SIZES) - 1))
        own = factors[source.sizes(one.places)][:, source.flights(one.rows.time)]
        every.append(prior + own.ravel())
    total = logsumexp(np.concatenate(every))
    return lambda source, begun: (
        factors[source.sizes(one.places)][:, np.searchsorted(one.rows.time, begun)] - total
    )
