"""Stock aircraft of an independent simulator identified from its outputs, against its own tables."""

from __future__ import annotations

import functools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from stoop.base.csv_text import Cell
from stoop.flight import Flight, from_columns
from stoop.report.sheet import Prose, Section, Table
from stoop.vehicle import Vehicle
from stoop.workflow import identify
from stoop_studies.findings import Claim, Findings, Setting, counted, holds, number
from stoop_studies.verify.experiment import Samples, Verification, noise_table, work
from stoop_studies.verify.jsbsim.flight import (
    DURATION,
    FLEET,
    RATE,
    Aircraft,
    Recording,
    Subject,
    fly,
    trimmed,
)
from stoop_studies.verify.jsbsim.truth import NOISE, derivatives, vehicle_of

SIGMAS: Final = 3.0  #: an estimate agrees within so many standard errors,
SHARE: Final = 0.02  #: or within this of the true value, whichever is larger
AGREEING_SHARE: Final = 0.99  #: of single estimates; of normal ones 0.9973 lie within three standard errors
MEAN_SQUARES: Final = (0.75, 1.5)  #: of the differences in standard errors; 1 without any error of the model
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


@dataclass(frozen=True, eq=False)
class Case:
    """A vehicle of JSBSim, flown once without noise.

    Attributes
    ----------
    name : str
        Of its flights.
    vehicle : Vehicle
        What stoop is given.
    flown : Recording
    truth : mapping
        Parameter -> value that JSBSim's own vehicle has.
    noise : mapping
        Channel -> standard deviation, SI.
    channels : tuple of str
        What is recorded.
    stream : int
        Begins the seed of the noise: no two cases share it.
    """

    name: str
    vehicle: Vehicle
    flown: Recording
    truth: Mapping[str, float]
    noise: Mapping[str, float]
    channels: tuple[str, ...]
    stream: int

    def flight(self, seed: int, noise: float = 1.0) -> Flight:
        """Return the flight as noisy instruments record it; ``noise`` scales theirs."""
        generator = np.random.default_rng([self.stream, seed])
        sigma = {channel: noise * self.noise.get(channel, 0.0) for channel in self.channels}
        columns = {
            channel: (values := self.flown.columns[channel]) + s * generator.standard_normal(len(values))
            for channel, s in sigma.items()
        }
        return from_columns(self.name, self.flown.time, columns, source="JSBSim")

    def estimates(self, flight: Flight) -> dict[str, dict[str, float]]:
        """Identify as a user would; return truth, estimate and standard error of every parameter."""
        window = f"0:{self.flown.time[-1]:g}"
        found = identify(self.vehicle, flight, [window]).identification.result.parameters
        return {
            "truth": dict(self.truth),
            "estimate": {name: found[name].estimate for name in self.truth},
            "sigma": {name: found[name].std_error for name in self.truth},
        }


@functools.cache
def case(model: str) -> Case:
    """Fly an aircraft of the fleet, and read its derivatives off.

    Raises
    ------
    StoopError
        JSBSim is not installed, or its data have changed.
    """
    stream, stock = next((i, s) for i, s in enumerate(FLEET) if s.model == model)
    aircraft = Aircraft(stock)
    trim = trimmed(aircraft)
    aircraft.put(trim.state, trim.deflections)
    vehicle = vehicle_of(aircraft, trim)
    flown = fly(aircraft, trim)
    truth = derivatives(aircraft, trim, vehicle, flown)
    return Case(model, vehicle, flown, truth, NOISE, tuple(flown.columns), stream)


@work
def identify_once(model: str, seed: int) -> dict[str, Any]:
    """Identify one aircraft from one noisy flight."""
    known = case(model)
    return known.estimates(known.flight(seed))


class Identified:
    """Estimates (n, k) of one subject over n flights, and what they show by parameter (k,).

    Parameters
    ----------
    subject : Subject
    results : sequence
        Of `Case.estimates`.
    """

    def __init__(self, subject: Subject, results: Sequence[Mapping[str, Any]]) -> None:
        self.subject = subject
        self.names = tuple(results[0]["truth"])
        self.truth = np.array([results[0]["truth"][n] for n in self.names])
        self.estimates, self.sigmas = (
            np.array([[r[kind][n] for n in self.names] for r in results], dtype=float)
            for kind in ("estimate", "sigma")
        )
        errors = self.estimates - self.truth
        self.scores = errors / self.sigmas  #: in standard errors
        reach = np.maximum(SIGMAS * self.sigmas, SHARE * np.abs(self.truth))
        self.agree = np.abs(errors) <= reach
        self.mean_errors = errors.mean(axis=0)
        self.mean_scores = self.mean_errors / self.sigmas.mean(axis=0)
        self.mean_agrees = bool((np.abs(self.mean_errors) <= reach.mean(axis=0)).all())
        self.mean_square = float(np.mean(self.scores**2))

    @property
    def rows(self) -> Iterator[tuple[Cell, ...]]:
        """Give one row per parameter."""
        rms = np.sqrt(np.mean(self.scores**2, axis=0))
        for i, name in enumerate(self.names):
            truth, estimate = float(self.truth[i]), float(self.estimates[0, i])
            percent = None if _rounded(truth) == 0.0 else float(f"{100.0 * (estimate / truth - 1.0):.3g}")
            yield (
                self.subject.model, name, len(self.estimates), _rounded(truth), _rounded(estimate),
                _rounded(float(self.sigmas[0, i])), round(float(self.scores[0, i]), 2), percent,
                bool(self.agree[0, i]), int(self.agree[:, i].sum()), _rounded(float(self.estimates[:, i].mean())),
                round(float(self.mean_scores[i]), 2), round(float(rms[i]), 2),
            )  # fmt: skip

    def claims(self, what: str) -> Iterator[Claim]:
        """Give what is claimed."""
        title = self.subject.title
        above = np.abs(self.mean_errors) > SHARE * np.abs(self.truth)
        scores = np.where(above, np.abs(self.mean_scores), 0.0)
        worst = int(np.argmax(scores))
        yield holds(
            f"{title}: the mean over the flights is within 3 standard errors or 2 % of JSBSim's own value, for every {what}",
            self.mean_agrees,
            f"largest difference that is above 2 %: {scores[worst]:.1f} standard errors, {self.names[worst]}",
        )
        yield holds(
            f"{title}: so are at least {100 * AGREEING_SHARE:.0f} % of the single estimates",
            float(self.agree.mean()) >= AGREEING_SHARE,
            counted(int(self.agree.sum()), self.agree.size),
        )
        yield holds(
            f"{title}: the differences are as large as the standard errors say",
            MEAN_SQUARES[0] <= self.mean_square <= MEAN_SQUARES[1],
            f"mean square {number(self.mean_square)}, which is 1 if noise is all that there is",
        )


def _rounded(value: float) -> float:
    """Return six digits; what is zero but for rounding in JSBSim is zero."""
    return 0.0 if abs(value) < 1e-9 else float(f"{value:.6g}")


def cells(row: Sequence[Any]) -> tuple[str, ...]:
    """Return what a page shows of a row."""
    _, name, flights, truth, estimate, sigma, score, percent, agrees, many, _, mean, _ = row
    return (
        name, number(truth, 4), number(estimate, 4), number(sigma, 2), _signed(score),
        "–" if percent is None else _signed(percent), "yes" if agrees else "no", counted(many, flights), _signed(mean),
    )  # fmt: skip


def _signed(value: float) -> str:
    return f"{value:+.1f}".replace("-", "−")


def identified_findings(
    title: str, lead: str, words: str, what: str, head: tuple[str, ...], found: Sequence[Identified],
    noise: Mapping[str, float],
) -> Findings:  # fmt: skip
    """Return how far the estimates of some subjects are off; ``what`` names a parameter."""
    columns = (
        what, "JSBSim", "estimate", "standard error", "difference in standard errors", "in %", "agrees",
        "flights that agree", "mean, in standard errors",
    )  # fmt: skip
    tables = [(Table(one.subject.title, columns, tuple(map(cells, one.rows))), one.subject) for one in found]
    parts = (part for table, subject in tables for part in (table, Prose(subject.words)))
    return Findings(
        title,
        lead,
        tuple(claim for one in found for claim in one.claims(what)),
        (Section(f"{what.capitalize()}s", (Prose(words), *parts)), Section("Noise", (noise_table(noise),))),
        head,
        tuple(row for one in found for row in one.rows),
    )


def show(setting: Setting, samples: Samples) -> Findings:
    """Return how far the derivatives are off."""
    title = "Stock aircraft of JSBSim, identified from their outputs"
    found = [Identified(stock, samples[stock.model]) for stock in FLEET]
    return identified_findings(title, LEAD, WORDS, "derivative", HEAD, found, NOISE)


EXPERIMENT: Final = Verification(
    "jsbsim",
    show,
    runs=10,
    work="stoop_studies.verify.jsbsim.experiment:identify_once",
    cases=tuple(stock.model for stock in FLEET),
)
