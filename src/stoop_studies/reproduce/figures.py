"""Figures 1 and 3: the logistic map and its use as a first population; the response to the elevator and its modes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize.population import MEMBERS, latin_hypercube
from stoop.report.plots import plot, stacked_plots
from stoop.report.series import Series, Strip
from stoop.report.sheet import Figure, Table
from stoop.simulation import Mode, linearize
from stoop.simulation.trajectories import Flown
from stoop_studies.findings import Claim, Findings, Results, Setting, holds, number, reproduces, tabulated
from stoop_studies.optimizers.evolution import Initialization, chaos, uniform
from stoop_studies.problems.paper import SAMPLES, paper
from stoop_studies.reproduce.suite import PaperExperiment

DIMENSION: Final = 10
POINTS: Final = 2000  #: of the long orbit
BINS: Final = 40
STARTS: Final[dict[str, Initialization]] = {
    "chaos": chaos,
    "uniform": uniform,
    "Latin hypercube": latin_hypercube,
}
REST: Final = 10.0  #: s, where the pulse ends
DEGREES: Final = 180.0 / np.pi


@dataclass(frozen=True)
class Measures:
    """How evenly first populations lie, by seed, (n,) each."""

    discrepancy: FloatArray  #: centered L2
    distance: FloatArray  #: from random places to the nearest member, unit box
    empty: FloatArray  #: share of the tenths of each variable without a member


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
        places = np.random.default_rng(1_000_000 + seed).random((500, DIMENSION))
        distance = np.sqrt(((places[:, None, :] - X[None, :, :]) ** 2).sum(axis=2)).min(axis=1)
        filled = sum(len(np.unique(column)) for column in np.minimum((X * 10.0).astype(int), 9).T)
        empty = 1.0 - filled / (10.0 * DIMENSION)
        rows.append((float(qmc.discrepancy(X, method="CD")), float(distance.mean()), empty))
    return Measures(*np.array(rows).T)


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
        empty = int((histogram(orbit)[1] == 0.0).sum())
        discrepancy = {name: float(m.discrepancy.mean()) for name, m in found.items()}
        distance = {name: float(m.distance.mean()) for name, m in found.items()}

        def values(means: dict[str, float]) -> str:
            return ", ".join(f"{name} {number(v)}" for name, v in means.items())

        claims = (
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
        columns = (column.tolist() for column in histogram(orbit))
        rows = [
            dict(zip(("center", "share_of_iterates", "arcsine_law"), r, strict=True))
            for r in zip(*columns, strict=True)
        ]
        return Findings.of(
            "Figure 1: the logistic map", claims, rows, figures=(*_orbit_figures(orbit), evenness)
        )


def _orbit_figures(orbit: FloatArray) -> tuple[Figure, Figure]:
    first = orbit[:300]
    iterates = plot(
        [Series("iterates", np.arange(1.0, len(first) + 1.0), first, "points")],
        "iterate", "c", "300 iterates of the logistic map", y_range=(-0.03, 1.03),
    )  # fmt: skip
    center, share, law = histogram(orbit)
    edges = np.append(center - 0.5 / BINS, 1.0)
    curves = [
        Series(f"{POINTS} iterates", edges, np.append(share, share[-1]) * BINS, "steps"),
        Series("arcsine law", center, law * BINS),
        Series("evenly", np.array([0.0, 1.0]), np.ones(2)),
    ]
    caption = "Histogram of the iterates against the arcsine law"
    density = plot(curves, "c", "density", caption, x_range=(0.0, 1.0))
    return (
        Figure("The paper's picture: iterates of one orbit", iterates),
        Figure("Where the iterates are", density),
    )


class Figure3(PaperExperiment):
    """The vertical response curve."""

    name, runs = "figure3", 1

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return the curves, their extremes and the modes; degrees for angles."""
        case = paper()
        flown, time = case.flown, case.flown.time[:SAMPLES]
        y = dict(zip(case.vehicle.outputs, flown.outputs[:SAMPLES].T, strict=True))
        curves = {
            "elevator, deg": DEGREES * flown.inputs[:SAMPLES, 0],
            "V, m/s": y["V"],
            "alpha, deg": DEGREES * y["alpha"],
            "q, deg/s": DEGREES * y["q"],
            "theta, deg": DEGREES * y["theta"],
        }
        modes = {m.name: m for m in linearize(case.vehicle, flown.trim).modes}
        strips = [
            Strip(name, (Series("input" if name.startswith("elevator") else "response", time, curve),))
            for name, curve in curves.items()
        ]
        figure = Figure(
            "Elevator, airspeed, angle of attack, pitch rate, pitch angle",
            stacked_plots(strips, "time, s", "Response curves"),
        )
        linear = tabulated(
            "Linear modes about the trim",
            {
                "mode": lambda m: m.name,
                "frequency, rad/s": lambda m: f"{m.frequency:.3f}",
                "damping ratio": lambda m: f"{m.damping:.3f}",
                "period, s": lambda m: f"{2 * np.pi / m.frequency:.2f}",
            },
            modes.values(),
        )
        alpha, elevator, thrust = _trim(flown)
        printed = (
            ("alpha, deg", "5.88", number(alpha, 4)),
            ("elevator, deg", "−1.7", number(elevator, 4)),
            ("thrust, N", "220.87", number(thrust, 5)),
        )
        trim = Table("Trim at 35 m/s and 200 m", ("", "printed", "here"), printed)
        names = [name.replace(", ", "_").replace("/", "_per_").replace(" ", "_") for name in curves]
        columns = {"time_s": time, **dict(zip(names, curves.values(), strict=True))}
        rows = [
            dict(zip(columns, r, strict=True))
            for r in zip(*(c.tolist() for c in columns.values()), strict=True)
        ]
        shown, claims = (figure, trim, linear), _response_claims(flown, curves, modes)
        return Findings.of("Figure 3: response to the elevator", claims, rows, figures=shown)


def _trim(flown: Flown) -> tuple[float, float, float]:
    """Return angle of attack and elevator, deg, and thrust, N."""
    trim = flown.trim
    alpha, elevator = DEGREES * trim.start["alpha"], DEGREES * trim.deflections["elevator"]
    return alpha, elevator, next(iter(trim.thrust.values()))


def _response_claims(
    flown: Flown, curves: dict[str, FloatArray], modes: dict[str, Mode]
) -> tuple[Claim, ...]:
    alpha, q = curves["alpha, deg"], curves["q, deg/s"]
    trimmed, elevator, thrust = _trim(flown)
    half = np.pi / modes["short period"].frequency
    cycle = 2.0 * np.pi / modes["phugoid"].frequency
    rest = SAMPLES * float(flown.time[1]) - REST
    near = abs(trimmed - 5.88) < 0.01 and abs(elevator + 1.7) < 0.05 and abs(thrust - 220.87) < 0.05
    return (
        reproduces(
            "Trim at 35 m/s: alpha 5.88 deg, elevator -1.7 deg, thrust 220.87 N",
            near,
            f"{trimmed:.3f} deg, {elevator:.3f} deg, {thrust:.2f} N; mass and area follow from it",
        ),
        reproduces(
            "The maneuver excites the short period",
            bool(np.abs(q).max() > 10.0),
            f"q reaches {np.abs(q).max():.1f} deg/s; half a cycle takes {half:.2f} s, a step 0.3 s",
        ),
        reproduces(
            "About half a long-period oscillation fits behind the pulse",
            rest >= 0.5 * cycle,
            f"{rest:.0f} s of rest, a phugoid takes {cycle:.1f} s",
        ),
        holds(
            "alpha stays within 1.8 to 10.2 deg and q within 21 deg/s, where the linear coefficients may hold",
            bool(alpha.min() > 1.75 and alpha.max() < 10.25 and np.abs(q).max() < 21.5),
            f"alpha {alpha.min():.2f} to {alpha.max():.2f} deg, q {q.min():.1f} to {q.max():.1f} deg/s",
        ),
    )
