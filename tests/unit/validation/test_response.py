"""Modes from the free response: known oscillations come back, and what cannot be told is not invented."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.validation.response import free_response, measured_mode

TIME = np.arange(0.0, 8.0, 0.01)


def record(w: float, zeta: float, noise: float, seed: int = 0) -> tuple[np.ndarray, dict[str, np.ndarray]]:
    """Return a doublet until 2 s and what two channels do, an oscillation on a slow drift from then on."""
    random = np.random.default_rng(seed)
    control = np.where(TIME < 1.0, 0.0, np.where(TIME < 1.5, 0.2, np.where(TIME < 2.0, -0.2, 0.0)))[:, None]
    t = np.maximum(TIME - 2.0, 0.0)
    decay, angle = np.exp(-zeta * w * t), w * np.sqrt(1 - zeta**2) * t
    clean = {"r": 0.3 * decay * np.cos(angle) + 0.02 * t, "beta": 0.1 * decay * np.sin(angle + 0.4) + 0.05}
    return control, {n: y + noise * random.standard_normal(len(y)) for n, y in clean.items()}


def test_a_known_oscillation_comes_back_within_its_error() -> None:
    off = []
    for seed in range(20):
        control, channels = record(3.0, 0.2, 0.01, seed)
        found = measured_mode("Dutch roll", 1, free_response(TIME, control, channels), 3.2)
        assert (found.maneuver, found.channels, found.remark) == (1, ("r", "beta"), "")
        assert found.start == pytest.approx(2.0)
        off.append((found.frequency.estimate - 3.0) / found.frequency.std_error)
        off.append((found.damping.estimate - 0.2) / found.damping.std_error)
    assert np.std(off) == pytest.approx(1.0, abs=0.35)
    assert abs(np.mean(off)) < 0.6


def test_the_guess_of_the_model_is_not_what_comes_back() -> None:
    control, channels = record(3.0, 0.2, 0.01)
    free = free_response(TIME, control, channels)
    found = [measured_mode("Dutch roll", 0, free, guess).frequency.estimate for guess in (2.3, 3.0, 4.0)]
    assert found == pytest.approx([3.0] * 3, abs=0.1)


def test_missing_samples_are_left_out() -> None:
    control, channels = record(3.0, 0.2, 0.005)
    channels["r"][250:300] = np.nan
    found = measured_mode("Dutch roll", 0, free_response(TIME, control, channels), 3.0)
    assert found.frequency.estimate == pytest.approx(3.0, abs=0.1)


@pytest.mark.parametrize(
    ("name", "expected", "words"),
    [
        ("spiral", 0.1, "does not oscillate"),
        ("phugoid", 3.0, "not recorded"),
        ("Dutch roll", 0.3, "of its periods"),
    ],
)
def test_what_cannot_be_told_is_said(name: str, expected: float, words: str) -> None:
    control, channels = record(3.0, 0.2, 0.01)
    found = measured_mode(
        name, 0, free_response(TIME, control, {**channels, "V": np.full(len(TIME), np.nan)}), expected
    )
    assert words in found.remark
    assert np.isnan(found.frequency.estimate)


def test_noise_is_no_mode() -> None:
    random = np.random.default_rng(4)
    control, channels = record(3.0, 0.2, 0.01)
    noise = {name: random.standard_normal(len(TIME)) for name in channels}
    found = measured_mode("Dutch roll", 0, free_response(TIME, control, noise), 3.0)
    assert found.remark.startswith("not identified")


def test_controls_that_never_rest_leave_nothing() -> None:
    control = 0.2 * np.sign(np.sin(7.0 * TIME))[:, None] + 0.3 * (TIME > 7.985)[:, None]
    free = free_response(TIME, control, {"r": np.zeros(len(TIME))})
    assert free.duration < 0.1
    assert "not identified" in measured_mode("Dutch roll", 0, free, 3.0).remark
