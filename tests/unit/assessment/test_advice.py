"""The advice follows from the motion flown: what is still, what is tied, and which control parts it."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.assessment.maneuver_advice import FlownModel, Term, advice
from stoop.base.notices import Notice

T = np.linspace(0.0, 10.0, 1000)
ELEVATOR = np.sign(np.sin(2.0 * T)) * 0.05
RATE = np.convolve(ELEVATOR, np.exp(-T[:200] * 4.0), mode="full")[:1000] * 0.01


def term(name: str, variables: set[str], value: float, flown: np.ndarray) -> Term:
    return Term(name, name[:2], frozenset(variables), value, flown)


def flown(*terms: Term) -> FlownModel:
    every = {t.name: t for t in terms}
    return FlownModel(
        every, "elevator", "aileron", "rudder", "throttle", {"short period": 4.0, "Dutch roll": 2.0}
    )


def codes(found: tuple[Notice, ...]) -> tuple[str, ...]:
    """Return the code of the only notice, then that of the maneuver which it names."""
    (one,) = found
    maneuver = one.values.get("maneuver")
    return (one.code, *([maneuver.code] if isinstance(maneuver, Notice) else []))


def test_a_rate_that_follows_the_elevator_asks_for_quick_reversals_at_the_short_period() -> None:
    said = advice(
        "Cmq",
        (),
        flown(term("Cmq", {"q"}, -10.0, -0.3 * ELEVATOR), term("Cmelevator", {"elevator"}, -1.0, ELEVATOR)),
    )
    (found,) = said
    assert (found.code, found.subject, found.values["other"]) == ("advice-tied", "q", "elevator")
    assert "q moves with elevator: fly a 3-2-1-1 with elevator, unit step about 0.4 s, whose" in str(found)
    maneuver = found.values["maneuver"]
    assert isinstance(maneuver, Notice)
    assert (maneuver.code, maneuver.subject) == ("fly-short-period", "elevator")


def test_roll_and_yaw_that_move_together_ask_for_controls_at_separate_times() -> None:
    p = 0.1 * np.sin(T)
    said = advice("Clp", (), flown(term("Clp", {"p"}, -0.5, p), term("Clr", {"r"}, 0.1, 0.3 * p)))
    assert codes(said) == ("advice-tied", "fly-separate-inputs")
    assert said[0].values["other"] == "r"
    assert "move aileron and rudder at separate times" in str(said[0])


def test_an_airspeed_that_does_not_change_asks_for_speed() -> None:
    said = advice(
        "CLV",
        (),
        flown(term("CLV", {"V"}, 0.1, 1e-3 * np.sin(T)), term("CLalpha", {"alpha"}, 5.0, 0.05 * np.sin(T))),
    )
    assert codes(said) == ("advice-still-airspeed", "fly-power-steps")
    assert said[0].values["amount"] == pytest.approx(0.00067, rel=0.02)
    assert "varies by only 0.067 % (rms): let the airspeed change: throttle steps" in str(said[0])


def test_a_product_or_power_asks_for_range() -> None:
    alpha = 0.02 * np.sin(T)
    said = advice(
        "CDalpha2",
        (),
        flown(term("CDalpha2", {"alpha"}, 1.0, alpha**2), term("CDalpha", {"alpha"}, 0.3, alpha)),
    )
    assert codes(said) == ("advice-still", "fly-range")
    assert "wider range of alpha" in str(said[0])


def test_a_control_that_a_controller_moves_asks_for_an_input_of_its_own() -> None:
    beta = 0.05 * np.sin(T)
    said = advice(
        "Cnrudder",
        (),
        flown(term("Cnrudder", {"rudder"}, -0.1, 0.5 * beta + 0.2), term("Cnalpha", {"alpha"}, 0.1, beta)),
    )
    assert codes(said) == ("advice-tied", "fly-own-inputs")
    assert "add inputs of its own on rudder" in str(said[0])


def test_an_inertia_that_trades_off_is_measured_on_the_ground() -> None:
    one = flown(term("Cmq", {"q"}, -10.0, RATE))
    assert codes(advice("Cmq", ("mass.inertia.yy",), one)) == ("advice-ratio-to-inertia",)
    assert codes(advice("Cmq", ("mass.inertia.xx",), one))[0] == "advice-several", "of another axis"
    drag = flown(term("CD0", set(), 0.03, np.ones(1000)))
    assert codes(advice("CD0", ("mass.inertia.yy",), drag)) == ("advice-constant",), "a force"
    names = ("mass.inertia.yy", "propulsion.CT0", "controls.elevator.lag")
    found = {n: advice(n, (), one)[0] for n in names}
    assert [found[n].code for n in names] == ["advice-inertia", "advice-propulsion", "advice-controls"]
    assert found["propulsion.CT0"].values["power"] == "throttle"


def test_a_term_that_never_moved_and_a_constant_break_nothing() -> None:
    still = flown(term("CQp", {"p"}, 0.1, np.zeros(1000)), term("CQ0", set(), 0.01, np.ones(1000)))
    assert codes(advice("CQp", (), still)) == ("advice-still", "fly-roll")
    assert advice("CQp", (), still)[0].values["amount"] == 0.0
    assert codes(advice("CQ0", (), still)) == ("advice-constant",)


def test_sizes_are_those_of_the_largest_effect_on_the_same_coefficient() -> None:
    rng = np.random.default_rng(0)
    alpha, q, p = (size * rng.standard_normal(1000) for size in (0.1, 0.01, 0.5))
    roll = (term("Clp", {"p"}, -0.4, p), term("Cl0", set(), 0.0, 0.0 * p))
    found = flown(term("Cmalpha", {"alpha"}, -2.0, alpha), term("Cmq", {"q"}, -0.1, q), *roll).sizes
    assert found["Cmalpha"] == pytest.approx(2.0), "it is the largest itself"
    assert found["Cmq"] == pytest.approx(2.0 * np.sqrt(np.mean(alpha**2) / np.mean(q**2)))
    assert found["Clp"] == pytest.approx(0.4)
    assert "Cl0" not in found, "nothing moved it"
