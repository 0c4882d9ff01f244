from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.base.atmosphere import SEA_LEVEL_DENSITY, standard_density
from stoop.errors import FlightError
from stoop_fleet.analysis import analyze
from stoop_fleet.parts import Parts
from stoop_plan.input_design.windows import find_windows
from stoop_studies.verify import decisions, extensions, pilots, windows
from stoop_studies.verify.capture import NOISE, fly
from stoop_studies.verify.fleet import BACK, CHANGED, UPDATED, Flown, drawn, least_delay
from stoop_studies.verify.made_up import GRAVITY, made_up

ROTOR = "another propeller, step"


def test_a_lag_that_is_missing_is_named() -> None:
    (result,) = extensions.examine({"case": "lag-aileron", "seed": 1}, [None])
    (found,) = result["flights"]
    assert found["named"]
    assert found["harm"] > 5.0
    assert found["value"] == pytest.approx(0.04, abs=0.02)


def test_inputs_are_found_and_gusts_are_no_maneuver() -> None:
    for case in (c for c in windows.CASES if c.endswith("moderate")):
        flown = windows.CASES[case](7)
        if "gusts" in case:
            with pytest.raises(FlightError, match="no maneuver here"):
                find_windows({flown.flight.name: flown.flight}, flown.start)
            continue
        assert len(flown.spans) == 3
        found = find_windows({flown.flight.name: flown.flight})
        assert all(windows.held(found, span) for span in flown.spans), case
        assert all(any(w.start < b and a < w.stop for a, b in flown.spans) for w in found.windows), case


@pytest.mark.parametrize(
    ("case", "called"), [("clipped", "faults"), ("stuck", "stuck-channels"), ("reduced", "recorded-motion")]
)
def test_a_case_calls_for_its_decision(case: str, called: str) -> None:
    found = decisions.compare({"case": f"aircraft-{case}", "seed": 3}, [None])[0]
    assert {called, "all"} <= set(found["without"])
    assert set(found["default"]) == set(decisions.FIGURES)
    assert found["default"]["bias"] < 2.5


def test_rotors_carry_the_weight_in_the_air_of_the_recorded_altitude() -> None:
    vehicle = made_up(3).vehicle
    flown = pilots.on_rotors(vehicle, np.zeros(2), np.random.default_rng(0))
    x = np.array([flown[name][0] for name in vehicle.recorded])
    thrust = np.sum(vehicle.value("rotors.T1") * x + vehicle.value("rotors.T2") * x**2)
    air = standard_density(flown["altitude"][:1])[0] / SEA_LEVEL_DENSITY
    assert air * thrust == pytest.approx(GRAVITY * vehicle.value("mass.mass"), rel=1e-3)


def test_a_log_holds_noisy_poses_and_commands_as_they_were_sent(tmp_path: Path, monkeypatch: Any) -> None:
    moved, by_stoop = list[pilots.Columns](), pilots.by_stoop
    monkeypatch.setattr(pilots, "by_stoop", lambda *given: moved.append(by_stoop(*given)) or moved[-1])
    for seed in range(2):
        flown, late = fly("wings", seed, tmp_path)
        table = np.genfromtxt(flown.path, delimiter=",", names=True)
        time = table["t"]
        pilot = moved[-1]["elevator"]
        sent = np.interp(time + late, np.arange(len(pilot)) / pilots.RATE, pilot)
        np.testing.assert_allclose(table["elevator"], sent, atol=2e-5)
        truth = np.interp(time, flown.time, flown.commands["elevator"])  # not smoothed: the gain of 1 stays
        np.testing.assert_allclose(table["elevator"], truth, atol=2e-5)
        name = "x_n" if seed % 2 == 0 else "pos_n"
        third = np.diff(table[name], 3)  # of white noise they have 20 times its variance
        assert 0.9 < np.std(third) / (np.sqrt(20.0) * NOISE["position"]) < 1.1


def test_a_weak_rotor_is_found_with_its_exchange_and_a_roll_back_is_one() -> None:
    rotor = drawn(ROTOR, np.random.default_rng(1), 6, 80)
    alarms = [a for a in analyze(rotor.table, rotor.parts).alarms if a.vehicle == CHANGED]
    share = next(a for a in alarms if a.figure == "share.rotor_1")
    assert share.causes[0].what.startswith("rotor_1: ")
    assert abs(share.change.first - rotor.first) <= 1
    back = drawn(BACK, np.random.default_rng(2), 6, 120)
    alarms = [a for a in analyze(back.table, back.parts).alarms if a.vehicle == CHANGED]
    steep, again = (a for a in alarms if a.figure == "climb")
    assert steep.causes[0].what == "software: 1.1 for 1.0"
    assert again.causes[0].what == "software: 1.0 for 1.1"
    assert (steep.back, again.back) == ("", steep.began)
    assert abs(again.change.first - back.first - UPDATED) <= 2


def test_the_least_delay_is_that_of_the_information(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wald: the threshold, by Lorden, over half the square of the size, where hardly anything but the time is unknown."""
    monkeypatch.setattr("stoop_studies.verify.fleet.UNCHANGED", 400)

    def least(case: str, change: Callable[[Flown], Flown] = lambda fleet: fleet) -> float:
        rngs = map(np.random.default_rng, range(12))
        found = [least_delay(case, change(drawn(case, rng, 1, 200)), rng) for rng in rngs]
        return float(np.mean(np.minimum(found, 100.0)))

    size = 0.1 / np.hypot(0.03, 0.02)
    step, drift = (least(f"10 % steeper climb, {how}") for how in ("step", "drift"))
    assert step == pytest.approx(np.log(50 * 9 * 200) / (0.5 * size**2), rel=0.35)
    assert drift > 3.0 * step
    servo = "servo trim 1 deg, step"
    exchanged, known = least(servo), least(servo, lambda fleet: replace(fleet, parts=Parts(())))
    assert known < exchanged, "what exchanged servos differ by is a doubt"
