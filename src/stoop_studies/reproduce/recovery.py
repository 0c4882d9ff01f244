"""Many parameters found again from noise-free and from noisy flights, by the default and by PS-GDE."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.parallel import Run
from stoop.report.sheet import Table
from stoop_studies.findings import Claim, Results, Setting, counted, holds, number
from stoop_studies.problems import pose
from stoop_studies.reproduce.estimates import Group, bound_deviations
from stoop_studies.reproduce.suite import minus, search_run

METHODS: Final = {"default": "ps-gde-lm", "PS-GDE": "ps-gde"}
STOP: Final = 2000  #: generations of PS-GDE; the default ends by itself
EXACT: Final = 1e-3  #: of the standard deviation that noise would cause: nothing that anybody could measure
HEAD: Final = (
    "method", "noise", "seed", "parameter", "truth", "estimate", "deviation_bound", "cost", "evaluations",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Recovery:
    """Estimates of both methods.

    Attributes
    ----------
    parameters : tuple of str
    truth, sigma : (D,)
        True values, and the Cramer-Rao bound's standard deviations.
    clean, noisy : dict
        Method -> its runs without and with noise.
    """

    parameters: tuple[str, ...]
    truth: FloatArray
    sigma: FloatArray
    clean: dict[str, Group]
    noisy: dict[str, Group]

    def scores(self, method: str) -> FloatArray:
        """Return errors (n, D) with noise, in standard deviations of the bound."""
        return np.asarray((self.noisy[method].values - self.truth) / self.sigma)


def runs(problem: str, setting: Setting) -> list[Run]:
    """Return every method and seed, with and without noise; with noise in box W, which does not cut the scatter off."""
    return [
        search_run(
            _key(method, noise, seed),
            METHODS[method],
            f"{problem}+noise" if noise else problem,
            seed,
            STOP if method == "PS-GDE" else None,
            box="W" if noise else setting.box,
        )
        for method in METHODS
        for noise in (False, True)
        for seed in setting.seeds
    ]


def _key(method: str, noise: bool, seed: int) -> str:
    return f"recovery/{METHODS[method]}/{'noise' if noise else 'clean'}/{seed:06d}"


def recovery(problem: str, setting: Setting, results: Results) -> Recovery:
    """Return the estimates of both methods."""
    posed = pose(problem, setting.seed, box=setting.box)
    assert posed.truth is not None  # noqa: S101 - these problems know it
    clean, noisy = (
        {
            m: Group.of(m, None, posed.truth, [results[_key(m, noise, s)] for s in setting.seeds])
            for m in METHODS
        }
        for noise in (False, True)
    )
    return Recovery(posed.parameters, posed.truth, bound_deviations(posed), clean, noisy)


def claims(found: Recovery) -> list[Claim]:
    """Return what is to be said about it."""
    return [_exact(found, m) for m in METHODS] + [_efficient(found, m) for m in METHODS]


def _exact(found: Recovery, method: str) -> Claim:
    errors = found.clean[method].errors
    many = int((errors * np.abs(found.truth) / found.sigma <= EXACT).all(axis=1).sum())
    spent = np.median(found.clean[method].evaluations)
    return holds(
        f"{method}: all {errors.shape[1]} values without noise, to a thousandth of what noise would change, in every run",
        many == len(errors),
        f"{counted(many, len(errors))}, largest relative error {number(float(errors.max()), 2)}, "
        f"median {spent:.0f} evaluations",
    )


def _efficient(found: Recovery, method: str) -> Claim:
    z = found.scores(method)
    band = 3.0 * np.sqrt(1.0 / (2.0 * z.size))
    ratio = float(np.sqrt(np.mean(z**2)))
    return holds(
        f"{method}: errors with noise as large as the Cramer-Rao bound says",
        abs(ratio - 1.0) <= band,
        f"root mean square {number(ratio, 4)} of the bound over {z.size} estimates; 1 ± {band:.3f} if independent",
    )


def table(found: Recovery) -> Table:
    """Return errors by parameter."""
    columns = {
        "parameter": list(found.parameters),
        "truth": [number(float(v), 6) for v in found.truth],
        "bound": [f"{100.0 * s / abs(t):.2f} %" for s, t in zip(found.sigma, found.truth, strict=True)],
    }
    for method in METHODS:
        z, errors = found.scores(method), found.clean[method].errors
        columns |= {
            f"{method}: largest error without noise": [number(float(v), 2) for v in errors.max(axis=0)],
            f"{method}: scatter over bound": [number(float(v)) for v in np.sqrt(np.mean(z**2, axis=0))],
            f"{method}: bias over bound": [minus(f"{v:+.2f}") for v in z.mean(axis=0)],
        }
    words = (
        "Errors without noise are relative; the bound is the standard deviation that noise must cause (Cramer-Rao). "
        "Noisy runs search box W, whose bounds do not cut the scatter off"
    )
    return Table(words, tuple(columns), tuple(zip(*columns.values(), strict=True)))


def rows(found: Recovery, seeds: Sequence[int]) -> list[tuple[Cell, ...]]:
    """Return every estimate."""
    return [
        (METHODS[method], noise, seed, name, t, float(v), s, float(cost), float(spent))
        for method in METHODS
        for noise, g in ((False, found.clean[method]), (True, found.noisy[method]))
        for seed, values, cost, spent in zip(seeds, g.values, g.costs, g.evaluations, strict=True)
        for name, t, v, s in zip(
            found.parameters, found.truth.tolist(), values, found.sigma.tolist(), strict=True
        )
    ]
