"""Drawn fleets have what their case says, and claims turn with the records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from stoop.fleet.analysis import analyze
from stoop.fleet.parts import Parts
from stoop_studies.verify.fleet import (
    BACK,
    CHANGED,
    UPDATED,
    Flown,
    drawn,
    least_delay,
)

ROTOR = "another propeller, step"


def test_a_weak_rotor_is_found_with_its_exchange_and_a_roll_back_is_one() -> None:
    rotor = drawn(ROTOR, np.random.default_rng(1), 6, 80)
    alarms = [a for a in analyze(rotor.table, rotor.parts).alarms if a.vehicle == CHANGED]
    share = next(a for a in alarms if a.figure == "share.rotor_1")
    assert share.causes[0].what.startswith("rotor_1: ")
    assert abs(share.change.first - rotor.first) <= 1
    back = drawn(BACK, np.random.default_rng(2), 6, 120)
    steep, again = (
        a for a in analyze(back.table, back.parts).alarms if a.figure == "climb" and a.vehicle == CHANGED
    )
    assert steep.causes[0].what == "software: 1.1 for 1.0"
    assert again.causes[0].what == "software: 1.0 for 1.1"
    assert (steep.back, again.back) == ("", steep.began)
    assert abs(again.change.first - back.first - UPDATED) <= 2


def test_the_least_delay_is_that_of_the_information(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wald: the threshold, by Lorden, over half the square of the size, where hardly anything but the time is unknown."""
    monkeypatch.setattr("stoop_studies.verify.fleet.UNCHANGED", 400)

    def least(case: str, change: Callable[[Flown], Flown] = lambda fleet: fleet) -> float:
        found = [
            least_delay(case, change(drawn(case, rng, 1, 200)), rng)
            for rng in map(np.random.default_rng, range(12))
        ]
        return float(np.mean(np.minimum(found, 100.0)))

    size = 0.1 / np.hypot(0.03, 0.02)
    step, drift = (least(f"10 % steeper climb, {how}") for how in ("step", "drift"))
    assert step == pytest.approx(np.log(50 * 9 * 200) / (0.5 * size**2), rel=0.35)
    assert drift > 3.0 * step
    servo = "servo trim 1 deg, step"
    exchanged, known = least(servo), least(servo, lambda fleet: replace(fleet, parts=Parts(())))
    assert known < exchanged, "what exchanged servos differ by is a doubt"
