"""The mixed model of a fleet: published meta-analysis, analysis of variance, and simulated fleets."""

import numpy as np
import pytest
from scipy.stats import norm

from stoop_fleet.mixed_model import Design, fit_mixed_model, fit_robust_model

#: vaccinated with and without tuberculosis, controls with and without: thirteen trials of the BCG vaccine, G. A. Colditz et
#: al., "Efficacy of BCG vaccine in the prevention of tuberculosis", JAMA 271 (1994) 698
BCG = ((4, 119, 11, 128), (6, 300, 29, 274), (3, 228, 11, 209), (62, 13536, 248, 12619), (33, 5036, 47, 5761),
       (180, 1361, 372, 1079), (8, 2537, 10, 619), (505, 87886, 499, 87892), (29, 7470, 45, 7232), (17, 1699, 65, 1600),
       (186, 50448, 141, 27197), (5, 2493, 3, 2338), (27, 16886, 29, 17825))  # fmt: skip


def test_known_errors_as_published() -> None:
    """W. Viechtbauer, "Conducting meta-analyses in R with the metafor package", J. Stat. Softw. 36 (2010) 3, section 4."""
    a, b, c, d = np.array(BCG, dtype=float).T
    values = np.log(a / (a + b)) - np.log(c / (c + d))
    errors = np.sqrt(1 / a - 1 / (a + b) + 1 / c - 1 / (c + d))
    model = fit_mixed_model(Design(values, errors, np.ones((13, 1)), {}))
    assert model.flight**2 == pytest.approx(0.3132, abs=5e-5)
    assert (model.coefficients[0], model.errors[0]) == pytest.approx((-0.7145, 0.1798), abs=5e-5)
    # metafor adds log|X'X| / 2
    assert model.log_likelihood + 0.5 * np.log(13) == pytest.approx(-12.2024, abs=5e-5)


def test_a_balanced_fleet_as_by_analysis_of_variance() -> None:
    rng = np.random.default_rng(1)
    vehicles, flights, error = 12, 9, 0.3
    y = rng.normal(0.0, 1.0, (vehicles, 1)) + rng.normal(0.0, 0.5, (vehicles, flights))
    within, between = np.mean(np.var(y, axis=1, ddof=1)), flights * np.var(y.mean(axis=1), ddof=1)
    of = np.repeat(np.arange(vehicles), flights)
    model = fit_mixed_model(Design(y.ravel(), np.full(y.size, error), np.ones((y.size, 1)), {"vehicle": of}))
    assert model.flight**2 + error**2 == pytest.approx(within, rel=1e-4)
    assert model.deviations["vehicle"] ** 2 == pytest.approx((between - within) / flights, rel=1e-4)
    expected = (1.0 - within / between) * (y.mean(axis=1) - y.mean())
    assert model.levels["vehicle"] == pytest.approx(expected, abs=1e-3)


def test_parts_that_move_are_told_from_vehicles() -> None:
    """Crossed groups against a dense twin of the likelihood, and the truth within its errors."""
    rng, n, vehicles, parts = np.random.default_rng(2), 900, 15, 40
    vehicle, part = rng.integers(0, vehicles, n), rng.integers(-1, parts, n)
    season, errors = rng.standard_normal(n), rng.uniform(0.2, 0.6, n)
    u, v = 0.8 * rng.standard_normal(vehicles), 0.5 * rng.standard_normal(parts)
    y = 3.0 - 0.7 * season + u[vehicle] + np.where(part < 0, 0.0, v[part])
    y += np.hypot(0.3, errors) * rng.standard_normal(n)
    X = np.column_stack([np.ones(n), season])
    model = fit_mixed_model(Design(y, errors, X, {"vehicle": vehicle, "part": part}))
    assert np.abs(model.coefficients - [3.0, -0.7])[1] < 4.0 * model.errors[1]
    assert model.deviations["vehicle"] == pytest.approx(0.8, rel=0.5)
    assert model.deviations["part"] == pytest.approx(0.5, rel=0.4)
    assert model.flight == pytest.approx(0.3, rel=0.2)
    assert np.corrcoef(model.levels["part"], v)[0, 1] > 0.9
    V = np.diag(model.flight**2 + errors**2)
    for levels, name in ((vehicle, "vehicle"), (part, "part")):
        Z = (levels[:, None] == np.arange(levels.max() + 1)).astype(float)
        V += model.deviations[name] ** 2 * Z @ Z.T
    information = X.T @ (inverse := np.linalg.inv(V)) @ X
    beta = np.linalg.solve(information, X.T @ inverse @ y)
    left = y - X @ beta
    logs = [np.linalg.slogdet(m)[1] for m in (V, information)]
    twin = -0.5 * (sum(logs) + left @ inverse @ left + (n - 2) * np.log(2.0 * np.pi))
    assert model.coefficients == pytest.approx(beta, abs=1e-9)
    assert model.errors == pytest.approx(np.sqrt(np.diag(np.linalg.inv(information))), rel=1e-9)
    assert model.log_likelihood == pytest.approx(twin, abs=1e-6)


def test_a_fleet_without_spread_has_none() -> None:
    rng = np.random.default_rng(3)
    of, errors = np.repeat(np.arange(10), 20), np.full(200, 0.5)
    y = errors * rng.standard_normal(200)
    y -= np.repeat(y.reshape(10, 20).mean(axis=1), 20)
    model = fit_mixed_model(Design(y, errors, np.ones((200, 1)), {"vehicle": of}))
    assert model.deviations["vehicle"] == pytest.approx(0.0, abs=1e-3)
    assert np.isfinite(model.covariance).all()


def test_the_likelihood_is_the_highest_wherever_the_mean_is() -> None:
    """Spreads of one in ten thousand of the mean; sums of squares about zero would cancel."""
    rng = np.random.default_rng(7)
    vehicle, part = np.repeat(np.arange(20), 40), np.repeat(np.arange(40), 20)
    u, v, e = (rng.standard_normal(n) for n in (20, 40, 800))
    y = u[vehicle] + 0.3 * v[part] + 0.5 * e
    groups, errors, X = {"vehicle": vehicle, "part": part}, np.full(800, 0.2), np.ones((800, 1))
    about_zero, far = (fit_mixed_model(Design(mean + y, errors, X, groups), True) for mean in (0.0, 1e4))
    assert far.flight == pytest.approx(about_zero.flight, rel=1e-5)
    assert far.deviations == pytest.approx(about_zero.deviations, rel=1e-5)
    assert far.coefficients[0] - 1e4 == pytest.approx(about_zero.coefficients[0], abs=1e-6)


def test_a_level_is_outlying_beyond_the_largest_of_all_by_chance() -> None:
    """Of 40 levels the largest lies within 3.7 standard deviations in 99 % (Bonferroni), a single one within 2.6."""
    levels, of = norm.ppf((np.arange(40) + 0.5) / 40.0), np.repeat(np.arange(40), 6)
    flights = 0.05 * np.random.default_rng(1).standard_normal(240)
    for farthest, outlying in ((3.1, []), (5.5, [39])):
        y = np.append(levels[:-1], farthest)[of] + flights
        design = Design(y, np.full(240, 0.05), np.ones((240, 1)), {"vehicle": of})
        assert [one.level for one in fit_robust_model(design)[1]] == outlying, farthest
