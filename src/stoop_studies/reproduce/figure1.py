"""Figure 1: the logistic map, and its use as a first population."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.population import latin_hypercube
from stoop.report.plots import Series, plot
from stoop.report.sheet import Figure, Prose, Section
from stoop_studies.findings import Claim, Findings, Results, Setting, number, reproduces
from stoop_studies.optimizers.evolution import Initialization, chaos, uniform
from stoop_studies.reproduce.suite import PaperExperiment, tabulated

MEMBERS: Final = 50
DIMENSION: Final = 10
POINTS: Final = 2000  #: of the long orbit
BINS: Final = 40
PROBES: Final = 500  #: random places, for the distance to the nearest member
STARTS: Final[dict[str, Initialization]] = {
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
    """How evenly first populations lie, by seed.

    Attributes
    ----------
    discrepancy : (n,), centered L2
    distance : (n,), from random places to the nearest member, unit box
    empty : (n,), share of the tenths of each variable without a member
    """

    discrepancy: FloatArray
    distance: FloatArray
    empty: FloatArray


class Figure1(PaperExperiment):
    """The logistic map."""

    name, runs = "figure1", 200

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return orbit, histogram and evenness."""
        orbit = chaos(POINTS, 1, np.random.default_rng(setting.seed))[:, 0]
        found = {name: measured(start, setting.seeds) for name, start in STARTS.items()}
        evenness = tabulated(
            f"{MEMBERS} members, {DIMENSION} parameters; mean over {setting.runs} seeds",
            {
                "start": lambda name: name,
                "discrepancy": lambda name: number(float(found[name].discrepancy.mean())),
                "mean distance": lambda name: number(float(found[name].distance.mean()), 4),
                "empty tenths": lambda name: f"{100.0 * found[name].empty.mean():.1f} %",
            },
            found,
        )
        return Findings(
            "Figure 1: the logistic map",
            LEAD,
            _claims(orbit, found),
            (
                Section("Iterates", _figures(orbit)),
                Section("As a first population", (evenness, Prose(WORDS))),
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


def measured(start: Initialization, seeds: range) -> Measures:
    """Return how evenly populations of an initialization lie, one per seed."""
    from scipy.stats import qmc

    rows = []
    for seed in seeds:
        X = start(MEMBERS, DIMENSION, np.random.default_rng(seed))
        places = np.random.default_rng(1_000_000 + seed).random((PROBES, DIMENSION))
        distance = np.sqrt(((places[:, None, :] - X[None, :, :]) ** 2).sum(axis=2)).min(axis=1)
        filled = sum(len(np.unique(column)) for column in np.minimum((X * 10.0).astype(int), 9).T)
        empty = 1.0 - filled / (10.0 * DIMENSION)
        rows.append((float(qmc.discrepancy(X, method="CD")), float(distance.mean()), empty))
    return Measures(*np.array(rows).T)


def _claims(orbit: FloatArray, found: dict[str, Measures]) -> tuple[Claim, ...]:
    empty = int((histogram(orbit)[1] == 0.0).sum())
    discrepancy = {name: float(m.discrepancy.mean()) for name, m in found.items()}
    distance = {name: float(m.distance.mean()) for name, m in found.items()}

    def values(means: dict[str, float]) -> str:
        return ", ".join(f"{name} {number(v)}" for name, v in means.items())

    return (
        reproduces(
            "The map wanders over the whole of [0, 1]",
            empty == 0,
            f"{POINTS} iterates, {empty} of {BINS} bins empty",
        ),
        reproduces(
            "Members of a chaotic start lie more evenly than uniform random ones",
            discrepancy["chaos"] < discrepancy["uniform"],
            f"discrepancy {values(discrepancy)}",
        ),
        reproduces(
            "A chaotic start puts members nearer to an optimum that may be anywhere",
            distance["chaos"] < distance["uniform"],
            f"mean distance to the nearest of 50, {values(distance)}",
        ),
    )


def _figures(orbit: FloatArray) -> tuple[Figure, Figure]:
    first = orbit[:300]
    iterates = plot(
        [Series("iterates", np.arange(1.0, len(first) + 1.0), first, "points")],
        "iterate", "c", "300 iterates of the logistic map", y_range=(-0.03, 1.03),
    )  # fmt: skip
    center, share, law = histogram(orbit)
    edges = np.append(center - 0.5 / BINS, 1.0)
    density = plot(
        [
            Series(f"{POINTS} iterates", edges, np.append(share, share[-1]) * BINS, "steps"),
            Series("arcsine law", center, law * BINS),
            Series("evenly", np.array([0.0, 1.0]), np.ones(2)),
        ],
        "c", "density", "Histogram of the iterates against the arcsine law", x_range=(0.0, 1.0),
    )  # fmt: skip
    return Figure("The paper's picture: iterates of one orbit", iterates), Figure(
        "Where the iterates are", density
    )
