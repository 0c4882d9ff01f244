"""Propagated figures: expressions, a quadrotor by hand, and figures that rest on priors."""

from __future__ import annotations

import math
from contextlib import suppress

import numpy as np
import pytest

from stoop.assessment.draws import Draws
from stoop.base.arrays import FloatArray
from stoop.base.atmosphere import SEA_LEVEL_DENSITY
from stoop.errors import SimulationError, StoopError
from stoop.propagation.expressions import parse_expressions
from stoop.propagation.propagation import Propagation, propagate_draws
from stoop.propagation.quantities import conditional_draws, figure
from stoop.propagation.wing_figures import Domain
from stoop.simulation import trim
from stoop.simulation.initial import parameter_rows
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle

DENSITY = 1.20165
DOMAIN = Domain((33.0, 37.0), 35.0, 200.0, DENSITY, (0.0, 0.2))


def test_a_linear_expression_has_the_error_of_the_delta_method(aircraft: Vehicle) -> None:
    names, covariance = ("CLalpha", "CD0"), np.array([[0.04, -0.001], [-0.001, 0.0001]])
    values = np.random.default_rng(0).multivariate_normal([4.78, 0.06], covariance, 20_000)
    one = parse_expressions({"sum": "2*CLalpha - 30*CD0 + mass.inertia.yy/60"}, aircraft)["sum"]
    drawn = parameter_rows(aircraft, dict(zip(names, values.T, strict=True)), len(values))
    rows = np.hstack([parameter_rows(aircraft), drawn])
    found = figure("Expressions", one.samples(rows), names, values)
    gradient = np.array([2.0, -30.0])
    std = float(np.sqrt(gradient @ covariance @ gradient))
    assert found.estimate == pytest.approx(2 * 4.78 - 30 * 0.06 + 2.0)
    assert found.std_error == pytest.approx(std, rel=0.02)
    assert found.ci95_upper - found.ci95_lower == pytest.approx(2 * 1.96 * std, rel=0.03)
    assert found.sources[0][0] in names


def test_a_value_that_does_not_exist_is_counted(aircraft: Vehicle) -> None:
    values = np.array([[0.0], [1.0]] * 20)
    found = propagate_draws(aircraft, Draws(("CDV",), values, "covariance"), DOMAIN, {"inverse": "1/CDV"})
    assert found["inverse"].failed == 0.5
    (told,) = (n for n in found.notices if n.code == "propagate-figure-failed")
    assert told.values == {"figures": "inverse", "share": 0.5}


def test_bad_expressions_are_refused_in_one_line(aircraft: Vehicle) -> None:
    for text, message in (
        ("CLalphaa/CD0", "no number 'CLalphaa'; did you mean CLalpha"),
        ("mass.inertia.x", "no number 'mass.inertia.x'; did you mean mass.inertia"),
        ("__import__('os')", "there is no function __import__"), ("CD0.real", "has no number 'CD0.real'"),
        ("CD0 +", "cannot read the term"), ("CD0**CL0", "not allowed"), ("[CD0]", "not allowed"),
    ):  # fmt: skip
        with pytest.raises(StoopError, match="expression x") as caught:
            parse_expressions({"x": text}, aircraft)
        assert message in str(caught.value), text
    found = parse_expressions({"x": "1e2*mass.mass + abs(Cmq)^2"}, aircraft)["x"]
    assert found.values(parameter_rows(aircraft)) == pytest.approx(100 * 189.40 + 47.6**2)


WEIGHT = 1.5 * 9.80665
HOVER = Domain((0.0, 6.0), 0.0, 0.0, SEA_LEVEL_DENSITY, speeds=(0.1, 3.0))


@pytest.fixture(scope="module")
def found() -> Propagation:
    rng = np.random.default_rng(0)
    draws = Draws(("mass.mass",), rng.normal(1.5, 0.03, (400, 1)), "covariance")
    return propagate_draws(resolve_vehicle("quad-x"), draws, HOVER)


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
    found = propagate_draws(resolve_vehicle("quad-x"), draws, HOVER)
    assert found["hover throttle"].failed == 0.5
    assert "propagate-no-hover" in [n.code for n in found.notices]
    heavy = resolve_vehicle("quad-x").with_numbers({"mass.mass": {"value": 9.0}})
    with pytest.raises(SimulationError, match="too heavy to hover"):
        propagate_draws(heavy, draws, HOVER)


def test_forward_flight_is_that_of_trim_and_speeds_faster_than_flown_are_marked(found: Propagation) -> None:
    theta = next(c for c in found.curves if c.name == "theta")
    alone = trim(resolve_vehicle("quad-x"), altitude=0.0, velocity=(6.0, 0.0, 0.0))
    assert theta.estimate[-1] == pytest.approx(alone.start["theta"], abs=1e-6)
    told = next(n for n in found.notices if n.code == "propagate-faster-than-flown")
    ((low, high),) = found.extrapolated
    assert dict(told.values) | {"low": low, "high": high, "flown": 3.0} == told.values
    assert (3.5 < low < 4.0, high) == (True, 6.0)


CRUISE = Domain((34.0, 36.0), 35.0, 200.0, DENSITY, (0.0, 0.2))
#: a rudder that never moves determines no sum's parts
UNKNOWN = ("CQ0", "Cl0", "Cn0", "CQrudder", "Clrudder", "Cnrudder")
KNOWN = ("CLalpha", "Cmelevator", "Cmalpha")
SINGLES = 60


@pytest.fixture(scope="module")
def whole() -> Vehicle:
    return resolve_vehicle("twin-boom")


def drawn(whole: Vehicle, count: int) -> Draws:
    """Return draws between the bounds of what is unknown, and normal ones of what is known to 0.3 %."""
    rng, bounds = np.random.default_rng(0), {p.name: (p.lower, p.upper) for p in whole.parameters}
    columns = [rng.uniform(*bounds[n], count) for n in UNKNOWN]
    columns += [whole.value(n) * (1.0 + 0.003 * rng.standard_normal(count)) for n in KNOWN]
    return Draws((*UNKNOWN, *KNOWN), np.stack(columns, axis=1), "covariance", UNKNOWN)


@pytest.fixture(scope="module")
def rudderless(whole: Vehicle) -> Propagation:
    expressions = {"even": "Cnrudder**2", "product": "Cn0*CLalpha", "known": "Cmalpha/CLalpha + 0.0001*Cn0"}
    return propagate_draws(whole, drawn(whole, 400), CRUISE, expressions)


def test_an_effect_without_a_slope_is_marked(rudderless: Propagation) -> None:
    """A linear regression finds nothing of a square about its middle; the variance of a product is its prior's."""
    assert rudderless["even"].prior_share == 1.0
    assert rudderless["product"].prior_share > 0.99
    assert rudderless["known"].prior_share < 0.1
    assert not rudderless["static margin"].rests_on_prior


def test_trims_about_an_unknown_rudder_are_marked_as_by_single_draws(
    whole: Vehicle, rudderless: Propagation
) -> None:
    """The naive twin: each draw is trimmed by itself, with and without the spread of what is unknown."""
    draws, figures = drawn(whole, 400), ("alpha", "phi", "elevator", "rudder")
    trims = np.flatnonzero(np.isfinite(rudderless.samples["alpha"]))[:SINGLES]

    def spread(values: FloatArray) -> FloatArray:
        rows = []
        for row in values[trims]:
            numbers = {n: {"value": float(v)} for n, v in zip(draws.names, row, strict=True)}
            with suppress(StoopError):
                point = trim(whole.with_numbers(numbers), 35.0, 200.0, 0.0, DENSITY)
                rows.append([{**point.start, **point.deflections}[n] for n in figures])
        return np.var(rows, axis=0)

    held = draws.values.copy()
    held[:, : len(UNKNOWN)] = [whole.value(n) for n in UNKNOWN]
    for name, single in zip(figures, 1.0 - spread(held) / spread(draws.values), strict=True):
        assert single > 0.97, name
        assert rudderless[name].prior_share == pytest.approx(single, abs=0.03)
        assert rudderless[name].rests_on_prior


def test_many_figures_are_one_caution(rudderless: Propagation) -> None:
    codes = [n.code for n in rudderless.notices]
    assert sum(one.failed > 0.03 for one in rudderless.figures) > 10
    assert codes.count("propagate-figure-failed") == 1
    (told,) = (n for n in rudderless.notices if n.code == "propagate-rests-on-priors")
    assert told.values["parameters"] == UNKNOWN
    assert {"alpha", "phi", "elevator", "rudder"} <= set(str(told.values["figures"]).split("; "))


def test_conditional_draws_of_a_normal_distribution() -> None:
    rng, covariance = np.random.default_rng(0), np.array([[1.0, 0.8, 0.0], [0.8, 2.0, 0.3], [0.0, 0.3, 1.0]])
    draws = rng.multivariate_normal([1.0, 2.0, 3.0], covariance, 20_000)
    given = conditional_draws(draws, np.array([True, False, False]), np.array([1.5, 0.0, 0.0]))
    assert (given[:, 0] == 1.5).all()
    assert given[:, 1:].mean(axis=0) == pytest.approx([2.0 + 0.8 * 0.5, 3.0], abs=0.04)
    assert np.cov(given[:, 1:].T) == pytest.approx(np.array([[2.0 - 0.64, 0.3], [0.3, 1.0]]), abs=0.05)
