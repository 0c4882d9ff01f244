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
from stoop_studies.reproduce.bound import deviations
from stoop_studies.reproduce.plans import searched

METHODS: Final = {"default": "ps-gde-lm", "PS-GDE": "ps-gde"}
STOP: Final = 2000  #: generations of PS-GDE; the default ends by itself
EXACT: Final = 1e-3  #: of the standard deviation that noise would cause: nothing that anybody could measure
HEAD: Final = (
    "method", "noise", "seed", "parameter", "truth", "estimate", "deviation_bound", "cost", "evaluations",
)  # fmt: skip


@dataclass(frozen=True, eq=False)
class Recovered:
    """What one method found.

    Attributes
    ----------
    method : str
    noise : bool
    values : (n, D)
    costs, evaluations : (n,)
    """

    method: str
    noise: bool
    values: FloatArray
    costs: FloatArray
    evaluations: FloatArray


@dataclass(frozen=True, eq=False)
class Recovery:
    """What both found.

    Attributes
    ----------
    parameters : tuple of str
    truth, sigma : (D,)
        True values, and the Cramer-Rao bound's standard deviations.
    found : tuple of Recovered
    """

    parameters: tuple[str, ...]
    truth: FloatArray
    sigma: FloatArray
    found: tuple[Recovered, ...]

    def of(self, method: str, noise: bool) -> Recovered:
        """Return what one method found."""
        return next(r for r in self.found if (r.method, r.noise) == (method, noise))

    def errors(self, method: str) -> FloatArray:
        """Return relative errors (n, D) without noise."""
        return np.asarray(np.abs(self.of(method, False).values / self.truth - 1.0))

    def scores(self, method: str) -> FloatArray:
        """Return errors (n, D) with noise, in standard deviations of the bound."""
        return np.asarray((self.of(method, True).values - self.truth) / self.sigma)


def runs(problem: str, setting: Setting) -> list[Run]:
    """Return every method and seed, with and without noise."""
    return [
        _run(problem, method, noise, s, setting.box)
        for method in METHODS
        for noise in (False, True)
        for s in setting.seeds
    ]


def recovery(problem: str, setting: Setting, results: Results) -> Recovery:
    """Return what they found."""
    posed = pose(problem, setting.seed, box=setting.box)
    assert posed.truth is not None  # noqa: S101 - these problems know it
    found = []
    for method in METHODS:
        for noise in (False, True):
            told = [results[_key(method, noise, s)] for s in setting.seeds]
            columns = [np.array([t[c] for t in told], dtype=float) for c in ("values", "cost", "evaluations")]
            found.append(Recovered(method, noise, *columns))
    return Recovery(posed.parameters, posed.truth, deviations(posed), tuple(found))


def _run(problem: str, method: str, noise: bool, seed: int, box: str) -> Run:
    """Return one search; with noise in box W, whose bounds do not cut the scatter off."""
    key, where = _key(method, noise, seed), "W" if noise else box
    return searched(key, METHODS[method], _name(problem, noise), seed, _stop(method), box=where)


def _name(problem: str, noise: bool) -> str:
    return f"{problem}+noise" if noise else problem


def _key(method: str, noise: bool, seed: int) -> str:
    return f"recovery/{METHODS[method]}/{'noise' if noise else 'clean'}/{seed:06d}"


def _stop(method: str) -> int | None:
    return STOP if method == "PS-GDE" else None


def claims(found: Recovery) -> list[Claim]:
    """Return what is to be said about it."""
    return [_exact(found, m) for m in METHODS] + [_efficient(found, m) for m in METHODS]


def _exact(found: Recovery, method: str) -> Claim:
    errors = found.errors(method)
    many = int((errors * np.abs(found.truth) / found.sigma <= EXACT).all(axis=1).sum())
    spent = np.median(found.of(method, False).evaluations)
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
    head = ["parameter", "truth", "bound"]
    columns: list[list[str]] = []
    for method in METHODS:
        head += [
            f"{method}: largest error without noise",
            f"{method}: scatter over bound",
            f"{method}: bias over bound",
        ]
        z = found.scores(method)
        columns.append([number(float(v), 2) for v in found.errors(method).max(axis=0)])
        columns.append([number(float(v)) for v in np.sqrt(np.mean(z**2, axis=0))])
        columns.append([f"{v:+.2f}".replace("-", "−") for v in z.mean(axis=0)])
    rows = zip(
        found.parameters,
        [number(float(v), 6) for v in found.truth],
        [f"{100.0 * s / abs(t):.2f} %" for s, t in zip(found.sigma, found.truth, strict=True)],
        *columns,
        strict=True,
    )
    words = (
        "Errors without noise are relative; the bound is the standard deviation that noise must cause (Cramer-Rao). "
        "Noisy runs search box W, whose bounds do not cut the scatter off"
    )
    return Table(words, tuple(head), tuple(rows))


def rows(found: Recovery, seeds: Sequence[int]) -> list[tuple[Cell, ...]]:
    """Return every estimate."""
    return [
        (METHODS[r.method], r.noise, seed, name, t, float(v), s, float(cost), float(spent))
        for r in found.found
        for seed, values, cost, spent in zip(seeds, r.values, r.costs, r.evaluations, strict=True)
        for name, t, v, s in zip(
            found.parameters, found.truth.tolist(), values, found.sigma.tolist(), strict=True
        )
    ]
