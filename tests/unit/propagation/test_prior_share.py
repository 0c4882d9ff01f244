"""Figures that rest on priors: closed forms, and trims of single draws about a rudder of which nothing is known."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.assessment.draws import Draws
from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.propagation.propagation import Propagation, propagate_draws
from stoop.propagation.quantities import conditional_draws
from stoop.propagation.wing_figures import Domain
from stoop.simulation import trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle

DENSITY = 1.20165
DOMAIN = Domain((34.0, 36.0), 35.0, 200.0, DENSITY, (0.0, 0.2))
UNKNOWN = (
    "CQ0",
    "Cl0",
    "Cn0",
    "CQrudder",
    "Clrudder",
    "Cnrudder",
)  #: a rudder that never moves determines no sum's parts
KNOWN = ("CLalpha", "Cmelevator", "Cmalpha")
SINGLES = 60


@pytest.fixture(scope="module")
def vehicle() -> Vehicle:
    return resolve_vehicle("twin-boom")


def drawn(vehicle: Vehicle, count: int) -> Draws:
    """Return draws between the bounds of what is unknown, and normal ones of what is known to 0.3 %."""
    rng, bounds = np.random.default_rng(0), {p.name: (p.lower, p.upper) for p in vehicle.parameters}
    columns = [rng.uniform(*bounds[n], count) for n in UNKNOWN]
    columns += [vehicle.value(n) * (1.0 + 0.003 * rng.standard_normal(count)) for n in KNOWN]
    return Draws((*UNKNOWN, *KNOWN), np.stack(columns, axis=1), "covariance", UNKNOWN)


@pytest.fixture(scope="module")
def found(vehicle: Vehicle) -> Propagation:
    expressions = {"even": "Cnrudder**2", "product": "Cn0*CLalpha", "known": "Cmalpha/CLalpha + 0.0001*Cn0"}
    return propagate_draws(vehicle, drawn(vehicle, 400), DOMAIN, expressions)


def test_an_effect_without_a_slope_is_marked(found: Propagation) -> None:
    """A linear regression finds nothing of a square about its middle; the variance of a product is its prior's."""
    assert found["even"].prior_share == 1.0
    assert found["product"].prior_share > 0.99
    assert found["known"].prior_share < 0.1
    assert not found["static margin"].rests_on_prior


def test_trims_about_an_unknown_rudder_are_marked_as_by_single_draws(
    vehicle: Vehicle, found: Propagation
) -> None:
    """The naive twin: each draw is trimmed by itself, with and without the spread of what is unknown."""
    draws = drawn(vehicle, 400)
    trims = np.flatnonzero(np.isfinite(found.samples["alpha"]))[:SINGLES]

    def singles(values: FloatArray) -> FloatArray:
        rows = []
        for row in values[trims]:
            numbers = {n: {"value": float(v)} for n, v in zip(draws.names, row, strict=True)}
            try:
                point = trim(vehicle.with_numbers(numbers), 35.0, 200.0, 0.0, DENSITY)
            except StoopError:
                rows.append([np.nan] * 4)
                continue
            rows.append(
                [
                    point.start["alpha"],
                    point.start["phi"],
                    *(point.deflections[c] for c in ("elevator", "rudder")),
                ]
            )
        return np.array(rows)

    held = draws.values.copy()
    held[:, : len(UNKNOWN)] = [vehicle.value(n) for n in UNKNOWN]
    shares = 1.0 - np.nanvar(singles(held), axis=0) / np.nanvar(singles(draws.values), axis=0)
    for name, single in zip(("alpha", "phi", "elevator", "rudder"), shares, strict=True):
        assert single > 0.97, name
        assert found[name].prior_share == pytest.approx(single, abs=0.03)
        assert found[name].rests_on_prior


def test_many_figures_are_one_caution(found: Propagation) -> None:
    codes = [n.code for n in found.notices]
    assert sum(one.failed > 0.03 for one in found.figures) > 10
    assert codes.count("propagate-figure-failed") == 1
    (told,) = (n for n in found.notices if n.code == "propagate-rests-on-priors")
    assert told.values["parameters"] == UNKNOWN
    assert {"alpha", "phi", "elevator", "rudder"} <= set(str(told.values["figures"]).split("; "))


def test_conditional_draws_of_a_normal_distribution() -> None:
    rng, covariance = np.random.default_rng(0), np.array([[1.0, 0.8, 0.0], [0.8, 2.0, 0.3], [0.0, 0.3, 1.0]])
    draws = rng.multivariate_normal([1.0, 2.0, 3.0], covariance, 20_000)
    given = conditional_draws(draws, np.array([True, False, False]), np.array([1.5, 0.0, 0.0]))
    assert (given[:, 0] == 1.5).all()
    assert given[:, 1:].mean(axis=0) == pytest.approx([2.0 + 0.8 * 0.5, 3.0], abs=0.04)
    assert np.cov(given[:, 1:].T) == pytest.approx(np.array([[2.0 - 0.64, 0.3], [0.3, 1.0]]), abs=0.05)
