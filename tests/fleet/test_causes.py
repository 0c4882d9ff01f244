"""Causes by all figures of a vehicle: the part that a figure depends on, the event on which others changed with it."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from stoop_fleet.causes import Cause, Event, Stretch, causes, unrecorded
from stoop_fleet.changes import KINDS, Change, Kind, Readings
from stoop_fleet.table import FigureTable

FLIGHTS = 60


def stretch(figure: str, place: str, first: int, size: float, seed: int = 0) -> Stretch:
    time, ones = np.arange(float(FLIGHTS)), np.ones(FLIGHTS)
    values = np.random.default_rng([seed, len(figure)]).standard_normal(FLIGHTS) + size * (time >= first)
    texts = {"flight": [f"f{i}" for i in range(FLIGHTS)], "vehicle": ["v"] * FLIGHTS}
    texts |= {"figure": [figure] * FLIGHTS, "parts": [place] * FLIGHTS}
    table = FigureTable.of_columns(texts, {"time": time, "value": values, "std_error": ones}, {})
    return Stretch(table, Readings.about_a_level(values, ones, time))


def of(own: Stretch, events: list[Event], others: Mapping[str, Stretch] | None = None) -> Cause:
    found = causes(own, "step", events, others or {})
    assert sum(one.probability for one in found) == pytest.approx(1.0)
    return found[0]


ROTOR, UPDATE = Event("rotor", "rotor_1", 30.0), Event("software", "software", 30.0)
BATTERY = Event("battery", "battery", 40.0)


def test_a_step_that_takes_back_another() -> None:
    up = Change("step", 20, 22, 1.0, 0.1, 50.0)
    for size, taken in ((-1.05, True), (-0.5, False), (-2.0, False), (1.0, False)):
        assert Change("step", 40, 42, size, 0.1, 50.0).takes_back(up) is taken
    assert not Change("drift", 40, 42, -1.0, 0.1, 50.0).takes_back(up)


def test_a_figure_of_two_flights_on_one_day_says_nothing_of_a_drift() -> None:
    one = stretch("drag", "", 30, 9.0).between(29.0, 31.0)
    still = replace(one, readings=replace(one.readings, times=np.zeros(2)))
    assert still.factors("drift") == pytest.approx(np.zeros((4, 1)))


def naive(kind: Kind, own: Stretch, events: list[Event], others: dict[str, Stretch]) -> dict[str, float]:
    """Return the probability of each cause: every hypothesis, flight by flight, as the docstring of the module has it."""
    every = {"": own, **others}
    factors = {f: np.exp(np.pad(one.factors(kind), ((0, 0), (1, 1)))) for f, one in every.items()}
    prior = {"": 1.0 / 3000.0} | {e.what: 0.05 * (0.2 if kind == "drift" else 1.0) for e in events}

    def p(f: str, s: Event) -> float:
        places = every[f].places
        return 0.5 if s.place in places else 0.1 if s.place in ("", "software") else 0.002

    def B(f: str, s: Event, k: int, a: int) -> float:
        lesser = s.place in every[f].places[1:]
        return float(factors[f][a if lesser else a + 1, k])

    pairs = [(s, k) for s in events for k in range(1, FLIGHTS) if k - 1 < s.time <= k]
    pairs += [(s, k) for s in unrecorded(["rotor_1", "battery"]) for k in range(1, FLIGHTS)]
    each = [(s, k, a) for s, k in pairs for a in range(3)]
    A = {g: 1.0 + sum(prior[s.what] * p(g, s) * B(g, s, k, a) for s, k, a in each) / 3.0 for g in others}
    out = dict.fromkeys(prior, 0.0)
    for s, k, a in each:
        weight = prior[s.what] * p("", s) * B("", s, k, a)
        for g in others:
            weight *= 1.0 - p(g, s) + p(g, s) * B(g, s, k, a) / A[g]
        out[s.what] += weight
    return {what: weight / sum(out.values()) for what, weight in out.items()}


@pytest.mark.parametrize(("kind", "seed"), [*((kind, 0) for kind in KINDS), ("step", 1)])
def test_causes_are_those_of_every_hypothesis(kind: Kind, seed: int) -> None:
    own = stretch("share", "rotor_1", 28, 2.0, seed)
    lift = stretch("lift", "battery rotor_1", 28, 1.5, seed)
    others = {"lift": lift, "resistance": stretch("resistance", "battery", 41, 3.0, seed)}
    events = [ROTOR, UPDATE, BATTERY]
    found = {one.what: one.probability for one in causes(own, kind, events, others)}
    assert found == pytest.approx(naive(kind, own, events, others), rel=1e-9)


@pytest.mark.parametrize("weak", range(3))
def test_the_rotor_is_named_whose_share_moves_the_others_with_it(weak: int) -> None:
    names = ["m1", "m2", "m3"]
    places = [" ".join([name, *(n for n in names if n != name)]) for name in names]
    sizes = [6.0 if i == weak else -3.0 for i in range(3)]
    shares = {n: stretch(f"share.{n}", places[i], 20, sizes[i], i) for i, n in enumerate(names)}
    exchange = Event(f"{names[weak]}: b for a", names[weak], 19.5)
    for name in names:
        others = {f: one for f, one in shares.items() if f != name}
        alone, recorded = of(shares[name], [], others), of(shares[name], [exchange], others)
        assert (alone.place, alone.flight, alone.figures) == (names[weak], "f20", tuple(others))
        assert recorded.what == exchange.what
        assert recorded.probability > 0.95


def test_the_event_is_named_that_explains_what_changed() -> None:
    named = {"share": "rotor_1", "climb": "", "drag": ""}
    share, climb, drag = (stretch(figure, place, 30, 3.0) for figure, place in named.items())
    lift, early = stretch("lift", "", 99, 0.0), stretch("share", "rotor_1", 20, 4.0)
    worn = stretch("resistance", "battery", 30, 4.0)
    for name, own, events, others, what, place in (
        ("part", share, [ROTOR, UPDATE, BATTERY], {}, "rotor", "rotor_1"),
        ("other part", drag, [Event("rotor", "rotor_2", 30.0), UPDATE], {}, "software", "software"),
        ("all figures", share, [ROTOR, UPDATE], {"climb": climb, "drag": drag, "lift": lift}, "software", "software"),
        ("another day", early, [BATTERY], {"resistance": stretch("resistance", "battery", 40, 9.0)}, "", "rotor_1"),
        ("same day", worn, [ROTOR], {"share": stretch("share", "rotor_1", 30, 0.0)}, "", "battery"),
        ("same day, changed", worn, [ROTOR], {"share": stretch("share", "rotor_1", 30, 4.0)}, "rotor", "rotor_1"),
        ("unrecorded", early, [BATTERY], {"resistance": stretch("resistance", "battery", 99, 0.0)}, "", "rotor_1"),
        ("no place", stretch("lift", "", 20, 4.0), [], {}, "", ""),
    ):  # fmt: skip
        found = of(own, events, others)
        assert (found.what, found.place) == (what, place), name
        assert name != "all figures" or found.figures == ("climb", "drag")
        assert name != "unrecorded" or found.name == "nothing that was recorded, most likely of rotor_1"
    beyond = of(stretch("share", "rotor_1", 20, 900.0), [])  # the range of numbers
    assert (beyond.flight, beyond.probability) == ("f20", 1.0)
