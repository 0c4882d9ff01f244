"""Stock aircraft of an independent simulator identified from its outputs, against its own tables."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.csv_text import Cell
from stoop.parallel import Plan, Run
from stoop.report.sheet import Prose, Section, Table
from stoop_studies.findings import Claim, Findings, Results, Setting, counted, holds, number
from stoop_studies.verify.jsbsim_truth.aircraft import FLEET
from stoop_studies.verify.jsbsim_truth.case import WORK
from stoop_studies.verify.jsbsim_truth.flight import DURATION
from stoop_studies.verify.jsbsim_truth.machine import RATE
from stoop_studies.verify.jsbsim_truth.vehicle import NOISE

SIGMAS: Final = 3.0  #: an estimate agrees within so many standard errors,
SHARE: Final = 0.02  #: or within this of the true value, whichever is larger
ENOUGH: Final = 0.99  #: of single estimates; of normal ones 0.9973 lie within three standard errors
SQUARES: Final = (
    0.75,
    1.5,
)  #: mean square of the differences in standard errors; 1 without any error of the model
HEAD: Final = (
    "aircraft", "parameter", "flights", "jsbsim", "estimate", "sigma", "difference_in_sigma", "difference_percent",
    "agrees", "flights_that_agree", "mean_estimate", "mean_difference_in_sigma", "rms_difference_in_sigma",
)  # fmt: skip
LEAD: Final = f"""\
Aircraft of JSBSim's own package fly {DURATION:.0f} s of multisines on elevator, aileron and rudder together. Their \
instruments are read at {RATE} Hz, noise is added, and stoop identifies all derivatives from the readings, with known mass \
properties and from starting values of zero. What it finds is held against JSBSim's own aerodynamic tables at that \
flight condition, by finite differences through JSBSim."""
WORDS: Final = f"""\
Estimate, standard error and difference are those of the first flight. An estimate agrees within {SIGMAS:.0f} of its \
standard errors or {100 * SHARE:.0f} % of the true value, whichever is larger; among many, a few in a thousand do not by \
chance. The last column is the difference of the mean over all flights, in standard errors of one: what is left when noise \
averages out."""


class Subject(Protocol):
    """What was identified: its name in keys and tables, its name on the page, what is to be minded."""

    @property
    def model(self) -> str:
        """In keys and tables."""
        ...

    @property
    def title(self) -> str:
        """On the page."""
        ...

    @property
    def words(self) -> str:
        """What is to be minded."""
        ...


@dataclass(frozen=True, eq=False)
class Identified:
    """Estimates of one aircraft over all seeds.

    Attributes
    ----------
    stock : Subject
    names : tuple of str
    truth : (k,)
    estimates, sigmas : (n, k)
    """

    stock: Subject
    names: tuple[str, ...]
    truth: FloatArray
    estimates: FloatArray
    sigmas: FloatArray

    @property
    def errors(self) -> FloatArray:
        """Estimates less truth (n, k)."""
        return np.asarray(self.estimates - self.truth)

    @property
    def scores(self) -> FloatArray:
        """Errors in standard errors (n, k)."""
        return np.asarray(self.errors / self.sigmas)

    @property
    def agree(self) -> FloatArray:
        """Whether each estimate agrees (n, k)."""
        return np.asarray(np.abs(self.errors) <= self.reach)

    @property
    def reach(self) -> FloatArray:
        """How far each may be off (n, k)."""
        return np.maximum(SIGMAS * self.sigmas, SHARE * np.abs(self.truth))

    @property
    def mean_errors(self) -> FloatArray:
        """Errors of the mean over the flights (k,)."""
        return np.asarray(self.errors.mean(axis=0))

    @property
    def mean_scores(self) -> FloatArray:
        """The same in standard errors of one flight (k,)."""
        return np.asarray(self.mean_errors / self.sigmas.mean(axis=0))

    @property
    def mean_square(self) -> float:
        """Mean square of the scores over parameters and flights."""
        return float(np.mean(self.scores**2))


@dataclass(frozen=True)
class JsbsimTruth:
    """JSBSim's tables as truth."""

    name: str = "jsbsim"
    runs: int = 10
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan:
        """Return one run per aircraft and seed."""
        runs = (
            Run(key(stock.model, seed), WORK, {"aircraft": stock.model, "seed": seed})
            for seed in setting.seeds
            for stock in FLEET
        )
        return Plan(self.name, {"experiment": self.name}, tuple(runs))

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return how far the estimates are off."""
        found = [
            identified(stock, [results[key(stock.model, seed)] for seed in setting.seeds]) for stock in FLEET
        ]
        return Findings(
            "Stock aircraft of JSBSim, identified from their outputs",
            LEAD,
            tuple(claim for one in found for claim in claims(one)),
            (
                Section(
                    "Derivatives",
                    (
                        Prose(WORDS),
                        *(part for one in found for part in (_table(one), Prose(one.stock.words))),
                    ),
                ),
                Section("Noise", (_noise(),)),
            ),
            HEAD,
            tuple(row for one in found for row in rows(one)),
        )


def key(model: str, seed: int) -> str:
    """Return the name of a run."""
    return f"{model}/{seed:06d}"


def identified(stock: Subject, told: Sequence[Mapping[str, Any]]) -> Identified:
    """Collect the results of one aircraft."""
    truth: Mapping[str, float] = told[0]["truth"]
    names = tuple(truth)
    columns = [
        np.array([[t[kind][n] for n in names] for t in told], dtype=float) for kind in ("estimate", "sigma")
    ]
    return Identified(stock, names, np.array([truth[n] for n in names]), *columns)


def claims(found: Identified, what: str = "derivative") -> Iterator[Claim]:
    """Give what is claimed of an aircraft."""
    agree, title = found.agree, found.stock.title
    yield holds(
        f"{title}: the mean over the flights is within 3 standard errors or 2 % of JSBSim's own value, for every {what}",
        bool((np.abs(found.mean_errors) <= found.reach.mean(axis=0)).all()),
        f"largest difference that is above 2 %: {_worst(found)}",
    )
    yield holds(
        f"{title}: so are at least {100 * ENOUGH:.0f} % of the single estimates",
        float(agree.mean()) >= ENOUGH,
        counted(int(agree.sum()), agree.size),
    )
    yield holds(
        f"{title}: the differences are as large as the standard errors say",
        SQUARES[0] <= found.mean_square <= SQUARES[1],
        f"mean square {number(found.mean_square)}, which is 1 if noise is all that there is",
    )


def _worst(found: Identified) -> str:
    above = np.abs(found.mean_errors) > SHARE * np.abs(found.truth)
    scores = np.where(above, np.abs(found.mean_scores), 0.0)
    worst = int(np.argmax(scores))
    return f"{scores[worst]:.1f} standard errors, {found.names[worst]}"


def rows(found: Identified) -> Iterator[tuple[Cell, ...]]:
    """Give one row per parameter."""
    rms = np.sqrt(np.mean(found.scores**2, axis=0))
    for i, name in enumerate(found.names):
        truth, estimate = float(found.truth[i]), float(found.estimates[0, i])
        yield (
            found.stock.model, name, len(found.estimates), _rounded(truth), _rounded(estimate),
            _rounded(float(found.sigmas[0, i])), round(float(found.scores[0, i]), 2), _percent(estimate, truth),
            bool(found.agree[0, i]), int(found.agree[:, i].sum()), _rounded(float(found.estimates[:, i].mean())),
            round(float(found.mean_scores[i]), 2), round(float(rms[i]), 2),
        )  # fmt: skip


def _rounded(value: float) -> float:
    """Return six digits; what is zero but for rounding in JSBSim is zero."""
    return 0.0 if abs(value) < 1e-9 else float(f"{value:.6g}")


def _percent(estimate: float, truth: float) -> float | None:
    """Return the difference in percent; nothing where there is nothing to compare with."""
    return None if _rounded(truth) == 0.0 else float(f"{100.0 * (estimate / truth - 1.0):.3g}")


def _table(found: Identified) -> Table:
    head = (
        "derivative", "JSBSim", "estimate", "standard error", "difference in standard errors", "in %", "agrees",
        "flights that agree", "mean, in standard errors",
    )  # fmt: skip
    return Table(found.stock.title, head, tuple(cells(row) for row in rows(found)))


def cells(row: Sequence[Any]) -> tuple[str, ...]:
    """Return what a page shows of a row."""
    _, name, flights, truth, estimate, sigma, score, percent, agrees, many, _, mean, _ = row
    return (
        name, number(truth, 4), number(estimate, 4), number(sigma, 2), _signed(score, 1),
        "–" if percent is None else _signed(percent, 1), "yes" if agrees else "no", counted(many, flights),
        _signed(mean, 1),
    )  # fmt: skip


def _signed(value: float, digits: int) -> str:
    return f"{value:+.{digits}f}".replace("-", "−")


def _noise() -> Table:
    units = {"V": "m/s", "p": "rad/s", "q": "rad/s", "r": "rad/s", "ax": "m/s2", "ay": "m/s2", "az": "m/s2"}
    told = tuple((c, f"{sigma:g} {units.get(c, 'rad')}") for c, sigma in NOISE.items())
    return Table("White, one standard deviation", ("channel", "noise"), told)
