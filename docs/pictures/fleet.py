"""A change of one vehicle of a fleet, the statistic that tells it, and what its model and threshold rest on."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.stats import chi2

from pictures.registry import picture
from pictures.sketch import BLUE, FAINT, INK, ORANGE, plots
from stoop_fleet.changes import Readings, changes, peaks, scan, threshold

FLIGHTS, EXCHANGED, STEP = 60, 30, -0.025
SPREAD = 0.01  #: of vehicles
VEHICLES, DRAWS = 16, 200


@picture("fleet")
def fleet() -> Figure:
    """Thrust of one drone over sixty flights, with a step down at flight 30 where a propeller was exchanged.

    Above, the flights with their errors and the level, which steps by -0.025. Below, twice the logarithm of the likelihood
    ratio after each flight: it stays below the threshold until flight 30, and exceeds it within a few flights.
    """
    rng, at = np.random.default_rng(0), np.arange(float(FLIGHTS))
    errors = np.hypot(rng.uniform(0.005, 0.015, FLIGHTS), 0.005)
    values = errors * rng.standard_normal(FLIGHTS) + STEP * (at >= EXCHANGED)
    own = Readings.about_a_level(values, errors, at, SPREAD)
    limit = threshold(peaks(own, VEHICLES * DRAWS, rng)[1:], float(DRAWS))
    (change,) = changes(own, limit)
    figure, (above, below) = plots(2, 1, 4.4)
    above.errorbar(at, 1.0 + values, errors, fmt="o", color=INK, ecolor=FAINT, markersize=3.0)
    above.plot(at, 1.0 + change.course(at), color=BLUE, drawstyle="steps-post")
    above.axvline(change.first - 0.5, color=ORANGE)
    above.set(ylabel="thrust, relative")
    below.plot(at, scan(own).statistic[0], color=BLUE)
    below.axhline(limit, color=ORANGE, linestyle="--")
    below.set(xlabel="flight", ylabel="statistic")
    below.text(1.0, limit + 4.0, "threshold of one false alarm", color=ORANGE)
    return figure


@picture("fleet-spread")
def fleet_spread() -> Figure:
    """Logarithm of the restricted likelihood of the spread of four vehicles over the error of a mean.

    Without the penalty it falls from zero on; with it, it is highest at 0.9 of the error.
    """
    means = np.array([-0.9, -0.2, 0.4, 0.7])  # over their error
    spread = np.linspace(0.01, 3.0, 300)
    variance, degrees = spread**2 + 1.0, len(means) - 1
    plain = -0.5 * (degrees * np.log(variance) + np.sum((means - means.mean()) ** 2) / variance)
    penalized = plain + np.log(spread)
    figure, axes = plots(1, 1, 2.6)
    for curve, color, text, place in (
        (plain, ORANGE, "restricted likelihood", 1.55),
        (penalized, BLUE, "times the spread", 2.2),
    ):
        best = int(np.argmax(curve))
        axes.plot(spread, curve - curve[best], color=color)
        axes.plot(spread[best], 0.0, "o", color=color, clip_on=False)
        axes.text(place, np.interp(place, spread, curve - curve[best]) + 0.15, text, color=color)
    axes.set(
        xlabel="spread of vehicles over the error of a mean",
        ylabel="ln likelihood",
        xlim=(0, 3),
        ylim=(-3, 0.3),
    )
    return figure


@picture("fleet-threshold")
def fleet_threshold() -> Figure:
    """Share of sequences of thirty flights without a change whose largest statistic exceeds a value, on a logarithmic axis.

    The simulated share reaches five percent near 12.5 and falls exponentially from there on; chi-square of one known beginning
    reaches it at 3.8.
    """
    at, count = np.arange(30.0), 20_000
    own = Readings.about_a_level(np.zeros(30), np.ones(30), at, 1.0)
    drawn = np.sort(peaks(own, count, np.random.default_rng(0))[1:])[::-1]
    share = np.arange(1, count + 1) / count
    values = np.linspace(0.0, 24.0, 200)
    begin = float(drawn[int(0.05 * count)])
    tail = np.linspace(begin, 24.0, 50)
    excess = float(np.mean(drawn[: int(0.05 * count)] - begin))
    figure, axes = plots(1, 1, 2.8)
    axes.semilogy(drawn, share, color=BLUE)
    axes.semilogy(tail, 0.05 * np.exp(-(tail - begin) / excess), color=ORANGE, linestyle="--")
    axes.semilogy(values, chi2.sf(values, 1), color=INK, linewidth=1.0)
    axes.text(8.5, 0.4, "largest of all beginnings", color=BLUE)
    axes.text(17.5, 0.006, "exponential", color=ORANGE)
    axes.text(1.5, 0.002, "one beginning\nthat is known", color=INK)
    axes.set(xlabel="statistic", ylabel="share above", xlim=(0, 24), ylim=(3e-4, 1.2))
    return figure
