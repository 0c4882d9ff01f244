"""Spectra against SciPy's estimators and a known linear system."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import signal

from stoop.flight import from_columns
from stoop.flight.spectra import frequency_responses, power_spectra, spectrogram

RATE = 50.0
TIME = np.arange(6000) / RATE


def test_a_power_spectrum_is_that_of_scipy() -> None:
    rng = np.random.default_rng(1)
    p = signal.lfilter([0.3], [1.0, -0.7], rng.standard_normal(len(TIME)))
    (one,) = power_spectra(from_columns("f", TIME, {"p": p}), ["p"])
    frequency, density = signal.welch(p, RATE, "hann", 500, detrend="constant")
    assert one.frequency == pytest.approx(frequency[1:])
    assert one.density[:-1] == pytest.approx(density[1:-1], rel=1e-9)


def test_the_variance_is_the_area_also_beside_gaps() -> None:
    rng = np.random.default_rng(2)
    p = 0.1 * rng.standard_normal(len(TIME))
    p[1000:1300] = np.nan
    (one,) = power_spectra(from_columns("f", TIME, {"p": p}), ["p"])
    area = np.sum(one.density) * (one.frequency[1] - one.frequency[0])
    assert area == pytest.approx(0.01, rel=0.05)


def test_a_sine_stands_at_its_frequency_and_only_while_it_lasts() -> None:
    p = np.where(TIME < 60.0, np.sin(2.0 * np.pi * 8.0 * TIME), 1e-3)
    one = spectrogram(from_columns("f", TIME, {"p": p}), "p")
    loudest = one.frequency[np.argmax(one.density, axis=0)]
    assert loudest[one.time < 58.0] == pytest.approx(8.0, abs=0.5)
    assert one.density[:, one.time > 62.0].max() < 1e-20


def test_a_first_order_lag_is_found_within_its_random_error() -> None:
    """Magnitude and phase of a known lag beside noise: 95 % of the bands hold the truth, as they say."""
    inside, lag = [], 0.3
    for seed in range(20):
        rng = np.random.default_rng(seed)
        u = rng.standard_normal(len(TIME))
        b, a = signal.bilinear([1.0], [lag, 1.0], RATE)
        p = signal.lfilter(b, a, u) + 0.1 * rng.standard_normal(len(TIME))
        responses = frequency_responses(from_columns("f", TIME, {"control_roll": u, "p": p}))
        one = next(r for r in responses if r.output == "p")
        _, truth = signal.freqz(b, a, one.frequency / RATE)
        band = one.frequency < 2.0 * np.pi * 3.0
        relative = (one.response / truth - 1.0)[band]
        inside += [np.abs(relative.real) < one.bound[band], np.abs(relative.imag) < one.bound[band]]
        assert one.coherence.min() >= 0.0
        assert one.coherence.max() <= 1.0 + 1e-9
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03)


@pytest.mark.parametrize("n", [5, 20])
def test_hardly_any_samples_have_no_spectrum(n: int) -> None:
    flight = from_columns("f", TIME[:n], {"p": np.zeros(n), "control_roll": np.zeros(n)})
    assert power_spectra(flight, ["p"]) == []
    assert frequency_responses(flight) == []
    assert spectrogram(flight, "p").density.shape[1] >= 1
