"""A quadrotor by hand: hover, thrust over weight, control authority."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stoop.assessment.draws import Draws
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.errors import SimulationError
from stoop.propagation.propagation import Propagation, propagate_draws
from stoop.propagation.wing_figures import Domain
from stoop.simulation import trim
from stoop.vehicle.builtin import resolve_vehicle

WEIGHT = 1.5 * 9.80665
DENSITY = SEA_LEVEL_DENSITY
DOMAIN = Domain((0.0, 6.0), 0.0, 0.0, DENSITY, speeds=(0.1, 3.0))


@pytest.fixture(scope="module")
def found() -> Propagation:
    rng = np.random.default_rng(0)
    draws = Draws(("mass.mass",), rng.normal(1.5, 0.03, (400, 1)), "covariance")
    return propagate_draws(resolve_vehicle("quad-x"), draws, DOMAIN)


def test_speeds_faster_than_flown_are_marked(found: Propagation) -> None:
    told = next(n for n in found.notices if n.code == "propagate-faster-than-flown")
    ((low, high),) = found.extrapolated
    assert (told.values["low"], told.values["high"], told.values["flown"]) == (low, high, 3.0)
    assert 3.5 < low < 4.0
    assert high == 6.0


def throttle(weight: float) -> float:
    """Return the root of T1 x + T2 x^2 = weight / 4 of a rotor."""
    return (-2.5 + math.sqrt(2.5**2 + 4.0 * 6.0 * weight / 4.0)) / 12.0


def test_hover_by_hand(found: Propagation) -> None:
    """Roll: two rotors at full command, two as far below hover, an arm of 0.177 m."""
    one, ratio = found["hover throttle"], found["thrust over weight at full command"]
    assert one.estimate == pytest.approx(throttle(WEIGHT), rel=1e-4)
    slope = (throttle(1.01 * WEIGHT) - throttle(0.99 * WEIGHT)) / 0.03  # per kg
    assert one.std_error == pytest.approx(slope * 0.03, rel=0.12)
    assert one.sources[0] == ("mass.mass", pytest.approx(1.0, abs=0.01))
    assert ratio.estimate == pytest.approx(4.0 * 8.5 / WEIGHT, rel=1e-3)
    assert ratio.ci95_upper - ratio.estimate > ratio.estimate - ratio.ci95_lower, "one over the mass"
    x = throttle(WEIGHT)
    room = min(1.0 - x, x)
    thrust = [2.5 * y + 6.0 * y * y for y in (x + room, x - room)]
    expected = 2.0 * 0.177 * (thrust[0] - thrust[1]) / 0.0291
    assert found["roll acceleration from hover"].estimate == pytest.approx(expected, rel=1e-3)


def test_what_does_not_hover_is_counted_or_an_error() -> None:
    values = np.concatenate([np.full((50, 1), 1.5), np.full((50, 1), 9.0)])
    draws = Draws(("mass.mass",), values, "covariance")
    found = propagate_draws(resolve_vehicle("quad-x"), draws, DOMAIN)
    assert found["hover throttle"].failed == 0.5
    assert "propagate-no-hover" in [n.code for n in found.notices]
    heavy = resolve_vehicle("quad-x").with_numbers({"mass.mass": {"value": 9.0}})
    with pytest.raises(SimulationError, match="too heavy to hover"):
        propagate_draws(heavy, draws, DOMAIN)


def test_forward_flight_is_that_of_trim(found: Propagation) -> None:
    theta = next(c for c in found.curves if c.name == "theta")
    alone = trim(resolve_vehicle("quad-x"), altitude=0.0, velocity=(6.0, 0.0, 0.0))
    assert theta.estimate[-1] == pytest.approx(alone.start["theta"], abs=1e-6)
