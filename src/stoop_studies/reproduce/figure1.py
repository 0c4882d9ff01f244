"""Figure 1: the logistic map, and what it is worth as a first population."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.operators import latin_hypercube
from stoop.report.plots import Series, plot
from stoop.report.sheet import Figure, Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, number, reproduces
from stoop_studies.optimizers.pieces.operators import chaos, uniform

MEMBERS: Final = 50
DIMENSION: Final = 10
POINTS: Final = 2000  #: of the long orbit
BINS: Final = 40
PROBES: Final = 500  #: random places whose nearest member is sought
STARTS: Final[dict[str, Callable[[int, int, np.random.Generator], FloatArray]]] = {
    "chaos": chaos,
    "uniform": uniform,
    "Latin hypercube": latin_hypercube,
}
LEAD: Final = """\
The paper starts its population with successive iterates of c -> 4 c (1 - c), one orbit for each parameter, so that \
members lie evenly over the box and some lie near the optimum. The map does visit everything, but not evenly: its \
iterates crowd at both ends, by the arcsine law 1 / (pi sqrt(c (1 - c))), and each one follows from the one before."""
WORDS: Final = """\
Lower is better in all three columns. The discrepancy (centered, L2) is how far the share of members in boxes \
departs from the boxes' volume. The distance is from a random place to the nearest member, in the unit box. The \
slices are those of a tenth of each parameter that hold no member. The ablation (stoop reproduce ablation) shows \
what the chaotic start does to the search itself."""


@dataclass(frozen=True)
class Measures:
    """How evenly first populations lie, mean over seeds.

    Attributes
    ----------
    discrepancy : (n,), centered L2
    distance : (n,), from random places to the nearest member, unit box
    empty : (n,), share of the tenths of each variable without a member
    """

    discrepancy: FloatArray
    distance: FloatArray
    empty: FloatArray


@dataclass(frozen=True)
class Figure1:
    """The logistic map."""

    name: str = "figure1"
    runs: int = 200
    box: str = "N"
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> None:
        """Return nothing: it takes no time."""

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return orbit, histogram and evenness."""
        orbit = chaos(POINTS, 1, np.random.default_rng(setting.seed))[:, 0]
        found = {name: measured(start, setting.seeds) for name, start in STARTS.items()}
        return Findings(
            "Figure 1: the logistic map",
            LEAD,
            (_covers(orbit), _evenly(found), _near(found)),
            (
                Section("Iterates", (_orbit_figure(orbit), _histogram_figure(orbit))),
                Section("As a first population", (_measures_table(found, setting.runs), Prose(WORDS))),
            ),
            ("center", "share_of_iterates", "arcsine_law"),
            tuple(zip(*(column.tolist() for column in histogram(orbit)), strict=True)),
        )


def histogram(orbit: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return centers, shares of iterates and shares by the arcsine law of equal bins, (BINS,) each."""
    edges = np.linspace(0.0, 1.0, BINS + 1)
    law = np.diff(2.0 / np.pi * np.arcsin(np.sqrt(edges)))
    shares = np.histogram(orbit, edges)[0] / len(orbit)
    return 0.5 * (edges[1:] + edges[:-1]), shares, law


def measured(start: Callable[[int, int, np.random.Generator], FloatArray], seeds: range) -> Measures:
    """Return how evenly populations of a start lie, one per seed."""
    rows = [_measured(start(MEMBERS, DIMENSION, np.random.default_rng(s)), s) for s in seeds]
    return Measures(*np.array(rows).T)


def _measured(X: FloatArray, seed: int) -> tuple[float, float, float]:
    from scipy.stats import qmc

    places = np.random.default_rng(1_000_000 + seed).random((PROBES, X.shape[1]))
    distance = np.sqrt(((places[:, None, :] - X[None, :, :]) ** 2).sum(axis=2)).min(axis=1)
    tenths = np.minimum((X * 10.0).astype(int), 9)
    filled = sum(len(np.unique(column)) for column in tenths.T)
    return float(qmc.discrepancy(X, method="CD")), float(distance.mean()), 1.0 - filled / (10.0 * X.shape[1])


def _covers(orbit: FloatArray) -> Claim:
    empty = int((histogram(orbit)[1] == 0.0).sum())
    return reproduces(
        "The map wanders over the whole of [0, 1]",
        empty == 0,
        f"{POINTS} iterates, {empty} of {BINS} bins empty",
    )


def _evenly(found: dict[str, Measures]) -> Claim:
    d = {name: float(m.discrepancy.mean()) for name, m in found.items()}
    return reproduces(
        "Members of a chaotic start lie more evenly than uniform random ones",
        d["chaos"] < d["uniform"],
        "discrepancy " + ", ".join(f"{name} {number(v)}" for name, v in d.items()),
    )


def _near(found: dict[str, Measures]) -> Claim:
    d = {name: float(m.distance.mean()) for name, m in found.items()}
    return reproduces(
        "A chaotic start puts members nearer to an optimum that may be anywhere",
        d["chaos"] < d["uniform"],
        "mean distance to the nearest of 50, " + ", ".join(f"{name} {number(v)}" for name, v in d.items()),
    )


def _orbit_figure(orbit: FloatArray) -> Figure:
    first = orbit[:300]
    drawing = plot(
        [Series("iterates", np.arange(1.0, len(first) + 1.0), first, "points")],
        "iterate", "c", "300 iterates of the logistic map", y_range=(-0.03, 1.03),
    )  # fmt: skip
    return Figure("The paper's picture: iterates of one orbit", drawing)


def _histogram_figure(orbit: FloatArray) -> Figure:
    center, share, law = histogram(orbit)
    left = center - 0.5 / BINS
    edges = np.append(left, 1.0)
    drawing = plot(
        [
            Series(f"{POINTS} iterates", edges, np.append(share, share[-1]) * BINS, "steps"),
            Series("arcsine law", center, law * BINS),
            Series("evenly", np.array([0.0, 1.0]), np.ones(2)),
        ],
        "c", "density", "Histogram of the iterates against the arcsine law", x_range=(0.0, 1.0),
    )  # fmt: skip
    return Figure("Where the iterates are", drawing)


def _measures_table(found: dict[str, Measures], runs: int) -> Table:
    head = ("start", "discrepancy", "mean distance", "empty tenths")
    rows = tuple(
        (
            name,
            number(float(m.discrepancy.mean())),
            number(float(m.distance.mean()), 4),
            f"{100.0 * m.empty.mean():.1f} %",
        )
        for name, m in found.items()
    )
    return Table(f"{MEMBERS} members, {DIMENSION} parameters; mean over {runs} seeds", head, rows)
