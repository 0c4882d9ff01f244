"""Empirical distributions of running times: what share of all targets was reached after so many evaluations.

References
----------
Hansen, Auger, Brockhoff and Tusar (2022), Anytime performance assessment in blackbox optimization benchmarking,
IEEE Transactions on Evolutionary Computation 26, 1293-1305.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from markupsafe import Markup

from stoop.report.plots import Series, plot
from stoop_studies.compare.race import Race

BEGIN = 1.0  #: evaluation at which the axis begins
POINTS = 160  #: of a drawn distribution: finer than a line's width


def distribution(races: Sequence[Race], name: str, last: float) -> Series:
    """Return the share of (problem, seed, level) reached, a staircase from 1 to `last` evaluations."""
    times = np.sort([hit for race in races for hit in race.hits if hit is not None])
    total = sum(len(race.hits) for race in races)
    shares = np.arange(1, len(times) + 1) / max(total, 1)
    if len(times) > POINTS:
        kept = np.unique(np.rint(np.linspace(0, len(times) - 1, POINTS)).astype(int))
        times, shares = times[kept], shares[kept]
    end = shares[-1] if len(shares) else 0.0
    x = np.concatenate([[BEGIN], np.maximum(times, BEGIN), [max(last, BEGIN)]])
    return Series(name, x, np.concatenate([[0.0], shares, [end]]), "steps")


def distributions(groups: Mapping[str, Sequence[Race]], what: str, everyone: Sequence[str]) -> Markup:
    """Return the drawing of several optimizers' distributions.

    Parameters
    ----------
    groups : mapping of optimizer to its runs
    what : str, which problems
    everyone : sequence of str, all optimizers of the page: each looks the same in all of its drawings
    """
    last = max((race.evaluations for races in groups.values() for race in races), default=10.0)
    series = [distribution(races, name, last) for name, races in groups.items()]
    return plot(
        series,
        "evaluations",
        "share of targets reached",
        f"Share of all targets reached against evaluations on {what}, one curve an optimizer. {_ends(series)}",
        log_x=True,
        x_range=(BEGIN, max(last, 10.0)),
        y_range=(0.0, 1.0),
        looks={name: i for i, name in enumerate(everyone)},
    )


def _ends(series: Sequence[Series]) -> str:
    """Return in words where the curves end."""
    ends = ", ".join(f"{one.name} {100.0 * one.y[-1]:.0f} %" for one in series)
    return f"In the end: {ends}."
