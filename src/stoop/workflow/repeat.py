"""Repeatability: each fitted maneuver alone, with the same vehicle, method and search, beside the joint fit."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

from stoop.assessment import uncertainty
from stoop.assessment.uncertainty import SingleFit
from stoop.workflow.identification import Job, Search


def fit_alone(done: Search, watch: Callable[[str], None] = lambda _: None) -> list[SingleFit]:
    """Fit every maneuver of a finished search by itself, see :func:`stoop.assessment.uncertainty.fit_each`."""
    return uncertainty.fit_each(done.fit, done.flights, done.options, watch)


def with_repeatability(job: Job, singles: Sequence[SingleFit]) -> Job:
    """Return a job whose result says whether its maneuvers agree; unchanged without any."""
    if not singles:
        return job
    result = uncertainty.with_repeatability(job.identification.result, singles)
    return replace(job, identification=replace(job.identification, result=result))
