"""The advice follows from the motion flown: what is still, what is tied, and which control parts it."""

import numpy as np
import pytest

from stoop.assessment.maneuver_advice import FlownModel, Term, advice

T = np.linspace(0.0, 10.0, 1000)
ELEVATOR = np.sign(np.sin(2.0 * T)) * 0.05
RATE = np.convolve(ELEVATOR, np.exp(-T[:200] * 4.0), mode="full")[:1000] * 0.01


def term(name: str, variables: set[str], value: float, flown: np.ndarray) -> Term:
    return Term(name, name[:2], frozenset(variables), value, flown)


def flown(*terms: Term) -> FlownModel:
    modes = {"short period": 4.0, "Dutch roll": 2.0}
    return FlownModel({t.name: t for t in terms}, "elevator", "aileron", "rudder", "throttle", modes)


def test_sizes_are_those_of_the_largest_effect_on_the_same_coefficient() -> None:
    rng = np.random.default_rng(0)
    alpha, q, p = (size * rng.standard_normal(1000) for size in (0.1, 0.01, 0.5))
    roll = (term("Clp", {"p"}, -0.4, p), term("Cl0", set(), 0.0, 0.0 * p))
    found = flown(term("Cmalpha", {"alpha"}, -2.0, alpha), term("Cmq", {"q"}, -0.1, q), *roll).sizes
    assert found["Cmalpha"] == pytest.approx(2.0), "it is the largest itself"
    assert found["Cmq"] == pytest.approx(2.0 * np.sqrt(np.mean(alpha**2) / np.mean(q**2)))
    assert found["Clp"] == pytest.approx(0.4)
    assert "Cl0" not in found, "nothing moved it"


def test_the_advice_follows_from_the_motion_flown() -> None:
    """What is asked for: terms as (name, variables, value, motion), partners, codes, values and a part of the sentence."""
    p, beta, alpha, V = (size * np.sin(T) for size in (0.1, 0.05, 0.02, 1e-3))
    rate = ("Cmq", {"q"}, -10.0, RATE)
    for name, given, partners, wanted, values, said in (
        ("Cmq", [("Cmq", {"q"}, -10.0, -0.3 * ELEVATOR), ("Cmelevator", {"elevator"}, -1.0, ELEVATOR)], (),
         ("advice-tied", "fly-short-period"), {"other": "elevator"}, "3-2-1-1 with elevator, unit step about 0.4 s, whose"),
        ("Clp", [("Clp", {"p"}, -0.5, p), ("Clr", {"r"}, 0.1, 0.3 * p)], (), ("advice-tied", "fly-separate-inputs"),
         {"other": "r"}, "move aileron and rudder at separate times"),
        ("CLV", [("CLV", {"V"}, 0.1, V), ("CLalpha", {"alpha"}, 5.0, beta)], (),
         ("advice-still-airspeed", "fly-power-steps"), {"amount": pytest.approx(0.00067, rel=0.02)}, "throttle steps"),
        ("CDalpha2", [("CDalpha2", {"alpha"}, 1.0, alpha**2), ("CDalpha", {"alpha"}, 0.3, alpha)], (),
         ("advice-still", "fly-range"), {}, "wider range of alpha"),
        ("Cnrudder", [("Cnrudder", {"rudder"}, -0.1, 0.5 * beta + 0.2), ("Cnalpha", {"alpha"}, 0.1, beta)], (),
         ("advice-tied", "fly-own-inputs"), {}, "add inputs of its own on rudder"),
        ("CQp", [("CQp", {"p"}, 0.1, 0.0 * T)], (), ("advice-still", "fly-roll"), {"amount": 0.0}, ""),
        ("CQ0", [("CQ0", set(), 0.01, np.ones(1000))], (), ("advice-constant",), {}, ""),
        ("CD0", [("CD0", set(), 0.03, np.ones(1000))], ("mass.inertia.yy",), ("advice-constant",), {}, ""),  # a force
        ("Cmq", [rate], ("mass.inertia.yy",), ("advice-ratio-to-inertia",), {}, ""),
        ("Cmq", [rate], ("mass.inertia.xx",), ("advice-several",), {}, ""),  # of another axis
        ("mass.inertia.yy", [rate], (), ("advice-inertia",), {}, ""),
        ("propulsion.CT0", [rate], (), ("advice-propulsion",), {"power": "throttle"}, ""),
        ("controls.elevator.lag", [rate], (), ("advice-controls",), {}, ""),
    ):  # fmt: skip
        first = advice(name, partners, flown(*(term(*one) for one in given)))[0]
        codes = (first.code, getattr(first.values.get("maneuver"), "code", ""))
        assert codes[: len(wanted)] == wanted, (name, partners)
        assert dict(first.values) | values == first.values, (name, partners)
        assert said in str(first), (name, partners)
