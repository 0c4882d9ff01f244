"""PRESS by the shortcut, against fits done again without their samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stoop.assessment.baseline import Lag, LagRecord, fit_lags
from stoop.assessment.goodness_of_fit import left_out


def problem(seed: int, samples: int = 60, channels: int = 2, unknowns: int = 5) -> tuple[np.ndarray, ...]:
    random = np.random.default_rng(seed)
    J = random.standard_normal((samples, channels, unknowns))
    z = J @ random.standard_normal(unknowns) + random.standard_normal((samples, channels))
    z[10:13, 0] = np.nan
    prior = np.diag([4.0, *[0.0] * (unknowns - 1)])
    return J, z, prior


def solved(J: np.ndarray, z: np.ndarray, prior: np.ndarray, keep: np.ndarray) -> np.ndarray:
    rows = keep & np.isfinite(z)
    M = J[rows].T @ J[rows] + prior
    return np.asarray(np.linalg.solve(M, J[rows].T @ z[rows]))


@pytest.mark.parametrize("block", [1, 7, 20])
def test_equals_fitting_again_without_the_block(block: int) -> None:
    J, z, prior = problem(block)
    everything = np.ones_like(z, dtype=bool)
    there = np.isfinite(z)
    information = J[there].T @ J[there] + prior
    found = left_out(z - J @ solved(J, z, prior, everything), J, information, block)
    for first in range(0, len(z), block):
        keep = everything.copy()
        keep[first : first + block] = False
        part = slice(first, first + block)
        expected = z[part] - J[part] @ solved(J, z, prior, keep)
        np.testing.assert_allclose(found[part], expected, rtol=1e-9, atol=1e-12)


def lag_record() -> tuple[LagRecord, Lag]:
    random = np.random.default_rng(2)
    u = np.repeat(random.uniform(-1, 1, 20), 20)[:, None]
    truth = Lag(0.12, 0.03, np.array([2.0]), {0: 0.1}, (0.0,), 100.0)
    measured = truth.respond(u, 0.1, 0.0) + 0.2 * random.standard_normal(400)
    record = LagRecord(u, np.where(np.arange(400) % 57 == 0, np.nan, measured))
    lag = fit_lags([[record]], 100.0)[0]
    assert lag is not None
    return record, lag


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
    np.testing.assert_allclose(found, expected, atol=1e-5 * np.abs(expected).max())
