"""Repeatability: each fitted maneuver alone, with the same vehicle, method and search, beside the joint fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stoop.assess.repeatability import agreement, without_prior
from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.estimate import methods
from stoop.estimate.fit import Fit
from stoop.problem.windows import Window
from stoop.results.uncertainty import Repeatability, SingleEstimate
from stoop.workflow.errorbars import ErrorBars
from stoop.workflow.identification import Job, Search
from stoop.workflow.judged import judged

NOTHING = SingleEstimate(float("nan"), float("nan"), counted=False)


@dataclass(frozen=True, eq=False)
class Alone:
    """What one maneuver alone tells; without estimates where it could not be fitted, and why."""

    window: Window
    estimates: dict[str, SingleEstimate]
    remark: str = ""


def fit_alone(done: Search, tell: Callable[[str], None] = lambda _: None) -> list[Alone]:
    """Fit every maneuver of a finished search by itself.

    The vehicle is as it was given: the same numbers are free, from the same start, within the same bounds and priors.
    What a maneuver cannot tell stays at its prior and is not counted. Ctrl-C ends the fit at hand and leaves the rest.

    Parameters
    ----------
    done : Search
    tell : callable
        Is told which maneuver is at hand.
    """
    out: list[Alone] = []
    stopped = False
    for window in done.fit.prepared.windows:
        tell(f"repeatability: {window}")
        one = (
            Alone(window, {}, f"{window}: left out, stopped by the user") if stopped else _alone(done, window)
        )
        stopped = stopped or "stopped" in one.remark
        out.append(one)
    return out


def with_repeatability(job: Job, singles: Sequence[Alone]) -> Job:
    """Return a job whose result says whether its maneuvers agree; unchanged without any."""
    if not singles:
        return job
    result = job.identification.result
    names = tuple(result.parameters)
    parameters = {n: agreement([one.estimates.get(n, NOTHING) for one in singles]) for n in names}
    remarks = tuple(one.remark for one in singles if one.remark)
    found = Repeatability(tuple(range(len(singles))), parameters, remarks)
    return replace(
        job, identification=replace(job.identification, result=replace(result, repeatability=found))
    )


def _alone(done: Search, window: Window) -> Alone:
    vehicle = done.fit.problem.layout.vehicle
    try:
        fit = methods.find(done.options.method).fitter()(
            vehicle, done.flights, [window], done.options, None, None
        )
        bars = judged(fit, done.options)
    except (StoopError, np.linalg.LinAlgError) as error:
        return Alone(window, {}, f"{window}: could not be fitted alone: {error}")
    status = fit.outcome.status
    if status == "interrupted":
        return Alone(window, {}, f"{window}: left out, stopped by the user")
    ended = (
        "" if status in ("converged", "target") else f"{window}: no confirmed optimum: {fit.outcome.advice}"
    )
    return Alone(window, _estimates(fit, bars), ended)


def _estimates(fit: Fit, bars: ErrorBars) -> dict[str, SingleEstimate]:
    shares, out = _prior_shares(fit, bars), {}
    for i, p in enumerate(fit.problem.layout.parameters):
        one = without_prior(
            fit.estimates[p.name], float(bars.std[i]), float(shares[i]), p.value, p.prior or np.nan
        )
        told = not bars.held[i] and bars.judged[p.name].identifiable
        out[p.name] = replace(one, counted=one.counted and told)
    return out


def _prior_shares(fit: Fit, bars: ErrorBars) -> FloatArray:
    """Return the share (D,) of each parameter's own prior in its estimate; 0 without one."""
    parameters = fit.problem.layout.parameters
    prior = np.array([np.inf if p.prior is None else p.prior for p in parameters])
    if bars.found is None:
        return np.zeros(len(parameters))
    variance = np.full(len(bars.held), np.nan)
    variance[~bars.held] = np.diag(bars.found.cramer_rao)
    return np.asarray(np.nan_to_num(variance[: len(parameters)] / prior**2))
