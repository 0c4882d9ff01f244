"""Agreement of maneuvers: by hand, by chance, and with the prior taken out."""

from __future__ import annotations

import math

import numpy as np
import pytest

from stoop.assessment.uncertainty import scatter, without_prior
from stoop.results.uncertainty import SingleEstimate


def singles(values: list[float], errors: list[float]) -> list[SingleEstimate]:
    return [SingleEstimate(v, e, counted=True) for v, e in zip(values, errors, strict=True)]


def test_by_hand() -> None:
    found = scatter(singles([1.0, 2.0], [1.0, 0.5]))
    assert found.mean == pytest.approx(9.0 / 5.0)
    assert found.std_error == pytest.approx(math.sqrt(1.0 / 5.0))
    assert found.chi_square == pytest.approx(0.8**2 + (0.2 / 0.5) ** 2)
    assert (found.degrees, found.verdict) == (1, "agree")
    assert found.p_value == pytest.approx(
        math.erfc(math.sqrt(0.8 / 2.0))
    )  # chi-square of one degree is a normal


def test_right_error_bars_are_doubted_as_often_as_promised() -> None:
    random = np.random.default_rng(0)
    errors = [0.5, 1.0, 2.0, 1.5]
    wild = [
        scatter(singles(list(random.normal(3.0, errors)), errors)).verdict == "scatter" for _ in range(1000)
    ]
    assert 0.03 < np.mean(wild) < 0.07


def test_an_outlier_is_seen() -> None:
    assert scatter(singles([1.0, 1.1, 0.9, 2.0], [0.1] * 4)).verdict == "scatter"


def test_what_is_not_counted_does_not_count() -> None:
    some = [*singles([1.0, 1.1], [0.1, 0.1]), SingleEstimate(9.0, 0.1, counted=False)]
    found = scatter(some)
    assert (found.mean, found.degrees, len(found.singles)) == (pytest.approx(1.05), 1, 3)
    alone = scatter(some[1:])
    assert (alone.mean, alone.degrees, alone.verdict) == (1.1, 0, "")
    nobody = scatter(some[2:])
    assert math.isnan(nobody.mean)
    assert nobody.verdict == ""


def test_taking_the_prior_out_gives_what_the_data_alone_say() -> None:
    data, error, mean, prior = 2.0, 0.4, 1.0, 0.6
    weight = error**-2 + prior**-2
    both, spread = (data / error**2 + mean / prior**2) / weight, weight**-0.5
    found = without_prior(both, spread, spread**2 / prior**2, mean, prior)
    assert (found.estimate, found.std_error) == (pytest.approx(data), pytest.approx(error))
    assert found.counted


def test_where_the_prior_knows_more_nothing_is_counted() -> None:
    assert not without_prior(1.0, 0.5, 0.8, 1.0, 0.55).counted
    assert without_prior(1.0, 0.5, 0.0, math.nan, math.nan) == SingleEstimate(1.0, 0.5, counted=True)
    assert not without_prior(1.0, math.inf, 0.0, math.nan, math.nan).counted
