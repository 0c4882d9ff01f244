"""Inputs of a flight test: their shape, their spectrum, and how they are flown."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from pictures.registry import picture
from pictures.sketch import BLUE, CYCLE, GREEN, INK, ORANGE, PALE_GREEN, SOFT, plots
from stoop.base.arrays import FloatArray
from stoop.simulation.maneuver import Multisine, Steps
from stoop.vehicle.delays import first_order_lag

DT: Final = 0.005  #: s
PAD: Final = 2**15  #: samples of a spectrum


def steps(shape: str, step: float, start: float = 1.0, amplitude: float = 1.0) -> Steps:
    """Return steps of a unit amplitude."""
    table = {"control": "elevator", "shape": shape, "start": start, "step": step, "amplitude": amplitude}
    return Steps.model_validate(table)


def sweep(t: FloatArray, begin: float, end: float, start: float, stop: float) -> FloatArray:
    """Return a sine whose frequency grows exponentially from `begin` to `end`, Hz, faded in and out."""
    tau = np.clip(t - start, 0.0, stop - start)
    rate = np.log(end / begin) / (stop - start)
    fade = np.clip(np.minimum(tau, stop - start - tau) / 1.0, 0.0, 1.0)
    out: FloatArray = fade * np.sin(2.0 * np.pi * begin * np.expm1(rate * tau) / rate)
    return out


def spectrum(signal: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return frequencies, Hz, and the amplitude of the Fourier transform of a signal, s times its unit."""
    return np.fft.rfftfreq(PAD, DT), DT * np.abs(np.fft.rfft(signal, PAD))


@picture("input-shapes")
def shapes() -> Figure:
    """Four inputs and their spectra.

    A doublet and a 3-2-1-1 of the same step: the 3-2-1-1 spreads its power over a wider band. A multisine
    has power at its harmonics up to a limit only; a sweep from a low to a high frequency.
    """
    t = np.arange(0.0, 12.0, DT)
    multisine = Multisine.model_validate(
        {
            "control": "elevator",
            "shape": "multisine",
            "start": 1.0,
            "duration": 10.0,
            "amplitude": 1.0,
            "band": 2.0,
        }
    )
    signals = {
        "doublet": steps("doublet", 0.5).signal(t),
        "3-2-1-1": steps("3-2-1-1", 0.5).signal(t),
        "multisine": multisine.signal(t),
        "sweep": sweep(t, 0.1, 2.0, 1.0, 11.0),
    }
    figure, axes = plots(4, 2, 6.0, sharex="col", width_ratios=(1.25, 1.0))
    for (name, signal), (left, right), color in zip(signals.items(), axes, CYCLE, strict=False):
        left.plot(t, signal, color=color, linewidth=1.4)
        left.set(ylim=(-1.35, 1.35), yticks=(-1, 0, 1), xlim=(0.0, 12.0))
        left.set_title(name, color=color)
        f, size = spectrum(signal)
        shown = f < 3.2
        right.fill_between(f[shown], size[shown] / size.max(), color=color, linewidth=0.0)
        right.set(ylim=(0.0, 1.15), yticks=(0, 1), xlim=(0.0, 3.0))
    axes[0, 1].set_title("spectrum over its maximum")
    axes[3, 0].set_xlabel("time, s")
    axes[3, 1].set_xlabel("frequency, Hz")
    return figure


@picture("input-step")
def step_length() -> Figure:
    """Spectrum of a 3-2-1-1 over frequency times step.

    It keeps half of its greatest amplitude or more over a band; the mode to be excited belongs into the
    middle of it.
    """
    step = 0.4
    t = np.arange(0.0, 12.0, DT)
    figure, axes = plots(1, 1, 2.6)
    for shape, color in (("3-2-1-1", BLUE), ("doublet", ORANGE)):
        f, size = spectrum(steps(shape, step).signal(t))
        x = 2.0 * np.pi * f * step
        power = (size / size.max()) ** 2
        axes.plot(x[x < 5.0], power[x < 5.0], color=color, label=shape)
        if shape == "3-2-1-1":
            inside = x[power >= 0.5]
            axes.axvspan(inside[0], inside[-1], color=PALE_GREEN, linewidth=0.0, zorder=0.0)
            axes.text(
                0.5 * (inside[0] + inside[-1]), 1.09, "half of the power or more", color=GREEN, ha="center"
            )
    axes.plot([1.6, 1.6], [0.0, 1.0], color=GREEN, linewidth=1.2, linestyle=(0, (4, 2)))
    axes.text(1.66, 0.05, "the mode here", color=GREEN)
    axes.set(
        xlabel="natural frequency of the mode (rad/s) times step (s)",
        ylabel="power",
        xlim=(0.0, 5.0),
        ylim=(0.0, 1.22),
    )
    axes.legend(loc="upper right", bbox_to_anchor=(1.0, 0.9))
    return figure


@picture("input-orthogonal")
def orthogonal() -> Figure:
    """Harmonics of the multisines of three controls that are moved at once.

    Each has every third harmonic, so none is shared.
    """
    figure, (left, right) = plots(1, 2, 2.6, width_ratios=(1.3, 1.0))
    t = np.arange(0.0, 10.0, DT)
    for i, (control, color) in enumerate((("elevator", BLUE), ("aileron", ORANGE), ("rudder", GREEN))):
        table = {
            "control": control, "shape": "multisine", "start": 0.0, "duration": 10.0, "amplitude": 1.0, "band": 2.0,
            "first": i + 1, "stride": 3,
        }  # fmt: skip
        signal = Multisine.model_validate(table).signal(t)
        left.plot(t, signal + 2.4 * (1 - i), color=color, linewidth=1.2)
        size = np.abs(np.fft.rfft(signal)) / len(t) * 2.0
        f = np.fft.rfftfreq(len(t), DT)
        own = size > 1e-3
        right.vlines(f[own], 0.0, size[own], color=color, linewidth=3.0, label=control)
    left.set(
        xlabel="time, s",
        yticks=(2.4, 0.0, -2.4),
        yticklabels=("elevator", "aileron", "rudder"),
        xlim=(0.0, 10.0),
        ylim=(-3.7, 3.7),
    )
    right.set(xlabel="frequency, Hz", ylabel="amplitude", ylim=(0.0, 0.62), xlim=(0.0, 2.1))
    right.legend(loc="upper right", ncols=2, columnspacing=0.8, handlelength=1.0)
    return figure


@picture("input-by-voice")
def by_voice() -> Figure:
    """A 3-2-1-1 counted aloud.

    Three counts up, two down, one up, one down, then hands off; below, what the stick of a pilot does,
    with rounded corners and uneven steps. Its spectrum serves as well.
    """
    t = np.arange(0.0, 6.5, DT)
    count = 0.5
    ideal = steps("3-2-1-1", count).signal(t)
    edges = np.array([1.03, 2.62, 3.55, 4.12, 4.71])
    levels = np.array([0.0, 0.95, -1.08, 0.9, -1.12, 0.0])
    flown = first_order_lag(levels[np.searchsorted(edges, t)], 0.07, DT)
    figure, axes = plots(1, 1, 2.7)
    axes.plot(t, ideal, color=INK, linewidth=1.2, label="ideal")
    axes.plot(t, flown, color=BLUE, label="flown by hand")
    begin = 1.0
    for counts, sign in ((3, 1), (2, -1), (1, 1), (1, -1)):
        for k in range(counts):
            axes.text(
                begin + (k + 0.5) * count,
                1.28 * sign,
                str(k + 1),
                ha="center",
                va="center",
                color=ORANGE,
                weight="bold",
            )
        begin += counts * count
    axes.text(5.55, 0.16, "hands off", ha="center", color=ORANGE)
    axes.text(0.5, 0.16, "steady", ha="center", color=ORANGE)
    axes.set(xlabel="time, s", ylabel="stick", xlim=(0.0, 6.5), ylim=(-1.6, 1.75), yticks=(-1, 0, 1))
    axes.legend(loc="upper right", ncols=2)
    return figure


@picture("input-amplitude")
def amplitude() -> Figure:
    """The band between too small and too large.

    An amplitude must lift the response out of noise and gusts, and stay where the model is valid. Between
    the two the error of an estimate is smallest.
    """
    x = np.linspace(0.02, 1.0, 200)
    figure, axes = plots(1, 1, 2.6)
    noise, gusts, model = 0.10 / x, 0.05 / x, 0.55 * x**2.2
    whole = np.sqrt(noise**2 + gusts**2 + model**2)
    axes.axvspan(0.38, 0.72, color=PALE_GREEN, linewidth=0.0, zorder=0.0)
    axes.text(0.55, 0.06, "fly here", color=GREEN, ha="center")
    axes.plot(x, noise, color=SOFT, linestyle=(0, (4, 2)), label="noise and gusts: 1 / amplitude")
    axes.plot(x, model, color=ORANGE, linestyle=(0, (1, 1)), label="what the model leaves out")
    axes.plot(x, whole, color=BLUE, linewidth=2.2, label="error of an estimate")
    axes.set(xlabel="amplitude", ylabel="error", xlim=(0.0, 1.0), ylim=(0.0, 1.1), xticks=(), yticks=())
    axes.legend(loc="upper right")
    return figure
