"""Further statements of uncertainty on a finished job, each composed onto it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from stoop.assess.trust import trust
from stoop.workflow.case import Assessment, Watch, case_of

if TYPE_CHECKING:
    from stoop.workflow.identification import Job


def assessed(job: Job, assessments: Sequence[Assessment], watch: Watch) -> Job:
    """Return the job with what the assessments found, and which of all statements to trust.

    Raises
    ------
    IdentificationError
        The fit is of a method that cannot be assessed, or an extra is not installed.
    """
    result = job.identification.result
    case = case_of(job.fit, result.method, result.seed)
    uncertainty, files = dict(result.uncertainty), dict(job.attachments)
    for assessment in assessments:
        found = assessment(case, watch)
        uncertainty[assessment.name] = found.spread
        files |= found.files
    told = replace(result, uncertainty=uncertainty, trust=trust(result.parameters, uncertainty))
    return replace(job, identification=replace(job.identification, result=told), attachments=files)
