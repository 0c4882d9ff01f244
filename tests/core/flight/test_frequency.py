"""Frequency responses and spectra: SciPy's estimators as twin, an analytic response, gaps, inputs that move together."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive.composite_windows import naive_responses
from numpy.testing import assert_allclose
from scipy import signal
from scipy.special import stdtrit

from stoop.base.arrays import FloatArray
from stoop.flight import from_columns
from stoop.flight.frequency_responses import POINTS_PER_OCTAVE, FrequencyResponse, Stretch, frequencies
from stoop.flight.spectra import frequency_responses, power_spectra, spectrogram

RATE = 50.0
TIME = np.arange(6000) / RATE


def inputs(n: int, columns: int, seed: int = 0) -> FloatArray:
    shape = signal.butter(2, 5.0, fs=RATE, output="sos")
    white = np.random.default_rng(seed).standard_normal((n, columns))
    return np.asarray(signal.sosfilt(shape, white, axis=0))


def lag(u: FloatArray, seconds: float = 0.3, noise: float = 0.1, seed: int = 1) -> FloatArray:
    y = signal.lfilter(*signal.bilinear([1.0], [seconds, 1.0], RATE), u)
    return np.asarray(y + noise * np.std(y) * np.random.default_rng(seed).standard_normal(len(u)))


def test_one_window_length_is_the_welch_estimate() -> None:
    n, size = 4000, 600
    u = inputs(n - (n - size) % (size // 2), 1)
    y = lag(u[:, 0])
    base = POINTS_PER_OCTAVE / (size / RATE)  # the points of the first octave lie on the bins
    band = (2.0 * np.pi * base, 2.0 * np.pi * 2.0 * base * 0.999)
    (one,) = FrequencyResponse.estimate([Stretch(RATE, u, y[:, None])], ["u"], ["y"], band, [size / RATE])
    f, cross = signal.csd(u[:, 0], y, RATE, nperseg=size)
    _, power = signal.welch(u[:, 0], RATE, nperseg=size)
    _, coherence = signal.coherence(u[:, 0], y, RATE, nperseg=size)
    bins = np.round(one.frequency / (2.0 * np.pi) * size / RATE).astype(int)
    assert_allclose(one.frequency, 2.0 * np.pi * f[bins], rtol=1e-12)
    assert_allclose(one.response, (cross / power)[bins], rtol=1e-9)
    assert_allclose(one.coherence, coherence[bins], rtol=1e-9)


def test_bands_hold_the_analytic_response() -> None:
    inside = []
    for seed in range(25):
        u = inputs(4500, 1, seed)
        y = lag(u[:, 0], noise=0.3, seed=seed + 1000)
        (one,) = FrequencyResponse.estimate([Stretch(RATE, u, y[:, None])], ["u"], ["y"])
        _, truth = signal.freqz(*signal.bilinear([1.0], [0.3, 1.0], RATE), one.frequency / RATE)
        good = one.coherence > 0.6
        inside.append((np.abs(np.abs(one.response / truth) - 1.0) <= one.bound)[good])
    assert np.mean(np.concatenate(inside)) == pytest.approx(0.95, abs=0.03)


def test_a_gap_is_the_same_as_two_stretches_and_units_scale_the_response_alone() -> None:
    u = inputs(5000, 1)
    y = lag(u[:, 0])[:, None]
    holed = y.copy()
    holed[2400:2600] = np.nan
    parts = [Stretch(RATE, u[s], y[s]) for s in (slice(0, 2400), slice(2600, None))]
    every = [Stretch(RATE, u, holed)], parts, [Stretch(RATE, 3.0 * u, 0.2 * holed)]
    (one,), (two,), (scaled,) = (FrequencyResponse.estimate(x, ["u"], ["y"]) for x in every)
    assert_allclose(one.response, two.response, rtol=1e-12)
    assert_allclose(one.bound, two.bound, rtol=1e-12)
    assert_allclose(scaled.response, one.response * 0.2 / 3.0, rtol=1e-6)
    assert_allclose(scaled.bound, one.bound, rtol=1e-6)
    assert_allclose(scaled.coherence, one.coherence, rtol=1e-6)


def test_short_or_still_records_say_nothing() -> None:
    u = inputs(400, 1)
    assert FrequencyResponse.estimate([Stretch(RATE, u[:10], u[:10])], ["u"], ["y"]) == []
    (still,) = FrequencyResponse.estimate([Stretch(RATE, np.zeros((400, 1)), u)], ["u"], ["y"])
    assert np.isinf(still.bound).all()
    twice = np.column_stack([u[:, 0], u[:, 0]])
    for one in FrequencyResponse.estimate([Stretch(RATE, twice, u)], ["a", "b"], ["y"]):
        assert np.isinf(one.bound).all()  # one input given twice cannot be told apart
    for n in (5, 20):
        flight = from_columns("f", TIME[:n], {"p": np.zeros(n), "control_roll": np.zeros(n)})
        assert power_spectra(flight, ["p"]) == frequency_responses(flight) == []
        assert spectrogram(flight, "p").density.shape[1] >= 1


@given(st.lists(st.floats(1.0, 300.0), min_size=1, max_size=6), st.integers(1, 4))
@settings(max_examples=60, deadline=None)
def test_windows_fit_side_by_side(durations: list[float], count: int) -> None:
    lengths = FrequencyResponse.window_lengths(durations, count)
    assert lengths
    assert sum(int(d / lengths[0] * (1.0 + 1e-9)) for d in durations) >= count + 2
    assert list(lengths) == sorted(lengths, reverse=True)
    points = frequencies(0.01 * durations[0], durations[-1])
    assert (np.diff(points) > 0.0).all()
    assert points.size == 0 or points[-1] <= durations[-1] * (1.0 + 1e-6)


def test_windows_of_several_lengths_are_weighed_as_printed() -> None:
    u, lengths = inputs(1500, 2, seed=3), [12.0, 7.0, 4.0]
    y = lag(u[:, 0], noise=0.5) - 0.4 * u[:, 1]
    found = FrequencyResponse.estimate([Stretch(RATE, u, y[:, None])], ["a", "b"], ["y"], lengths=lengths)
    hertz = found[0].frequency / (2.0 * np.pi)
    for i, (response, error, freedom, coherence) in enumerate(naive_responses(u, y, RATE, lengths, hertz)):
        for k, one in enumerate(found):
            assert_allclose(one.response[i], response[k], rtol=1e-9)
            assert_allclose(one.coherence[i], coherence[k], rtol=1e-9)
            assert_allclose(one.bound[i], stdtrit(freedom, 0.975) * error[k], rtol=1e-8)


def test_power_spectra_are_those_of_scipy_and_their_area_the_variance_also_beside_gaps() -> None:
    p = signal.lfilter([0.3], [1.0, -0.7], np.random.default_rng(1).standard_normal(len(TIME)))
    (one,) = power_spectra(from_columns("f", TIME, {"p": p}), ["p"])
    frequency, density = signal.welch(p, RATE, "hann", 500, detrend="constant")
    assert one.frequency == pytest.approx(frequency[1:])
    assert one.density[:-1] == pytest.approx(density[1:-1], rel=1e-9)
    p = 0.1 * np.random.default_rng(2).standard_normal(len(TIME))
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


def test_responses_of_a_flight_are_those_of_its_columns() -> None:
    u, noise = np.random.default_rng(0).standard_normal((2, len(TIME)))
    responses = frequency_responses(from_columns("f", TIME, {"control_roll": u, "p": lag(u) + 0.1 * noise}))
    one = next(r for r in responses if r.output == "p")
    _, truth = signal.freqz(*signal.bilinear([1.0], [0.3, 1.0], RATE), one.frequency / RATE)
    band = one.frequency < 2.0 * np.pi * 3.0
    assert np.mean(np.abs(one.response / truth - 1.0)[band] < 1.5 * one.bound[band]) > 0.9
    assert 0.0 <= one.coherence.min() <= one.coherence.max() <= 1.0 + 1e-9
