"""Output error in gusts: which parameters are biased, and by how much, against the truth."""

from __future__ import annotations

import numpy as np

from stoop.base.units import KNOT
from stoop.estimate.fit import Options
from stoop.estimate.gust_bias import MIN_BIAS, gust_biases
from stoop.strategy.run import FIT_ALONE, choose_method
from stoop.strategy.run import fit as fit_by
from stoop_studies.verify import closed_loop


def test_large_biases_are_told_with_sign_and_size() -> None:
    """All errors beyond four standard errors of filter error: told with their sign, and within a factor of two."""
    scene = closed_loop.aircraft_scene(30.0 * KNOT, 2)
    choice = choose_method("output-error", scene.start, scene.flights.values(), scene.windows)
    assert [n.code for n in choice.notices] == ["gusts-ignored"]
    options = Options(method="output-error")
    fit = fit_by(FIT_ALONE, scene.start, scene.flights, scene.windows, options=options).estimate
    (told,) = [n for n in fit.notices if n.code == "gusts-bias"]
    found = gust_biases(fit, scene.flights)
    assert told.values["count"] == sum(abs(size) > MIN_BIAS for _, size in found.values())
    errors = {n: fit.estimates[n] - v for n, v in scene.truth.items()}
    error_bar = {n: bias / size for n, (bias, size) in found.items()}
    large = [n for n in errors if abs(errors[n]) > 4.0 * error_bar[n]]
    ratio = np.array([found[n][0] / errors[n] for n in large])
    assert len(large) > 3
    assert ratio.min() > 0.5
    assert ratio.max() < 2.0
