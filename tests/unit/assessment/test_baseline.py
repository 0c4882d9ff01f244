"""The trivial lag: its exact answer, recovery, and its place beside a maneuver; PRESS against fits without the samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from stoop.assessment import baseline
from stoop.assessment.baseline import Lag, LagRecord, fit_lags
from stoop.assessment.goodness_of_fit import left_out, theil

RATE = 100.0


def commands(size: int, seed: int, count: int = 1) -> np.ndarray:
    random = np.random.default_rng(seed)
    levels = random.normal(size=(size // 40 + 1, count))
    return np.repeat(levels, 40, axis=0)[:size]


def truth(tau: float = 0.2, delay: float = 0.05, gains: tuple[float, ...] = (3.0,)) -> Lag:
    return Lag(tau, delay, np.array(gains), {0: 0.4, 1: -0.2}, (), RATE)


def record(lag: Lag, size: int, seed: int, maneuver: int = 0, noise: float = 0.0) -> LagRecord:
    u = commands(size, seed, len(lag.gains))
    y = lag.respond(u, lag.biases[maneuver], initial=0.5)
    return LagRecord(u, y + noise * np.random.default_rng(seed + 100).normal(size=size), maneuver)


@pytest.mark.parametrize("tau", [0.002, 0.1, 50.0])
def test_answer_is_the_exact_solution_for_straight_commands(tau: float) -> None:
    t = np.arange(200) / RATE
    u = np.interp(t, [0.0, 0.5, 0.6, 2.0], [1.0, 1.0, -1.0, 0.5])

    def rate(s: float, y: np.ndarray) -> np.ndarray:
        return (2.0 * np.interp(s, t, u) + 0.3 - y) / tau

    exact = solve_ivp(rate, (0.0, t[-1]), [0.7], "Radau", t, rtol=1e-10, atol=1e-12, max_step=0.01)
    lag = Lag(tau, 0.0, np.array([2.0]), {}, (), RATE)
    assert_allclose(lag.respond(u[:, None], bias=0.3, initial=0.7), exact.y[0], atol=2e-7)


def test_dead_time_holds_the_first_command() -> None:
    u = commands(200, 1)
    lag = truth(delay=0.1)
    late = np.concatenate([np.repeat(u[:1], 10, axis=0), u])[:200]
    assert_allclose(lag.respond(u, 0.4, 0.5), truth(delay=0.0).respond(late, 0.4, 0.5), atol=1e-12)


@pytest.mark.parametrize(("tau", "delay"), [(0.02, 0.0), (0.2, 0.05), (0.7, 0.13), (3.0, 0.28)])
def test_a_lag_is_recovered(tau: float, delay: float) -> None:
    lag = truth(tau, delay, gains=(3.0, -1.0))
    records = [record(lag, 500, 1), record(lag, 300, 2), record(lag, 400, 3, maneuver=1)]
    found = fit_lags([records], RATE)[0]
    assert found is not None
    assert found.dead_time == pytest.approx(delay)
    assert found.time_constant == pytest.approx(tau, rel=2e-3)
    assert_allclose(found.gains, lag.gains, rtol=2e-3)
    assert_allclose([found.biases[0], found.biases[1]], [0.4, -0.2], atol=5e-3)
    assert_allclose(found.initial, 0.5, atol=5e-3)
    for matched, one in zip(found.matched(records), records, strict=True):
        assert theil(one.measured, matched) < 2e-3


def test_holes_and_too_little_to_fit() -> None:
    zero, blank = np.zeros((50, 1)), np.full(50, np.nan)
    assert fit_lags([[LagRecord(zero[:5], np.zeros(5))], [LagRecord(zero, blank)]], RATE) == [None, None]
    (still,) = fit_lags([[LagRecord(zero, np.ones(50))]], RATE)
    assert still is not None
    assert still.gains[0] == 0.0
    whole = record(truth(), 600, 4)
    holes = np.where(np.arange(600) % 3 == 0, np.nan, whole.measured)
    (found,) = fit_lags([[LagRecord(whole.commands, holes)]], RATE)
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
    parts = segment(lags, 400, 1, 0), segment(lags, 300, 2, 0)
    other = segment(lags, 350, 3, 1)
    both = [baseline.BaselineManeuver(r, p, RATE) for r, p in (("fit", parts), ("validation", (other,)))]
    first, second = baseline.baseline_matches(both, ["p", "beta", "V"])
    assert set(first) == {"p", "beta"}
    assert first["p"].simulated.shape == (701,)
    assert np.isnan(first["p"].simulated[400])
    assert theil(parts[0].measured["p"], first["p"].simulated[:400]) < 1e-3
    assert theil(other.measured["beta"], second["beta"].simulated) < 0.05


def test_every_channel_answers_to_the_command_of_its_axis_alone() -> None:
    own = {"phi": (3.0, 0.0, 0.0), "alpha": (0.0, 3.0, 0.0), "beta": (0.0, 0.0, 3.0), "p": (0.0, 0.0, 3.0)}
    part = segment({n: truth(gains=g) for n, g in own.items()}, 600, 1, 0)
    (curves,) = baseline.baseline_matches([baseline.BaselineManeuver("fit", (part,), RATE)], list(own))
    left = {name: theil(part.measured[name], curves[name].simulated) for name in own}
    assert left.pop("p") > 0.3, "it answers to the yaw command, not to that of roll"
    assert max(left.values()) < 1e-3


def solved(J: np.ndarray, z: np.ndarray, prior: np.ndarray, keep: np.ndarray) -> np.ndarray:
    rows = keep & np.isfinite(z)
    M = J[rows].T @ J[rows] + prior
    return np.asarray(np.linalg.solve(M, J[rows].T @ z[rows]))


@pytest.mark.parametrize("block", [1, 7, 20])
def test_equals_fitting_again_without_the_block(block: int) -> None:
    random = np.random.default_rng(block)
    J, prior = random.standard_normal((60, 2, 5)), np.diag([4.0, 0.0, 0.0, 0.0, 0.0])
    z = J @ random.standard_normal(5) + random.standard_normal((60, 2))
    z[10:13, 0] = np.nan
    everything, there = np.ones_like(z, dtype=bool), np.isfinite(z)
    information = J[there].T @ J[there] + prior
    found = left_out(z - J @ solved(J, z, prior, everything), J, information, block)
    for first in range(0, len(z), block):
        keep, part = everything.copy(), slice(first, first + block)
        keep[part] = False
        expected = z[part] - J[part] @ solved(J, z, prior, keep)
        assert_allclose(found[part], expected, rtol=1e-9, atol=1e-12)


def lag_record() -> tuple[LagRecord, Lag]:
    noisy = record(truth(0.12, 0.03, (2.0,)), 400, 2, noise=0.2)
    holed = replace(noisy, measured=np.where(np.arange(400) % 57 == 0, np.nan, noisy.measured))
    (lag,) = fit_lags([[holed]], RATE)
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
    by_bias = answer(biases={0: lag.biases[0] + 1.0}) - answer()
    tau = lag.time_constant
    by_tau = tau * (answer(time_constant=tau + step) - answer(time_constant=tau - step)) / (2 * step)
    later, sooner = answer(dead_time=lag.dead_time + 0.01), answer(dead_time=lag.dead_time - 0.01)
    expected = np.column_stack([by_gain, by_bias, by_tau, (later - sooner) / 2.0])
    assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
