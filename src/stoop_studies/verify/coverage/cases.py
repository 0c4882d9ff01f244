"""The cases of coverage by name: a scene, a method, and the range in which the coverage must lie."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, cast

from stoop_studies.verify.coverage.scene import Scene

Range = tuple[float, float]


@dataclass(frozen=True)
class Case:
    """One line of the table.

    Attributes
    ----------
    words : str
        What the residuals are.
    scene : str
        "module:function" from a seed to a `Scene`; imported when it is flown.
    method : str
        Of `stoop.estimate.methods`.
    pooled, each : (low, high)
        Where the coverage over all parameters must lie, and that of each; `each` is None where nothing is asked.
    """

    words: str
    scene: str
    method: str
    pooled: Range
    each: Range | None = None

    def fly(self, seed: int) -> Scene:
        """Return what a seed draws."""
        module, _, function = self.scene.partition(":")
        return cast("Scene", getattr(importlib.import_module(module), function)(seed))


_SENSORS: Final = "stoop_studies.verify.coverage.sensors"
CASES: Final[Mapping[str, Case]] = {
    "white": Case(
        "white sensor noise", f"{_SENSORS}:in_white_noise", "output-error", (0.93, 0.97), (0.91, 0.98)
    ),
    "ar1": Case(
        "AR(1) sensor noise, coefficient 0.95",
        f"{_SENSORS}:in_remembering_noise",
        "output-error",
        (0.90, 0.98),
    ),
    "dryden": Case(
        "Dryden turbulence (MIL-F-8785C, moderate) and white sensor noise",
        "stoop_studies.verify.coverage.gusts:in_dryden_turbulence",
        "filter-error",
        (0.90, 0.98),
    ),
}
