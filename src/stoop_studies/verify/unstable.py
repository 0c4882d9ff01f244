"""Coverage and bias for aircraft that only their autopilot holds, by the method that stoop identify takes by itself."""

from __future__ import annotations

from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from stoop_studies.findings import Findings, Setting
from stoop_studies.verify import closed_loop, study
from stoop_studies.verify.feedback import Case, coverage_and_bias, identified

CASES: Final[Mapping[str, Case]] = {
    f"unstable-{axis}": Case(
        f"the aircraft unstable in {axis}", partial(closed_loop.aircraft_scene, 0.0, unstable=axis)
    )
    for axis in closed_loop.UNSTABLE
}


@study.work
def identify(case: str, seed: int) -> dict[str, Any]:
    """Fly a case and identify it without naming a method."""
    return identified(CASES[case].fly(1000 * list(CASES).index(case) + seed), seed)


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return coverage and bias of each case."""
    return coverage_and_bias("Unstable aircraft under an autopilot", CASES, samples)


EXPERIMENT: Final = study.Verification("unstable", show, runs=24, work="identify", cases=tuple(CASES))
