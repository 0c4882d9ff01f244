"""Terms of eq. (1) found again with and without noise, and models fitted to flights that break one of their assumptions."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.parallel import Run
from stoop.problem import Misfit
from stoop_studies.findings import Claim, Results, Setting, counted, holds, number
from stoop_studies.problems import pose
from stoop_studies.reproduce.suite import METHODS, Group, PaperExperiment, Searches, bound_deviations, rms

#: generations of each method; the default ends by itself
STOPS: Final[Mapping[str, tuple[int | None]]] = {"default": (None,), "PS-GDE": (2000,)}


def recovery_searches(problem: str, setting: Setting) -> dict[bool, Searches]:
    """Return the searches without noise and with it; with noise in box W, which does not cut the scatter off."""
    return {
        noise: Searches(
            f"recovery/{{who}}/{'noise' if noise else 'clean'}/{{seed:06d}}",
            f"{problem}+noise" if noise else problem,
            setting.seeds,
            STOPS,
            {"box": "W" if noise else setting.box},
        )
        for noise in (False, True)
    }


@dataclass(frozen=True, eq=False)
class Recovery:
    """Estimates of both methods of the parameters of a problem, whose truth and Cramer-Rao bound are (D,)."""

    parameters: tuple[str, ...]
    truth: FloatArray
    sigma: FloatArray
    groups: dict[tuple[str, bool], Group]  #: method and whether there is noise -> its runs

    @classmethod
    def of(cls, problem: str, setting: Setting, results: Results) -> Recovery:
        """Return the estimates of all seeds."""
        posed = pose(problem, setting.seed, box=setting.box)
        assert posed.truth is not None  # noqa: S101 - these problems know it
        found = {n: s.groups(results, posed.truth) for n, s in recovery_searches(problem, setting).items()}
        groups = {(m, noise): found[noise][m][0] for m in STOPS for noise in found}
        return cls(posed.parameters, posed.truth, bound_deviations(posed), groups)

    def scores(self, method: str) -> FloatArray:
        """Return errors (n, D) with noise, in standard deviations of the bound."""
        return np.asarray((self.groups[method, True].values - self.truth) / self.sigma)

    @property
    def claims(self) -> list[Claim]:
        """Whether values without noise are exact (to a thousandth of what noise would change), and those with it efficient."""
        exact, efficient = [], []
        for method in STOPS:
            clean, z = self.groups[method, False], self.scores(method)
            errors = clean.errors
            many = int((errors * np.abs(self.truth) / self.sigma <= 1e-3).all(axis=1).sum())
            exact.append(
                holds(
                    f"{method}: all {errors.shape[1]} values without noise, to a thousandth of what noise would change, "
                    "in every run",
                    many == len(errors),
                    f"{counted(many, len(errors))}, largest relative error {number(float(errors.max()), 2)}, "
                    f"median {np.median(clean.evaluations):.0f} evaluations",
                )
            )
            band, ratio = 3.0 * np.sqrt(1.0 / (2.0 * z.size)), float(np.sqrt(np.mean(z**2)))
            efficient.append(
                holds(
                    f"{method}: errors with noise as large as the Cramer-Rao bound says",
                    abs(ratio - 1.0) <= band,
                    f"root mean square {number(ratio, 4)} of the bound over {z.size} estimates; "
                    f"1 ± {band:.3f} if independent",
                )
            )
        return exact + efficient

    @property
    def summary(self) -> list[dict[str, Cell]]:
        """Errors by parameter: relative ones without noise, with noise in standard deviations of the Cramer-Rao bound."""
        columns: dict[str, Sequence[Any]] = {"parameter": self.parameters, "truth": self.truth.tolist()}
        columns["bound, % of the truth"] = (100.0 * self.sigma / np.abs(self.truth)).tolist()
        for method in STOPS:
            z, errors = self.scores(method), self.groups[method, False].errors
            columns[f"{method}: largest error without noise"] = errors.max(axis=0).tolist()
            columns[f"{method}: scatter over bound"] = rms(z).tolist()
            columns[f"{method}: bias over bound"] = z.mean(axis=0).tolist()
        return [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]

    def records(self, seeds: Sequence[int]) -> list[dict[str, Cell]]:
        """Return every estimate."""
        known = list(zip(self.parameters, self.truth.tolist(), self.sigma.tolist(), strict=True))
        return [
            {
                "method": METHODS[method], "noise": noise, "seed": seed, "parameter": name, "truth": truth,
                "estimate": float(value), "deviation_bound": sigma, "cost": float(cost), "evaluations": float(spent),
            }
            for (method, noise), g in self.groups.items()
            for seed, values, cost, spent in zip(seeds, g.values, g.costs, g.evaluations, strict=True)
            for (name, truth, sigma), value in zip(known, values, strict=True)
        ]  # fmt: skip


@dataclass(frozen=True, eq=False)
class Fits:
    """Fits of several models to one flight: by model J, and estimates by name."""

    costs: Mapping[str, float]
    values: Mapping[str, Mapping[str, float]]


@dataclass(frozen=True)
class ModelFits:
    """Fits of several models to the same flights, by a worker that is given model, noise and seed."""

    work: str  #: see `stoop.parallel.Run`; its results are those of `fitted`
    stem: str  #: of the names of runs
    models: Sequence[str]
    noise: bool
    seeds: Sequence[int]
    arguments: Mapping[str, Any] = field(default_factory=dict)  #: further ones of the worker

    def runs(self) -> list[Run]:
        """Return one run for each model and seed."""
        return [
            Run(self._key(m, s), self.work, {**self.arguments, "model": m, "noise": self.noise, "seed": s})
            for m in self.models
            for s in self.seeds
        ]

    def fits(self, results: Results) -> list[Fits]:
        """Return the fits of each seed."""
        found = [{m: results[self._key(m, s)] for m in self.models} for s in self.seeds]
        return [Fits(*({m: t[n] for m, t in one.items()} for n in ("cost", "values"))) for one in found]

    def _key(self, model: str, seed: int) -> str:
        return f"{self.stem}/{model}/{'noise' if self.noise else 'clean'}/{seed:06d}"


class ModelStudy(PaperExperiment):
    """Terms of eq. (1) found again, and a claim of the paper that is tried by fitting several models to the same flights."""

    @abstractmethod
    def fits(self, setting: Setting) -> Mapping[tuple[str, bool], ModelFits]:
        """Return the fits of each case, without noise and with it."""

    def searches(self, setting: Setting) -> list[Run]:
        """Return all runs of the recovery and of the fits."""
        recovery, fits = recovery_searches(self.name, setting).values(), self.fits(setting).values()
        return [run for searches in recovery for run in searches.runs()] + [r for f in fits for r in f.runs()]


def fitted(problem: Misfit, seed: int) -> dict[str, Any]:
    """Return estimates by name, cost and status of the default optimizer, run to its end."""
    outcome = optimize.minimize(optimize.create(), problem, seed=seed)
    layout, D = problem.layout, problem.dimension
    values = layout.physical(outcome.z[None, :D])[0].tolist()
    estimates = dict(zip((p.name for p in layout.parameters), values, strict=True))
    estimates |= {n.name: n.scale * float(z) for n, z in zip(layout.nuisances, outcome.z[D:], strict=True)}
    return {"values": estimates, "cost": outcome.cost, "status": outcome.status}
