"""Spectra of a flight: power of accelerations and rates, spectrograms, and frequency responses of rates to commands.

Spectra are averaged over half-overlapping windows that hold no gap, each less its mean and tapered by Hann's window; frequency
responses are those of `stoop.flight.frequency_responses`.

References
----------
P. D. Welch, "The use of fast Fourier transform for the estimation of power spectra", *IEEE Transactions on Audio and
Electroacoustics* 15(2), 1967.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import ComplexArray, FloatArray, run_slices
from stoop.flight.flight import Flight
from stoop.flight.frequency_responses import FrequencyResponse, Stretch
from stoop.flight.maneuvers import MOTION

POWER_WINDOW: Final = 10.0  #: s, of a power spectrum
SPECTROGRAM_WINDOW: Final = 2.0  #: s
MIN_WINDOWS: Final = 4  #: a flight that holds fewer gets shorter ones
MIN_SAMPLES: Final = 16  #: of a window
MAX_COLUMNS: Final = 400  #: of a spectrogram


@dataclass(frozen=True, eq=False)
class PowerSpectrum:
    """One-sided power spectral density of a channel."""

    name: str
    frequency: FloatArray  #: (m,) Hz, without zero
    density: FloatArray  #: (m,), the channel's unit squared per Hz


@dataclass(frozen=True, eq=False)
class Spectrogram:
    """Power spectral density over time."""

    name: str
    time: FloatArray  #: (k,) s, middle of each window
    frequency: FloatArray  #: (m,) Hz
    density: FloatArray  #: (m, k), NaN where there is a gap


def power_spectra(flight: Flight, names: Sequence[str]) -> list[PowerSpectrum]:
    """Return the power spectra of those of the channels that hold a window without a gap."""
    found = []
    for name in names:
        values = flight.column(name)
        stretches = run_slices(np.isfinite(values))
        longest = max((one.stop - one.start for one in stretches), default=0)
        size = min(round(POWER_WINDOW * flight.rate), 2 * longest // (MIN_WINDOWS + 1)) // 2 * 2
        if size < MIN_SAMPLES:
            continue
        starts = np.concatenate([np.arange(one.start, one.stop - size + 1, size // 2) for one in stretches])
        windows = _transformed(values[starts[:, None] + np.arange(size)], flight.rate)
        density = np.mean(np.abs(windows) ** 2, axis=0)[1:]
        found.append(PowerSpectrum(name, flight.rate * np.arange(1, size // 2 + 1) / size, density))
    return found


def spectrogram(flight: Flight, name: str) -> Spectrogram:
    """Return the spectrogram of a channel in at most `MAX_COLUMNS` windows."""
    values, length = flight.column(name), max(MIN_SAMPLES, round(SPECTROGRAM_WINDOW * flight.rate))
    length = min(length, len(values))
    count = min(MAX_COLUMNS, 1 + 2 * (len(values) // length))
    starts = np.linspace(0, len(values) - length, count).astype(int)
    density = np.abs(_transformed(values[starts[:, None] + np.arange(length)], flight.rate)) ** 2
    frequency = np.arange(density.shape[1]) * flight.rate / length
    return Spectrogram(name, flight.time[starts] + 0.5 * length / flight.rate, frequency, density.T)


def frequency_responses(flight: Flight) -> list[FrequencyResponse]:
    """Return the responses of roll, pitch and yaw rate to the command of their axis, where both were recorded."""
    found = []
    for command in flight.commands():
        rate = MOTION[command.axis]
        if rate in flight.names:
            both = Stretch(flight.rate, command.u[:, None], flight.column(rate)[:, None])
            found += FrequencyResponse.estimate([both], [command.variable], [rate])
    return found


def _transformed(windows: FloatArray, rate: float) -> ComplexArray:
    """Return the transforms (w, m) of windows (w, n); their squared magnitudes are one-sided densities."""
    taper = np.hanning(windows.shape[1] + 1)[:-1]
    left = windows - windows.mean(axis=1, keepdims=True)
    return np.asarray(np.fft.rfft(left * taper, axis=1) * np.sqrt(2.0 / (rate * np.sum(taper**2))))
