"""Figure 3: the response to the elevator and its modes."""

from __future__ import annotations

from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.report.plots import stacked_plots
from stoop.report.series import Series, Strip
from stoop.report.sheet import Figure, Table
from stoop.simulation import Mode, linearize
from stoop.simulation.trim import Flown
from stoop_studies.findings import Claim, Findings, Results, Setting, holds, number, reproduces, table_of
from stoop_studies.problems.paper import SAMPLES, paper
from stoop_studies.reproduce.suite import PaperExperiment

REST: Final = 10.0  #: s, where the pulse ends
DEGREES: Final = 180.0 / np.pi


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
        linear = [
            {
                "mode": m.name,
                "frequency, rad/s": f"{m.frequency:.3f}",
                "damping ratio": f"{m.damping:.3f}",
                "period, s": f"{2 * np.pi / m.frequency:.2f}",
            }
            for m in modes.values()
        ]
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
        shown, claims = (
            (figure, trim, table_of("Linear modes about the trim", linear)),
            _response_claims(flown, curves, modes),
        )
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
