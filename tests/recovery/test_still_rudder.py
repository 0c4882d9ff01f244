"""A fit of flights in which the rudder never moves: figures are marked as an independent Monte Carlo marks them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
import pytest
from naive.aircraft import Aircraft, rotation
from scipy.optimize import root

import stoop
from stoop.assessment.draws import draws_of
from stoop.vehicle.builtin import builtin_text
from stoop_studies.verify import scenes

DRAWS = 300
FIGURES = ("alpha", "phi", "elevator", "aileron", "rudder")
MARKED = 0.5  #: share of the variance from which a figure rests on priors


def steady(numbers: Mapping[str, float], airspeed: float, altitude: float, density: float) -> list[float]:
    """Return `FIGURES` of straight level flight without sideslip, from the formulas; NaN where there is none near zero."""

    def unbalanced(z: np.ndarray) -> np.ndarray:
        alpha, phi, elevator, aileron, rudder, thrust = z
        theta = math.atan(math.cos(phi) * math.tan(alpha))
        aircraft = Aircraft(text, {**numbers, "propulsion.thrust": 100.0 * thrust}, {})
        velocity = airspeed * np.array([math.cos(alpha), 0.0, math.sin(alpha)])
        x = np.concatenate([velocity, np.zeros(3), rotation(phi, theta, 0.0).ravel(), [altitude]])
        u = {"elevator": elevator, "aileron": aileron, "rudder": rudder, "density": density}
        _, rate, turning = aircraft.accelerations(x, u)
        return np.concatenate([rate, turning])

    text = builtin_text("twin-boom")
    found = root(unbalanced, np.array([0.1, 0.0, 0.0, 0.0, 0.0, 2.0]), tol=1e-12)
    near = found.success and np.abs(found.x[:5]).max() < math.pi / 2.0
    return found.x[:5].tolist() if near else [math.nan] * 5


@pytest.fixture(scope="module")
def model() -> stoop.FittedModel:
    scene = scenes.in_white_noise(3, still="rudder")
    return stoop.fit(
        scene.start, list(scene.flights.values()), scene.windows, method="output-error", strategy="textbook"
    )


def test_marks_are_those_of_an_independent_monte_carlo(model: stoop.FittedModel) -> None:
    found = stoop.propagate(model, draws=DRAWS, seed=1)
    where = found.domain
    draws, covariance = draws_of(model.result, None, DRAWS, seed=2), model.result.covariance.matrix
    names = list(draws.names)
    held = np.isin(names, draws.undetermined)
    assert {"CQrudder", "Clrudder", "Cnrudder"} <= set(draws.undetermined)
    # What is undetermined is held at its estimate; the rest has its distribution given that.
    estimates = np.array([model.vehicle.value(n) for n in names])
    given = np.where(held, estimates, draws.values)
    joint = held & np.isfinite(np.diag(covariance))
    if joint.any():
        gain = np.linalg.solve(covariance[np.ix_(joint, joint)], covariance[np.ix_(joint, ~held)])
        given[:, ~held] += (estimates[joint] - draws.values[:, joint]) @ gain
    fixed = {p.name: p.value for p in model.vehicle.parameters}

    def figures(values: np.ndarray) -> np.ndarray:
        return np.array(
            [
                steady(
                    fixed | dict(zip(names, row, strict=True)), where.reference, where.altitude, where.density
                )
                for row in values
            ]
        )

    every, left = figures(draws.values), figures(given)
    both = np.isfinite(every[:, 0]) & np.isfinite(left[:, 0])
    assert both.sum() > 0.5 * DRAWS
    shares = dict(zip(FIGURES, 1.0 - np.var(left[both], axis=0) / np.var(every[both], axis=0), strict=True))
    for name, share in shares.items():
        assert found[name].rests_on_prior == (share >= MARKED), (name, share, found[name].prior_share)
    assert all(found[name].rests_on_prior for name in ("phi", "rudder"))
