"""Modes from the free response: known oscillations come back, and what cannot be told is not invented."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.assessment.free_response import FreeResponse, elsewhere, free_response, measured_mode

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
        assert (found.maneuver, found.channels, found.remark) == (1, ("r", "beta"), None)
        assert found.start == pytest.approx(2.0)
        off.append((found.frequency.estimate - 3.0) / found.frequency.std_error)
        off.append((found.damping.estimate - 0.2) / found.damping.std_error)
    assert np.std(off) == pytest.approx(1.0, abs=0.35)
    assert abs(np.mean(off)) < 0.6


def test_what_is_no_single_oscillation_widens_the_error() -> None:
    """A faster mode left over at the start: noise alone would be far too sure."""
    off, widths = [], []
    for seed in range(4):
        control, channels = record(3.0, 0.2, 0.005, seed)
        t = np.maximum(TIME - 2.0, 0.0)
        other = {n: y + 0.08 * np.exp(-2.5 * t) * np.cos(7.0 * t) for n, y in channels.items()}
        pure, mixed = (
            measured_mode("Dutch roll", 0, free_response(TIME, control, c), 3.0) for c in (channels, other)
        )
        off += [(mixed.frequency.estimate - 3.0) / mixed.frequency.std_error]
        off += [(mixed.damping.estimate - 0.2) / mixed.damping.std_error]
        widths.append(mixed.damping.std_error / pure.damping.std_error)
    assert np.median(widths) > 2.0
    assert np.max(np.abs(off)) < 3.0


def test_a_response_at_another_airspeed_is_less_sure() -> None:
    control, channels = record(3.0, 0.2, 0.001)
    V = 33.0 + np.sin(0.5 * TIME)
    free = free_response(TIME, control, {**channels, "V": V})
    assert elsewhere(free, float("nan")) == 0.0
    assert elsewhere(free, 30.0) == pytest.approx(0.1, abs=0.02)
    found = measured_mode("Dutch roll", 0, free, 3.0, 30.0)
    used = free.time - free.time[0] <= 4.0 * np.pi / 3.0
    away = elsewhere(FreeResponse(free.time[used], {n: y[used] for n, y in free.channels.items()}), 30.0)
    assert found.frequency.std_error == pytest.approx(away * found.frequency.estimate, rel=0.05)
    assert found.damping.std_error == pytest.approx(away * found.damping.estimate, rel=0.3)


@pytest.mark.parametrize(
    ("name", "expected", "code"),
    [
        ("spiral", 0.1, "response-no-oscillation"),
        ("phugoid", 3.0, "response-not-recorded"),
        ("Dutch roll", 0.3, "response-too-short"),
    ],
)
def test_what_cannot_be_told_is_said(name: str, expected: float, code: str) -> None:
    control, channels = record(3.0, 0.2, 0.01)
    found = measured_mode(
        name, 0, free_response(TIME, control, {**channels, "V": np.full(len(TIME), np.nan)}), expected
    )
    assert found.remark is not None
    assert (found.remark.code, found.remark.subject) == (code, name)
    assert np.isnan(found.frequency.estimate)


def test_noise_is_no_mode() -> None:
    random = np.random.default_rng(4)
    control, channels = record(3.0, 0.2, 0.01)
    noise = {name: random.standard_normal(len(TIME)) for name in channels}
    found = measured_mode("Dutch roll", 0, free_response(TIME, control, noise), 3.0)
    assert found.remark is not None
    assert found.remark.code in ("response-not-explained", "response-inaccurate")


def test_controls_that_never_rest_leave_nothing() -> None:
    control = 0.2 * np.sign(np.sin(7.0 * TIME))[:, None] + 0.3 * (TIME > 7.985)[:, None]
    free = free_response(TIME, control, {"r": np.zeros(len(TIME))})
    assert not free.time.size
    remark = measured_mode("Dutch roll", 0, free, 3.0).remark
    assert remark is not None
    assert remark.code == "response-no-rest"
