"""A change of one vehicle of a fleet, and the statistic that tells it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pictures.registry import picture
from pictures.sketch import BLUE, FAINT, INK, ORANGE, plots
from stoop.fleet.changes import Readings, changes, peaks, scan, threshold

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
