"""Figures of a channel, its noise floor and whiteness against their definitions; the trivial lag beside it, and PRESS."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive.whiteness import naive_ljung_box
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp
from scipy.signal import lfilter
from scipy.stats import chi2

from stoop.assessment import baseline
from stoop.assessment import goodness_of_fit as fit
from stoop.assessment.baseline import Lag, LagRecord, fit_lags
from stoop.assessment.goodness_of_fit import Match, channel_figures, noise_floor, r2, rmse, theil, whiteness


def pair(size: int = 400) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(size) / 100.0
    return np.sin(3 * t), 0.8 * np.sin(3 * t - 0.2) + 0.1


def test_against_the_definition_by_hand() -> None:
    # rms(z - y) = sqrt(1/2), rms(z) = sqrt(5/2), rms(y) = sqrt(10/2)
    z, y = np.array([1.0, 2.0]), np.array([1.0, 3.0])
    assert theil(z, y) == pytest.approx(1.0 / (np.sqrt(5.0) + np.sqrt(10.0)))
    assert (rmse(z, y), r2(z, y)) == pytest.approx((np.sqrt(0.5), 1.0 - 1.0 / 0.5))
    figures = channel_figures(z, Match(y), 1.0)
    assert figures.fit_percent == pytest.approx(100.0 * (1.0 - math.sqrt(1.0 / 0.5)))
    assert math.isnan(channel_figures(np.ones(9), Match(np.zeros(9)), 1.0).fit_percent)
    assert (theil(z, z), theil(z, -z), theil(0.0 * z, 0.0 * z)) == (0.0, pytest.approx(1.0), 0.0)


def test_shares_add_up_and_name_the_fault() -> None:
    z, y = pair()
    parts = fit.theil_shares(z, y)
    assert_allclose(parts.bias + parts.variance + parts.covariance, 1.0)
    assert fit.theil_shares(z, z + 1.0).bias == pytest.approx(1.0)
    assert fit.theil_shares(z - z.mean(), 2.0 * (z - z.mean())).variance == pytest.approx(1.0)
    wave = 2 * np.pi * np.arange(100) / 100  # a whole period: a shift in phase changes nothing but the phase
    assert fit.theil_shares(np.sin(wave), np.cos(wave)).covariance == pytest.approx(1.0)
    assert np.isnan(fit.theil_shares(z, z).bias)


def test_what_is_missing_does_not_count() -> None:
    (z, y), nothing = pair(), np.full(5, np.nan)
    holes = np.where((np.arange(z.size) >= 50) & (np.arange(z.size) < 60), np.nan, z)
    there = np.isfinite(holes)
    for figure in (theil, rmse, r2):
        assert figure(holes, y) == figure(z[there], y[there])
        assert np.isnan(figure(nothing, np.zeros(5)))
    assert np.isnan(fit.theil_shares(nothing, nothing).bias)
    assert np.isnan(r2(np.zeros(4), np.zeros(4)))


def test_vibration_does_not_count() -> None:
    z, y = pair()
    shaken = z + np.sin(2 * np.pi * 35 * np.arange(z.size) / 100.0)
    assert theil(shaken, y, 100.0) == pytest.approx(theil(z, y), abs=0.01)
    assert theil(shaken, y) > 2 * theil(z, y)


def test_a_diverged_simulation_is_worst_not_an_overflow() -> None:
    """One that ends early is judged by what it did not reach: its beginning alone would match with white residuals."""
    z, y = pair()
    far = np.where(np.arange(z.size) > 200, 1e300, y)
    assert theil(z, far) == pytest.approx(1.0)
    assert rmse(z, far) > 1e299
    assert r2(z, far) == -np.inf
    early = np.where(np.arange(z.size) > 0.6 * z.size, np.nan, z)
    figures = channel_figures(z, Match(early), 100.0, baseline=Match(y), deviation=np.full(z.size, 1.0))
    assert figures.rmse > 1e90
    assert figures.theil == pytest.approx(1.0)
    assert figures.r2 < -1e90
    assert (figures.whiteness.verdict, figures.lost) == ("colored", True)
    assert figures.inside == pytest.approx(0.6, abs=0.02)


def test_everything_stands_beside_the_baseline() -> None:
    z, y = pair()
    figures = channel_figures(z, Match(y, 2.0 * (z - y)), 100.0, baseline=Match(0.5 * y, z))
    trivial = figures.baseline
    assert figures.theil_shares == fit.theil_shares(z, y)
    assert figures.press == pytest.approx(2.0 * figures.rmse)
    assert figures.whiteness.verdict == trivial.whiteness.verdict == "colored"
    assert (trivial.rmse, trivial.r2) == (rmse(z, 0.5 * y), r2(z, 0.5 * y))
    assert trivial.press == pytest.approx(np.sqrt(np.mean(z**2)))
    assert np.isnan(channel_figures(z, Match(y), 100.0).press)


RATE = 200.0
TIME = np.arange(4000) / RATE
MOTION, SIGMA = np.sin(2.0 * np.pi * 0.7 * TIME), 0.3


def noise(seed: int) -> np.ndarray:
    return SIGMA * np.random.default_rng(seed).standard_normal(len(TIME))


def test_white_noise_and_motion_are_told_apart() -> None:
    found, ratio = noise_floor(5.0 + MOTION + noise(1), RATE, math.inf)
    assert found == pytest.approx(SIGMA * math.sqrt(20.0 / RATE), rel=0.05)  # what lies below 10 Hz of 100 Hz
    assert ratio == pytest.approx(math.sqrt(0.5) / found, rel=0.05)
    assert noise_floor(noise(2), RATE, math.inf)[1] < 0.5


def test_a_perfect_model_of_a_calm_channel_is_below_its_noise_and_loses_to_no_lag() -> None:
    """Theil's coefficient of the truth itself: 0.7 to 1 where hardly anything moves."""
    calm = 0.02 * MOTION
    found = channel_figures(calm + noise(3), Match(calm), RATE, Match(calm + 1e-3 * TIME), SIGMA)
    assert found.theil > 0.6
    assert (found.below_noise, found.compared, found.lost) == (True, False, False)
    lively = channel_figures(50.0 * calm + noise(3), Match(50.0 * calm), RATE, Match(0.0 * calm), SIGMA)
    assert (lively.below_noise, lively.better) == (False, True)
    assert lively.theil < 0.1


def test_a_model_that_explains_nothing_does_not_hide_behind_its_own_residuals() -> None:
    """The fit would take all motion for noise; the record's own noise does not."""
    measured = MOTION + 0.05 * noise(4)
    found = channel_figures(measured, Match(0.0 * MOTION), RATE, Match(0.9 * MOTION), float(np.std(measured)))
    assert (found.below_noise, found.lost) == (False, True)


def test_slow_errors_that_the_better_of_model_and_lag_leaves_are_noise() -> None:
    """A drift of the attitude is no motion, though it is far above the white noise."""
    drift = 0.2 * np.sin(2.0 * np.pi * 0.2 * TIME)
    left = math.hypot(0.2 * math.sqrt(0.5), SIGMA * math.sqrt(20.0 / RATE))
    assert fit.unexplained([(MOTION + drift + noise(7), MOTION)] * 2, RATE) == pytest.approx(left, rel=0.05)
    still, model, lag = drift + noise(8), Match(0.0 * drift), Match(0.5 * drift)
    assert channel_figures(still, model, RATE, lag, SIGMA).lost
    found = channel_figures(still, model, RATE, lag, SIGMA, left=0.2 * math.sqrt(0.5))
    assert (found.below_noise, found.lost) == (True, False)
    assert not channel_figures(MOTION + still, model, RATE, lag, SIGMA, left=0.2).below_noise


def test_what_is_sampled_slowly_or_held_has_no_more_noise_than_the_fit_says() -> None:
    slow = np.sin(TIME[::40])  # 5 Hz: differences hold the motion
    assert noise_floor(slow, 5.0, 0.01)[0] <= 0.01
    assert noise_floor(np.repeat((np.sin(TIME) + noise(5))[::10], 10), RATE, math.inf)[0] < SIGMA


def test_the_band_holds_95_percent_of_what_it_describes() -> None:
    residual = noise(6)
    residual[:50] = np.nan
    assert fit.inside_band(residual, np.full(len(TIME), SIGMA)) == pytest.approx(0.95, abs=0.01)
    assert fit.inside_band(residual, np.full(len(TIME), 0.5 * SIGMA)) == pytest.approx(0.673, abs=0.03)
    assert math.isnan(fit.inside_band(residual, np.full(len(TIME), np.nan)))


def test_gain_without_phase() -> None:
    t = np.arange(1000) / 100.0
    for hertz, gain in ((1.0, 1.0), (10.0, 0.5), (40.0, 0.0)):
        wave = np.sin(2 * np.pi * hertz * t)
        assert_allclose(fit.low_pass(wave, 100.0)[200:800], gain * wave[200:800], atol=2e-3)


@settings(max_examples=25)
@given(st.lists(st.integers(1, 60), min_size=1, max_size=5))
def test_each_stretch_for_itself(sizes: list[int]) -> None:
    pieces = [np.random.default_rng(size).normal(size=size) for size in sizes]
    each = [fit.low_pass(piece, 100.0) for piece in pieces]
    assert_allclose(fit.low_pass(fit.join(pieces), 100.0), fit.join(each))


def colored(size: int, rho: float, seed: int) -> np.ndarray:
    return np.asarray(lfilter([1.0], [1.0, -rho], np.random.default_rng(seed).standard_normal(size)))


def test_against_the_formula_written_out() -> None:
    holes = colored(300, 0.2, 8)
    holes[[40, 41, 150]] = np.nan
    for residual in (*(colored(300, rho, 7) for rho in (0.0, 0.3, 0.95)), holes):
        found = whiteness(residual)
        assert found.lags == fit.WHITENESS_LAGS
        assert found.statistic == pytest.approx(naive_ljung_box(residual, fit.WHITENESS_LAGS), rel=1e-10)
        assert found.p_value == pytest.approx(chi2.sf(found.statistic, fit.WHITENESS_LAGS), rel=1e-12)
        assert whiteness(1e200 * residual).statistic == pytest.approx(found.statistic)
    for nothing in (np.zeros(50), np.full(50, np.nan), np.array([1.0, 2.0])):
        assert (whiteness(nothing).verdict, np.isnan(whiteness(nothing).statistic)) == ("", True)


def test_by_hand() -> None:
    # n = 10 allows two lags: r1 = sum / 10 = -9/10, r2 = 8/10; Q = 10 * 12 * (0.81 / 9 + 0.64 / 8)
    found = whiteness(np.array([1.0, -1.0] * 5))
    assert (found.lags, found.autocorrelation) == (2, pytest.approx(-0.9))
    assert (found.statistic, found.verdict) == (pytest.approx(120.0 * (0.81 / 9.0 + 0.64 / 8.0)), "colored")


def test_false_alarms_come_as_often_as_promised() -> None:
    random = np.random.default_rng(0)
    alarms = [whiteness(random.standard_normal(400)).verdict == "colored" for _ in range(600)]
    assert 0.03 < np.mean(alarms) < 0.08  # 5 %, standard error 0.9 %
    assert whiteness(colored(500, 0.5, 1)).verdict == "colored"
    for offset, verdict in ((1.0, "colored"), (0.0, "white")):
        assert whiteness(np.random.default_rng(1).standard_normal(500) + offset).verdict == verdict


def test_a_slow_sensor_on_a_fast_grid_counts_the_lags_that_it_has() -> None:
    random, residual = np.random.default_rng(2), np.full(3000, np.nan)
    residual[::10] = random.standard_normal(300)
    found = whiteness(residual)
    assert (found.lags, np.isnan(found.autocorrelation)) == (2, True)  # 10 and 20 of twenty
    assert found.p_value == pytest.approx(chi2.sf(found.statistic, 2), rel=1e-12)
    residual[::10] = colored(300, 0.2, 3)  # with twenty degrees of freedom it would pass for white
    assert whiteness(residual).verdict == "colored"


def test_a_prediction_that_diverges_is_not_white() -> None:
    """All its power is in the last samples, which correlate with nothing."""
    growth = np.random.default_rng(0).standard_normal(500) + np.exp(np.minimum(np.arange(500.0), 300.0))
    found = whiteness(growth)
    assert (found.verdict, np.isfinite(found.statistic)) == ("colored", True)


RATE_LAG = 100.0


def commands(size: int, seed: int, count: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    return np.repeat(random.normal(size=(size // 40 + 1, count)), 40, axis=0)[:size]


def truth(tau: float = 0.2, delay: float = 0.05, gains: tuple[float, ...] = (3.0,)) -> Lag:
    return Lag(tau, delay, np.array(gains), {0: 0.4, 1: -0.2}, (), RATE_LAG)


def record(lag: Lag, size: int, seed: int, maneuver: int = 0, noise: float = 0.0) -> LagRecord:
    u = commands(size, seed, len(lag.gains))
    y = lag.respond(u, lag.biases[maneuver], initial=0.5)
    return LagRecord(u, y + noise * np.random.default_rng(seed + 100).normal(size=size), maneuver)


@pytest.mark.parametrize("tau", [0.002, 0.1, 50.0])
def test_answer_is_the_exact_solution_for_straight_commands(tau: float) -> None:
    t = np.arange(200) / RATE_LAG
    u = np.interp(t, [0.0, 0.5, 0.6, 2.0], [1.0, 1.0, -1.0, 0.5])

    def rate(s: float, y: np.ndarray) -> np.ndarray:
        return (2.0 * np.interp(s, t, u) + 0.3 - y) / tau

    exact = solve_ivp(rate, (0.0, t[-1]), [0.7], "Radau", t, rtol=1e-10, atol=1e-12, max_step=0.01)
    lag = Lag(tau, 0.0, np.array([2.0]), {}, (), RATE_LAG)
    assert_allclose(lag.respond(u[:, None], bias=0.3, initial=0.7), exact.y[0], atol=2e-7)


def test_dead_time_holds_the_first_command() -> None:
    u, lag = commands(200, 1), truth(delay=0.1)
    late = np.concatenate([np.repeat(u[:1], 10, axis=0), u])[:200]
    assert_allclose(lag.respond(u, 0.4, 0.5), truth(delay=0.0).respond(late, 0.4, 0.5), atol=1e-12)


@pytest.mark.parametrize(("tau", "delay"), [(0.02, 0.0), (0.2, 0.05), (0.7, 0.13), (3.0, 0.28)])
def test_a_lag_is_recovered(tau: float, delay: float) -> None:
    lag = truth(tau, delay, gains=(3.0, -1.0))
    records = [record(lag, 500, 1), record(lag, 300, 2), record(lag, 400, 3, maneuver=1)]
    found = fit_lags([records], RATE_LAG)[0]
    assert found is not None
    assert (found.dead_time, found.time_constant) == (pytest.approx(delay), pytest.approx(tau, rel=2e-3))
    assert_allclose(found.gains, lag.gains, rtol=2e-3)
    assert_allclose([found.biases[0], found.biases[1]], [0.4, -0.2], atol=5e-3)
    assert_allclose(found.initial, 0.5, atol=5e-3)
    for matched, one in zip(found.matched(records), records, strict=True):
        assert theil(one.measured, matched) < 2e-3


def test_holes_and_too_little_to_fit() -> None:
    zero, blank = np.zeros((50, 1)), np.full(50, np.nan)
    assert fit_lags([[LagRecord(zero[:5], np.zeros(5))], [LagRecord(zero, blank)]], RATE_LAG) == [None, None]
    (still,) = fit_lags([[LagRecord(zero, np.ones(50))]], RATE_LAG)
    assert still is not None
    assert still.gains[0] == 0.0
    whole = record(truth(), 600, 4)
    holes = np.where(np.arange(600) % 3 == 0, np.nan, whole.measured)
    (found,) = fit_lags([[LagRecord(whole.commands, holes)]], RATE_LAG)
    assert found is not None
    assert found.time_constant == pytest.approx(0.2, rel=1e-3)
    assert_allclose(found.matched([whole])[0], whole.measured, atol=1e-3)
    assert np.isfinite(found.predicted([LagRecord(commands(50, 9), blank)])[0]).all()
    assert np.isfinite(replace(found, dead_time=0.2).respond(commands(10, 1), 0.0, 0.0)).all()


def segment(lags: dict[str, Lag], size: int, seed: int, maneuver: int) -> baseline.BaselineSegment:
    u = commands(size, seed, 3)
    driven = dict(zip(("control_roll", "control_pitch", "control_yaw"), u.T, strict=True))
    answers = {name: lag.respond(u, lag.biases[maneuver], 0.1) for name, lag in lags.items()}
    return baseline.BaselineSegment(driven, answers)


def test_every_maneuver_gets_its_curves() -> None:
    lags = {"p": truth(gains=(3.0, 0.0, 0.0)), "beta": truth(gains=(0.5, 0.0, -2.0))}
    parts, other = (segment(lags, 400, 1, 0), segment(lags, 300, 2, 0)), segment(lags, 350, 3, 1)
    both = [baseline.BaselineManeuver(r, p, RATE_LAG) for r, p in (("fit", parts), ("validation", (other,)))]
    first, second = baseline.baseline_matches(both, ["p", "beta", "V"])
    assert (set(first), first["p"].simulated.shape) == ({"p", "beta"}, (701,))
    assert np.isnan(first["p"].simulated[400])
    assert theil(parts[0].measured["p"], first["p"].simulated[:400]) < 1e-3
    assert theil(other.measured["beta"], second["beta"].simulated) < 0.05


def test_every_channel_answers_to_the_command_of_its_axis_alone() -> None:
    own = {"phi": (3.0, 0.0, 0.0), "alpha": (0.0, 3.0, 0.0), "beta": (0.0, 0.0, 3.0), "p": (0.0, 0.0, 3.0)}
    part = segment({n: truth(gains=g) for n, g in own.items()}, 600, 1, 0)
    (curves,) = baseline.baseline_matches([baseline.BaselineManeuver("fit", (part,), RATE_LAG)], list(own))
    left = {name: theil(part.measured[name], curves[name].simulated) for name in own}
    assert left.pop("p") > 0.3, "it answers to the yaw command, not to that of roll"
    assert max(left.values()) < 1e-3


def solved(J: np.ndarray, z: np.ndarray, prior: np.ndarray, keep: np.ndarray) -> np.ndarray:
    rows = keep & np.isfinite(z)
    return np.asarray(np.linalg.solve(J[rows].T @ J[rows] + prior, J[rows].T @ z[rows]))


@pytest.mark.parametrize("block", [1, 7, 20])
def test_equals_fitting_again_without_the_block(block: int) -> None:
    random = np.random.default_rng(block)
    J, prior = random.standard_normal((60, 2, 5)), np.diag([4.0, 0.0, 0.0, 0.0, 0.0])
    z = J @ random.standard_normal(5) + random.standard_normal((60, 2))
    z[10:13, 0] = np.nan
    everything, there = np.ones_like(z, dtype=bool), np.isfinite(z)
    found = fit.left_out(z - J @ solved(J, z, prior, everything), J, J[there].T @ J[there] + prior, block)
    for first in range(0, len(z), block):
        keep, part = everything.copy(), slice(first, first + block)
        keep[part] = False
        assert_allclose(found[part], z[part] - J[part] @ solved(J, z, prior, keep), rtol=1e-9, atol=1e-12)


def lag_record() -> tuple[LagRecord, Lag]:
    noisy = record(truth(0.12, 0.03, (2.0,)), 400, 2, noise=0.2)
    holed = replace(noisy, measured=np.where(np.arange(400) % 57 == 0, np.nan, noisy.measured))
    (lag,) = fit_lags([[holed]], RATE_LAG)
    assert lag is not None
    return holed, lag


def test_the_lag_is_predicted_worse_than_it_is_matched() -> None:
    record, lag = lag_record()
    (missed,), (matched,) = lag.left_out([record]), lag.matched([record])
    assert np.array_equal(np.isfinite(missed), np.isfinite(record.measured))
    press, rms = (float(np.sqrt(np.nanmean(r**2))) for r in (missed, record.measured - matched))
    assert rms < press < 1.1 * rms


def test_derivatives_of_the_lag_are_those_of_its_answer() -> None:
    record, lag = lag_record()
    found = lag.sensitivities([record])

    def answer(**changes: object) -> np.ndarray:
        changed = replace(lag, **changes)  # type: ignore[arg-type]
        return changed.respond(record.commands, changed.biases[0], changed.initial[0])

    step = 1e-6
    by_gain = (answer(gains=lag.gains + step) - answer(gains=lag.gains - step)) / (2 * step)
    by_bias, tau = answer(biases={0: lag.biases[0] + 1.0}) - answer(), lag.time_constant
    by_tau = tau * (answer(time_constant=tau + step) - answer(time_constant=tau - step)) / (2 * step)
    later, sooner = answer(dead_time=lag.dead_time + 0.01), answer(dead_time=lag.dead_time - 0.01)
    expected = np.column_stack([by_gain, by_bias, by_tau, (later - sooner) / 2.0])
    assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
