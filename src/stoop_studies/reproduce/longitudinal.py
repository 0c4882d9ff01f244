"""All 14 longitudinal terms of eq. (1), and whether the V terms catch the propulsion."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

import numpy as np

from stoop.base.csv_text import Cell
from stoop.parallel import Plan
from stoop.report.sheet import Prose, Section, Table
from stoop.workflow.demo import TABLE_1
from stoop_studies.findings import Claim, Findings, Results, Setting, number, reproduces
from stoop_studies.problems.paper import SAMPLES, paper
from stoop_studies.reproduce import propulsion, recovery
from stoop_studies.reproduce.propulsion import MODELS, TERMS, Fits, expected, thrust
from stoop_studies.reproduce.suite import PaperExperiment, minus, planned, tabulated

FITS_HEAD: Final = ("model", "noise", "seed", "cost", "largest_error", *TABLE_1, *TERMS)
LEAD: Final = """\
The paper's model has 14 longitudinal terms, its experiment identifies ten. Here all 14 are found from the same \
maneuver, the four others at values of our own that are not zero. Then the paper's reason for the V terms is tried: \
that they catch the influence of the propulsion."""
WORDS: Final = """\
The truth flies with a propeller whose thrust falls with airspeed, as at constant power; all its V terms are zero. \
Three models are fitted to that flight: one with constant thrust and no V terms, one with constant thrust and free \
V terms, and one that knows the propeller. To first order a thrust slope T' looks like CDV = -T' V* cos(alpha) / \
(qbar S) and CLV = T' V* sin(alpha) / (qbar S); what is left after that is of second order. The ten coefficients are sought in \
box W: in box N the wrong model meets a bound."""


class LongitudinalFull(PaperExperiment):
    """The longitudinal terms of eq. (1)."""

    name, runs, parts = "longitudinal-full", 20, ("propulsion",)

    def plan(self, setting: Setting) -> Plan:
        """Return all runs of both parts."""
        return planned(self.name, setting, [*recovery.runs(self.name, setting), *propulsion.runs(setting)])

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return what they show."""
        found = recovery.recovery(self.name, setting, results)
        fits = propulsion.fits(setting, results)
        return Findings(
            f"Eq. (1): all 14 longitudinal terms, box {setting.box}",
            LEAD,
            (*recovery.claims(found), *_claims(fits)),
            (
                Section("Fourteen values from one maneuver", (recovery.table(found),)),
                Section("V terms and the propulsion", (Prose(WORDS), *_tables(fits))),
            ),
            recovery.HEAD,
            tuple(recovery.rows(found, setting.seeds)),
            {"propulsion": (FITS_HEAD, tuple(_fit_rows(fits, setting)))},
        )


def _claims(fits: Mapping[str, Fits]) -> list[Claim]:
    zero, free = fits["V terms zero"], fits["V terms free"]
    share = 1.0 - free.cost / zero.cost
    wanted = expected()
    off = abs(free.clean["CDV"] / wanted["CDV"] - 1.0)
    before, after = float(np.abs(zero.errors()).max()), float(np.abs(free.errors()).max())
    return [
        reproduces(
            "The V terms catch the propulsion's dependence on airspeed",
            share > 0.9,
            f"they take up {100 * share:.1f} % of the misfit, J falls from {number(zero.cost, 4)} to {number(free.cost)}",
        ),
        reproduces(
            "What they catch is the thrust slope, within 10 % of its first-order value",
            off < 0.1,
            f"CDV {free.clean['CDV']:.4f}, expected {wanted['CDV']:.4f}; "
            f"CLV {free.clean['CLV']:.4f}, expected {wanted['CLV']:.4f}",
        ),
        reproduces(
            "They keep the propulsion out of the other coefficients",
            after < 0.2 * before,
            f"largest of ten errors {100 * after:.1f} % with them, {100 * before:.0f} % without",
        ),
    ]


def _tables(fits: Mapping[str, Fits]) -> Iterator[Table]:
    """Give misfit, V terms, and errors of the ten coefficients."""
    count = 6 * SAMPLES
    yield tabulated(
        f"What the models leave unexplained; {count} readings, so that noise alone costs about as much",
        {
            "model": lambda m: m,
            "J without noise": lambda m: number(fits[m].cost),
            "mean J with noise": lambda m: number(float(fits[m].costs.mean()), 5),
            "per reading": lambda m: f"{fits[m].costs.mean() / count:.3f}",
        },
        fits,
    )
    free, wanted = fits["V terms free"], expected()
    noisy = {n: (v.mean(), v.std(ddof=min(1, len(v) - 1))) for n, v in free.noisy.items()}
    yield tabulated(
        minus(f"What the V terms take up of a thrust slope of {thrust(35.5) - thrust(34.5):.2f} N per m/s"),
        {
            "term": lambda n: n,
            "expected": lambda n: minus(f"{wanted[n]:.4f}"),
            "without noise": lambda n: minus(f"{free.clean[n]:.4f}"),
            "with noise, mean and scatter": lambda n: minus(f"{noisy[n][0]:.4f} ± {noisy[n][1]:.4f}"),
        },
        TERMS,
    )
    columns = {"parameter": list(TABLE_1)}
    truth = np.array([fits["propeller known"].clean[n] for n in TABLE_1])
    for model in MODELS:
        estimates = np.array([fits[model].noisy[n] for n in TABLE_1])
        rms = np.sqrt(np.mean((estimates / truth[:, None] - 1.0) ** 2, axis=1))
        columns[model] = [minus(f"{100.0 * v:+.2f} %") for v in fits[model].errors()]
        columns[f"{model}, with noise"] = [f"{100.0 * v:.2f} %" for v in rms]
    words = "Errors of the ten coefficients; with noise the root mean square over seeds"
    yield Table(words, tuple(columns), tuple(zip(*columns.values(), strict=True)))


def _fit_rows(fits: Mapping[str, Fits], setting: Setting) -> Iterator[tuple[Cell, ...]]:
    """Give what is expected to first order, then one row per fit; nothing stands for what is not free."""
    wanted = expected()
    yield ("first order", None, None, None, None, *(None for _ in TABLE_1), *(wanted[n] for n in TERMS))
    for model, fit in fits.items():
        yield (model, False, setting.seed, fit.cost, *_cells(fit.clean))
        for i, (seed, cost) in enumerate(zip(setting.seeds, fit.costs, strict=True)):
            yield (model, True, seed, float(cost), *_cells({n: v[i] for n, v in fit.noisy.items()}))


def _cells(values: Mapping[str, float]) -> tuple[Cell, ...]:
    """Return the largest relative error of the ten, and all estimates."""
    estimates = [None if n not in values else float(values[n]) for n in (*TABLE_1, *TERMS)]
    off = np.array([values[n] for n in TABLE_1]) / paper().truth - 1.0
    return (float(np.abs(off).max()), *estimates)
