"""Outliers and maneuvers of unequal noise, against direct maximization, scipy, and fits whose truth is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.signal import lfilter
from scipy.stats import bartlett, norm

from stoop.base.arrays import FloatArray
from stoop.estimate import noise_model as model
from stoop.estimate.fit import Options, fit
from stoop.estimate.noise import correlation_times
from stoop.flight import Flight
from stoop.problem import Weights
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle

DT = 0.02


def contaminated(seed: int, share: float, width: float) -> FloatArray:
    rng = np.random.default_rng(seed)
    return rng.standard_normal(3000) * np.where(rng.random(3000) < share, width, 1.0)


def negative_log_likelihood(x: FloatArray, r: FloatArray) -> float:
    sigma, share, wide = np.exp(x[0]), 1.0 / (1.0 + np.exp(-x[1])), np.exp(x[2])
    return -float(np.sum(np.log((1 - share) * norm.pdf(r, 0, sigma) + share * norm.pdf(r, 0, wide))))


@pytest.mark.parametrize(("share", "width"), [(0.02, 10.0), (0.003, 80.0), (0.2, 4.0)])
def test_em_finds_what_direct_maximization_finds(share: float, width: float) -> None:
    r = 0.3 * contaminated(0, share, width)
    found = model.fit_mixture(r)
    start = [np.log(0.3), np.log(share / (1 - share)), np.log(0.3 * width)]
    fine = {"xatol": 1e-8, "fatol": 1e-8}
    best = minimize(negative_log_likelihood, start, (r,), "Nelder-Mead", options=fine)
    assert -float(np.sum(found.log_density(r))) == pytest.approx(best.fun, abs=0.05)
    assert found.sigma == pytest.approx(np.exp(best.x[0]), rel=5e-3)
    assert found.width * found.sigma == pytest.approx(np.exp(best.x[2]), rel=0.02)


def test_weights_and_slopes_are_derivatives_of_the_likelihood() -> None:
    mixture, r, h = model.Mixture(0.5, 0.1, 6.0), np.linspace(-5.0, 5.0, 101), 1e-5
    score = -0.25 * (mixture.log_density(r + h) - mixture.log_density(r - h)) / (2 * h)
    w, slopes = mixture.weights(r)
    np.testing.assert_allclose(w * r, score, atol=1e-8)
    ahead, behind = (mixture.weights(r + d)[0] * (r + d) for d in (h, -h))
    np.testing.assert_allclose(slopes, (ahead - behind) / (2 * h), atol=1e-6)
    assert np.isnan(mixture.weights(np.array([np.nan]))[0])


def test_outliers_are_found_and_nothing_else_is_called_so() -> None:
    for share, width in ((0.02, 10.0), (0.003, 80.0)):
        for seed in range(20):
            r = contaminated(seed, share, width)[:, None]
            found = model.outlier_model([r[:1000], r[1000:]], DT, 1.0)
            assert found is not None
            assert found[0].share == pytest.approx(share, rel=0.8)
            assert found[0].width == pytest.approx(width, rel=0.6)
    for seed in range(200):
        assert model.outlier_model([np.random.default_rng(seed).standard_normal((3000, 1))], DT, 1.0) is None
    # bursts, four times as large for half a second of every five: as likely a wrong model in the maneuvers
    rng = np.random.default_rng(2)
    smooth = np.convolve(rng.standard_normal(3100), np.ones(100) / 10.0, "valid")[:3000]
    burst = np.where(np.arange(3000) % 250 < 25, 4.0, 1.0)
    assert model.outlier_model([(smooth * burst)[:, None]], DT, 60.0) is None


def test_shrinkage_keeps_what_is_known_and_draws_what_is_not() -> None:
    draw = np.random.default_rng(3)
    groups = [s * draw.standard_normal(n) for s, n in ((1.0, 40), (1.3, 60), (0.9, 25))]
    degrees = np.array([len(g) - 1.0 for g in groups])
    p = model.homogeneous(np.array([np.var(g, ddof=1) for g in groups]), degrees)
    assert p == pytest.approx(bartlett(*groups).pvalue, rel=1e-9)
    variances = np.array([1.0, 1.1, 16.0, 30.0])
    found = model.shrunk(variances, np.array([700.0, 700.0, 700.0, 10.0]))
    np.testing.assert_allclose(found[:3], variances[:3], rtol=0.02)
    assert 10.0 < found[3] < 30.0
    alike = model.shrunk(np.random.default_rng(4).chisquare(20.0, 50) / 20.0, np.full(50, 20.0))
    assert np.std(alike) < 0.1
    np.testing.assert_allclose(np.mean(alike), 1.0, atol=0.1)


def test_a_noisy_maneuver_is_found_and_equal_ones_are_left() -> None:
    rng = np.random.default_rng(5)
    plain, labels = model.NoiseModel.plain(2, 4), np.arange(4)
    pieces = [rng.standard_normal((700, 2)) for _ in labels]
    relative, unequal, _ = model.maneuver_noise(pieces, labels, DT, plain)
    assert unequal == (False, False)
    np.testing.assert_array_equal(relative, 1.0)
    pieces[3][:, 1] *= 4.0
    pieces[2] = pieces[2][:3]
    relative, unequal, unknown = model.maneuver_noise(pieces, labels, DT, plain)
    assert unequal == (False, True)
    assert relative[3, 1] / relative[0, 1] == pytest.approx(4.0, rel=0.15)
    assert np.argwhere(unknown).tolist() == [[2, 1]]
    assert relative[2, 1] == 1.0


def test_of_neighboring_innovations_the_first_is_the_outlier() -> None:
    v = np.random.default_rng(6).standard_normal((800, 3))
    v[100, 0], v[101:105, 1] = 60.0, 15.0
    v[400, 2] = -50.0
    (mask,) = model.outlying_innovations([v], DT)
    assert (mask[100, 0], mask[400, 2], mask[101:105].any()) == (True, True, False)
    assert mask.sum() < 5


def test_weights_of_a_noisier_piece_are_those_of_its_covariance() -> None:
    root = np.random.default_rng(7).standard_normal((3, 3))
    covariance, factors = root @ root.T + np.eye(3), np.array([1.0, 4.0, 0.5])
    scaled = Weights.of(covariance).scaled(factors)
    assert scaled.covariance == pytest.approx(covariance * np.outer(factors, factors))
    assert scaled.root.T @ scaled.root == pytest.approx(np.linalg.inv(scaled.covariance))


def test_outliers_hardly_move_a_fit(aircraft: Vehicle, wrong: Vehicle, flight: Flight) -> None:
    windows, rng = [Window("sim", 0.0, 30.0)], np.random.default_rng(8)
    clean = fit(wrong, {"sim": flight}, windows, Options())
    assert not any(n.code in ("outliers", "maneuver-noise") for n in clean.notices)
    readings = {}
    for channel in aircraft.outputs:
        x, sigma = flight.data[channel].to_numpy().copy(), getattr(aircraft.file.sensors, channel).sigma
        at = rng.random(x.size) < 0.01
        x[at] += 40.0 * sigma * rng.choice([-1.0, 1.0], int(at.sum()))
        readings[channel] = (flight.data[channel].dims, x)
    found = fit(wrong, {"sim": replace(flight, data=flight.data.assign(readings))}, windows, Options())
    (said,) = [n for n in found.notices if n.code == "outliers"]
    assert set(said.values["channels"]) == set(aircraft.outputs)  # type: ignore[arg-type]
    rows = clean.evidence.pieces[0].rows()[1]
    std = np.sqrt(np.diag(np.linalg.inv(rows.T @ rows)))
    for name, error in zip(clean.estimates, std, strict=False):
        assert found.estimates[name] == pytest.approx(clean.estimates[name], abs=1.5 * error)
    recorded, shown = np.column_stack([x for _, x in readings.values()]), found.prepared.pieces[0].measured
    np.testing.assert_array_equal(shown[:100], recorded[:100])


def test_correlation_times() -> None:
    """Of white noise 1, holes or not; of an autoregression 1 + 2 sum a^k = (1 + a) / (1 - a)."""
    white = np.random.default_rng(0).standard_normal((4000, 3))
    white[::7, 2] = np.nan
    assert correlation_times([white[:2000], white[2000:]], 0.01) == pytest.approx(1.0, abs=0.15)
    for a in (0.5, 0.9):
        x = lfilter([1.0], [1.0, -a], np.random.default_rng(1).standard_normal((60_000, 1)), axis=0)
        assert correlation_times([x], 0.01)[0] == pytest.approx((1 + a) / (1 - a), rel=0.2)
