"""A rotor that lost a known share of its thrust, flown by an autopilot in wind, is found with that share."""

from __future__ import annotations

from importlib.resources import files

import pytest
from recovery.maneuvers import maneuver

from stoop.flight import Flight
from stoop.performance.effectiveness import Balance, Reference, assess, hover, judge
from stoop.simulation.fly import simulate_flight
from stoop.vehicle import Vehicle, parse_vehicle

TEXT = (files("stoop.data") / "quad_x.toml").read_text(encoding="utf-8")
INPUTS = (("roll", "3-2-1-1", 4.0, 0.15, 10.0), ("north", "doublet", 10.0, 3.0, 2.0))
MANEUVER = maneuver(25.0, *INPUTS, altitude=100.0, wind=[2.0, -1.0, 0.0])


def with_factor(factor: float) -> Vehicle:
    """The template with one more number, whose value does not change the equations: one kernel for all."""
    head, _, tail = TEXT.partition("[rotor.m3]")
    return parse_vehicle(f"{head}[rotor.m3]\nfactor = {factor}{tail}", "quad.toml")


def flown(factor: float, seed: int) -> Flight:
    return simulate_flight(with_factor(factor), MANEUVER, seed=seed, name=f"{factor}")


@pytest.mark.parametrize("factor", [0.9, 0.7])
def test_a_known_loss_comes_back(factor: float) -> None:
    balance = Balance(with_factor(1.0))
    reference = Reference(balance, tuple(hover(flown(1.0, seed), balance) for seed in (1, 2, 3)))
    found = assess(hover(flown(factor, 4), balance), reference)
    verdict = judge(found)
    assert verdict.kind == "weak or mass"
    assert verdict.rotors == ("m3",)
    assert abs(1.0 - found.suspected.size - factor) < found.suspected.std
    assert judge(assess(hover(flown(1.0, 5), balance), reference)).kind == "healthy"
