"""What error bars mean: repeated intervals, priors, correlations, color of residuals, profiles, horizons."""

from __future__ import annotations

from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse
from scipy.optimize import least_squares
from scipy.signal import lfilter
from scipy.stats import norm

from pictures.registry import picture
from pictures.sketch import BLUE, FAINT, GREEN, ORANGE, PALE_BLUE, PALE_GREEN, PALE_ORANGE, RED, SOFT, plots
from stoop.base.arrays import FloatArray
from stoop.simulation.maneuver import Steps

DT: Final = 0.02  #: s
TRUTH: Final = np.array([-4.0, 30.0])  #: damping, 1/s, and effectiveness, 1/s2, of a roll


def roll_rate(damping: float, effectiveness: float, aileron: FloatArray) -> FloatArray:
    """Return the roll rate of p' = damping p + effectiveness aileron, which is held between samples."""
    decay = np.exp(damping * DT)
    gain = effectiveness * (decay - 1.0) / damping
    out: FloatArray = lfilter([0.0, gain], [1.0, -decay], aileron)
    return out


def doublet(step: float = 0.4) -> FloatArray:
    """Return an aileron doublet."""
    table = {"control": "aileron", "shape": "doublet", "start": 0.4, "step": step, "amplitude": 0.05}
    return Steps.model_validate(table).signal(np.arange(0.0, 2.4, DT))


def fitted(measured: FloatArray, aileron: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return damping and effectiveness by output error, and their covariance (2, 2) by Cramer and Rao."""
    found = least_squares(lambda x: roll_rate(*x, aileron) - measured, TRUTH, x_scale=np.abs(TRUTH))
    variance = 2.0 * found.cost / (len(measured) - 2)
    return found.x, variance * np.linalg.inv(found.jac.T @ found.jac)


@picture("coverage")
def coverage() -> Figure:
    """The damping in roll from a hundred simulated flights that differ by the noise alone, each with its 95 % interval.

    The intervals scatter about the true value; about five in a hundred miss it.
    """
    rng = np.random.default_rng(11)
    aileron = doublet()
    true = roll_rate(*TRUTH, aileron)
    figure, axes = plots(1, 1, 2.8)
    axes.axhline(TRUTH[0], color=GREEN, linewidth=1.6)
    missed = 0
    for k in range(100):
        x, P = fitted(true + 0.03 * rng.standard_normal(len(true)), aileron)
        half = 1.96 * np.sqrt(P[0, 0])
        outside = abs(x[0] - TRUTH[0]) > half
        missed += outside
        axes.plot(
            [k, k],
            [x[0] - half, x[0] + half],
            color=RED if outside else BLUE,
            linewidth=2.6 if outside else 1.3,
        )
        axes.plot([k], [x[0]], ".", color=RED if outside else BLUE, markersize=3.5)
    axes.text(99.5, TRUTH[0] + 0.95, f"{missed} of 100 miss the truth", color=RED, ha="right")
    axes.text(0.0, TRUTH[0] + 0.95, "truth", color=GREEN)
    axes.set(
        xlabel="flight",
        ylabel="damping in roll, 1/s",
        xlim=(-1.5, 101.0),
        ylim=(TRUTH[0] - 1.15, TRUTH[0] + 1.2),
    )
    axes.grid(visible=False, axis="x")
    return figure


@picture("prior-data-posterior")
def prior_data_posterior() -> Figure:
    """Three bell curves of one derivative.

    What was known before the flight, what the flight says, and both together, which is narrower than
    either and lies between them.
    """
    x = np.linspace(-32.0, 6.0, 400)
    prior, data = (-12.0, 5.0), (-19.0, 3.5)
    weight = 1.0 / prior[1] ** 2, 1.0 / data[1] ** 2
    both = (weight[0] * prior[0] + weight[1] * data[0]) / sum(weight), sum(weight) ** -0.5
    figure, axes = plots(1, 1, 2.6)
    for (mean, std), color, fill, name, y in (
        (prior, ORANGE, PALE_ORANGE, "prior\n$-12 \\pm 5$", 0.083),
        (data, BLUE, PALE_BLUE, "flight\n$-19 \\pm 3.5$", 0.118),
        (both, GREEN, PALE_GREEN, f"posterior\n${both[0]:.1f} \\pm {both[1]:.1f}$", 0.147),
    ):
        density = norm.pdf(x, mean, std)
        axes.fill_between(x, density, color=fill, linewidth=0.0, zorder=1.0)
        axes.plot(x, density, color=color)
        side = {"prior": (-6.2, "left"), "fligh": (-24.3, "right"), "poste": (-13.6, "left")}[name[:5]]
        axes.text(side[0], y, name, color=color, ha=side[1], va="center")
    axes.set(xlabel="$C_{mq}$", yticks=(), xlim=(-32.0, 6.0), ylim=(0.0, 0.17))
    axes.spines["left"].set_visible(False)
    return figure


@picture("correlated-estimates")
def correlated() -> Figure:
    """Estimates of two correlated parameters and their 95 % ellipse.

    With the other parameter known, the interval of one is narrow; with the other unknown it is as wide as
    the whole ellipse.
    """
    rng = np.random.default_rng(5)
    r = 0.92
    P = np.array([[1.0, r], [r, 1.0]])
    drawn = rng.multivariate_normal((0.0, 0.0), P, 400)
    figure, axes = plots(1, 1, 3.3, width=4.2)
    axes.plot(*drawn.T, ".", color=FAINT, markersize=3.5)
    values, vectors = np.linalg.eigh(P)
    size = 2.0 * np.sqrt(5.991 * values)
    angle = np.degrees(np.arctan2(*vectors[::-1, 1]))
    axes.add_patch(
        Ellipse((0.0, 0.0), size[1], size[0], angle=angle, facecolor="none", edgecolor=BLUE, linewidth=1.8)
    )
    alone, whole = 1.96 * np.sqrt(1.0 - r**2), 1.96
    for half, y, color, text in ((whole, -3.0, BLUE, "as it is"), (alone, -2.35, ORANGE, "the other known")):
        axes.plot([-half, half], [y, y], color=color, linewidth=2.4)
        axes.text(half + 0.15, y, text, color=color, va="center")
    axes.set(
        xlabel="error of one, standard errors", ylabel="error of the other", xlim=(-3.4, 3.9), ylim=(-3.5, 3.2), aspect="equal"
    )  # fmt: skip
    return figure


@picture("colored-residuals")
def colored() -> Figure:
    """Two series of residuals of the same size and their autocorrelations.

    White residuals do not know of each other; those of real flights stay on one side for tens of samples,
    so that they count as far fewer.
    """
    rng = np.random.default_rng(2)
    count, memory = 400, 0.95
    white = rng.standard_normal(count)
    color = lfilter([np.sqrt(1.0 - memory**2)], [1.0, -memory], rng.standard_normal(count + 200))[200:]
    figure, axes = plots(2, 2, 3.4, sharex="col", sharey="col", width_ratios=(1.6, 1.0))
    lags = np.arange(61)
    for (left, right), series, paint, name, count_as in (
        (axes[0], white, BLUE, "white", count),
        (axes[1], color, ORANGE, "colored", count * (1.0 - memory) / (1.0 + memory)),
    ):
        left.plot(DT * np.arange(count), series, color=paint, linewidth=0.9)
        left.set_title(f"{name}: {count} samples count as {count_as:.0f}", color=paint)
        left.set(ylim=(-3.6, 3.6), xlim=(0.0, count * DT), ylabel="residual")
        scatter = series - series.mean()
        correlation = [float(scatter[: count - k] @ scatter[k:] / (scatter @ scatter)) for k in lags]
        right.vlines(lags, 0.0, correlation, color=paint, linewidth=1.6)
        right.set(ylim=(-0.35, 1.1), xlim=(-1.0, 60.0), ylabel="correlation")
    axes[1, 0].set_xlabel("time, s")
    axes[1, 1].set_xlabel("lag, samples")
    return figure


@picture("profile-likelihood")
def profile() -> Figure:
    """The rise of the cost over one parameter, all others refitted.

    A parabola gives an interval that is as long to the left as to the right; the profile rises slowly to
    one side, and its interval is longer there.
    """
    x = np.linspace(-4.0, 8.0, 400)
    parabola = x**2
    rise = (np.expm1(-0.22 * x) / 0.22) ** 2
    figure, axes = plots(1, 1, 2.8)
    axes.plot(
        x, parabola, color=SOFT, linestyle=(0, (4, 2)), linewidth=1.4, label="parabola: corrected error bars"
    )
    axes.plot(x, rise, color=BLUE, label="profile")
    axes.axhline(3.84, color=ORANGE, linewidth=1.2)
    axes.text(7.9, 4.25, "95 %: 3.84", color=ORANGE, ha="right")
    for curve, color, y in ((parabola, SOFT, 0.5), (rise, BLUE, 1.4)):
        inside = x[curve <= 3.84]
        axes.plot([inside[0], inside[-1]], [y, y], color=color, linewidth=3.0)
    axes.set(
        xlabel="parameter minus its estimate, standard errors",
        ylabel="rise of the cost",
        xlim=(-3.0, 8.0),
        ylim=(0.0, 16.0),
    )
    axes.legend(loc="upper center", bbox_to_anchor=(0.31, 1.02))
    return figure


@picture("horizon-ladder")
def ladder() -> Figure:
    """The cost over the frequency of an oscillation for records of 1, 3 and 10 s.

    The longer the record, the narrower the valley of the true value and the more false valleys beside it;
    the search therefore begins on a short part.
    """
    frequency = np.linspace(1.0, 7.0, 500)
    figure, axes = plots(1, 1, 2.7)
    for horizon, color in ((1.0, GREEN), (3.0, ORANGE), (10.0, BLUE)):
        t = np.arange(0.0, horizon, 0.02)
        true = np.exp(-0.1 * t) * np.sin(4.0 * t)
        cost = np.array([np.mean((np.exp(-0.1 * t) * np.sin(f * t) - true) ** 2) for f in frequency])
        axes.plot(frequency, cost / cost.max(), color=color, label=f"{horizon:g} s")
    axes.axvline(4.0, color=SOFT, linewidth=0.9, linestyle=(0, (4, 2)))
    axes.text(4.06, 1.04, "truth", color=SOFT)
    axes.set(xlabel="frequency of the model, rad/s", ylabel="cost", xlim=(1.0, 7.0), ylim=(0.0, 1.13))
    axes.legend(loc="lower right", title="record")
    return figure


@picture("fit-and-noise")
def fit_and_noise() -> Figure:
    """A roll rate as measured, and the model before the fit and after it.

    Below are the residuals, which should look like noise.
    """
    rng = np.random.default_rng(8)
    aileron = doublet()
    t = DT * np.arange(len(aileron))
    measured = roll_rate(*TRUTH, aileron) + 0.015 * rng.standard_normal(len(t))
    x, _ = fitted(measured, aileron)
    figure, (above, below) = plots(2, 1, 3.3, sharex=True, height_ratios=(2.4, 1.0))
    above.plot(t, measured, ".", color=SOFT, markersize=3.5, label="measured")
    above.plot(t, roll_rate(-2.2, 18.0, aileron), color=ORANGE, linestyle=(0, (4, 2)), label="model, start")
    above.plot(t, roll_rate(*x, aileron), color=BLUE, label="model, fitted")
    above.set(ylabel="p, rad/s", ylim=(-0.34, 0.42))
    above.legend(ncols=3, loc="upper right")
    below.plot(t, measured - roll_rate(*x, aileron), color=BLUE, linewidth=0.9)
    below.set(ylabel="residual", xlabel="time, s", ylim=(-0.07, 0.07), xlim=(0.0, 2.4))
    return figure


@picture("unstable-windows")
def windows() -> Figure:
    """An unstable motion, open loop and in windows.

    Simulated open loop from a slightly wrong start, even the true model leaves the measurements within
    seconds; in windows of one second, each with its own start, it stays with them.
    """
    rng = np.random.default_rng(6)
    growth, dt = 1.3, 0.02
    t = np.arange(0.0, 5.0, dt)
    x = np.empty(len(t))
    x[0], held = 0.05, 0.0
    for k in range(len(t) - 1):
        if k % 10 == 0:
            held = -1.9 * x[k] + 0.5 * np.sin(2.2 * t[k])
        x[k + 1] = x[k] + dt * (growth * x[k] + held)
    control = np.diff(x) / dt - growth * x[:-1]
    measured = x + 0.02 * rng.standard_normal(len(t))

    def follow(first: int, last: int, start: float) -> FloatArray:
        out = np.empty(last - first)
        out[0] = start
        for k in range(first, last - 1):
            out[k - first + 1] = out[k - first] + dt * (growth * out[k - first] + control[k])
        return out

    figure, axes = plots(1, 1, 2.8)
    axes.plot(t, measured, ".", color=SOFT, markersize=2.6, label="measured")
    axes.plot(
        t,
        follow(0, len(t), x[0] + 0.006),
        color=ORANGE,
        linestyle=(0, (4, 2)),
        label="open loop, start 0.006 off",
    )
    for k in range(0, len(t), 50):
        window = follow(k, k + 50, x[k] + 0.025 * (-1) ** (k // 50))
        axes.plot(t[k : k + 50], window, color=BLUE, label=None if k else "windows of 1 s")
        axes.axvline(t[k], color=FAINT, linewidth=0.8)
    axes.set(xlabel="time, s", ylabel="pitch rate, rad/s", xlim=(0.0, 5.0), ylim=(-0.5, 2.0))
    axes.grid(visible=False, axis="x")
    axes.legend(loc="upper left")
    return figure
