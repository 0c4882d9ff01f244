"""Figure 3: the vertical response to the elevator, and the modes that it excites."""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.report.plots import Series, Strip, stacked_plots
from stoop.report.sheet import Figure, Section, Table
from stoop.simulation import Mode, linearize
from stoop.simulation.trajectories import Flown
from stoop_studies.findings import Claim, Findings, Results, Setting, holds, number, reproduces
from stoop_studies.problems.paper import SAMPLES, paper
from stoop_studies.reproduce.suite import PaperExperiment, minus, tabulated

STEP: Final = 0.3  #: s, of the 3-2-1-1
REST: Final = 10.0  #: s, where the pulse ends
DEGREES: Final = 180.0 / np.pi
LEAD: Final = """\
The aircraft starts in the paper's trimmed flight; its elevator makes the 3-2-1-1 of 0.3 s steps and 11.46 deg, a \
pulse of 3 s, and then rests for the remainder of the record. Airspeed, angle of attack, pitch rate and pitch angle \
are those of the longitudinal equations, without noise."""


class Figure3(PaperExperiment):
    """The vertical response curve."""

    name, runs = "figure3", 1

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return the curves, their extremes and the modes."""
        case = paper()
        flown = case.flown
        curves = shown(flown, case.vehicle.outputs)
        modes = {m.name: m for m in linearize(case.vehicle, flown.trim).modes}
        time = flown.time[:SAMPLES]
        return Findings(
            "Figure 3: response to the elevator",
            LEAD,
            _claims(flown, curves, modes),
            (
                Section("Curves", _curves(time, curves)),
                Section("Trim and modes", _trim_and_modes(flown, modes)),
            ),
            ("time_s", *(name.replace(", ", "_").replace("/", "_per_").replace(" ", "_") for name in curves)),
            tuple(zip(time.tolist(), *(c.tolist() for c in curves.values()), strict=True)),
        )


def shown(flown: Flown, outputs: tuple[str, ...]) -> dict[str, FloatArray]:
    """Return what the paper draws, degrees for angles: name with unit -> (n,)."""
    y = dict(zip(outputs, flown.outputs[:SAMPLES].T, strict=True))
    return {
        "elevator, deg": DEGREES * flown.inputs[:SAMPLES, 0],
        "V, m/s": y["V"],
        "alpha, deg": DEGREES * y["alpha"],
        "q, deg/s": DEGREES * y["q"],
        "theta, deg": DEGREES * y["theta"],
    }


def _claims(flown: Flown, curves: dict[str, FloatArray], modes: dict[str, Mode]) -> tuple[Claim, ...]:
    alpha, q = curves["alpha, deg"], curves["q, deg/s"]
    start, elevator = flown.trim.start, DEGREES * flown.trim.deflections["elevator"]
    thrust = next(iter(flown.trim.thrust.values()))
    short, long = modes["short period"], modes["phugoid"]
    cycle = 2.0 * np.pi / long.frequency
    rest = SAMPLES * float(flown.time[1]) - REST
    near = (
        abs(DEGREES * start["alpha"] - 5.88) < 0.01
        and abs(elevator + 1.7) < 0.05
        and abs(thrust - 220.87) < 0.05
    )
    return (
        reproduces(
            "Trim at 35 m/s: alpha 5.88 deg, elevator -1.7 deg, thrust 220.87 N",
            near,
            f"{DEGREES * start['alpha']:.3f} deg, {elevator:.3f} deg, {thrust:.2f} N; mass and area follow from it",
        ),
        reproduces(
            "The maneuver excites the short period",
            bool(np.abs(q).max() > 10.0),
            f"q reaches {np.abs(q).max():.1f} deg/s; half a cycle takes {np.pi / short.frequency:.2f} s, a step {STEP} s",
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


def _curves(time: FloatArray, curves: dict[str, FloatArray]) -> tuple[Figure, Table]:
    strips = [
        Strip(name, (Series("input" if name.startswith("elevator") else "response", time, curve),))
        for name, curve in curves.items()
    ]
    figure = Figure(
        "Elevator, airspeed, angle of attack, pitch rate, pitch angle",
        stacked_plots(strips, "time, s", "Response curves"),
    )
    extremes = tabulated(
        "Where the curves begin and how far they go",
        {
            "curve": lambda name: name,
            "start": lambda name: minus(f"{curves[name][0]:.3f}"),
            "least": lambda name: minus(f"{curves[name].min():.3f}"),
            "greatest": lambda name: minus(f"{curves[name].max():.3f}"),
        },
        curves,
    )
    return figure, extremes


def _trim_and_modes(flown: Flown, modes: dict[str, Mode]) -> tuple[Table, Table]:
    trim = flown.trim
    rows = (
        ("alpha, deg", "5.88", number(DEGREES * trim.start["alpha"], 4)),
        ("elevator, deg", "−1.7", number(DEGREES * trim.deflections["elevator"], 4)),
        ("thrust, N", "220.87", number(next(iter(trim.thrust.values())), 5)),
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
    return Table("Trim at 35 m/s and 200 m", ("", "printed", "here"), rows), linear
