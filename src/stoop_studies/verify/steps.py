"""Maneuvers of steps as a table in the source: flown by experiments, and shown on their pages."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from stoop.report.sheet import Table
from stoop.simulate import Maneuver

Step = tuple[str, str, float, float, float]  #: control, shape, start (s), step (s), amplitude (rad)
NAMES = ("control", "shape", "start", "step", "amplitude")


def maneuver(steps: tuple[Step, ...], duration: float, rate: float, **more: Any) -> Maneuver:
    """Return a maneuver of so many seconds at so many Hz; ``more`` holds for each of its inputs."""
    inputs = [dict(zip(NAMES, step, strict=True)) | more for step in steps]
    return Maneuver.model_validate({"duration": duration, "rate": rate, "input": inputs})


def inputs_table(maneuvers: Mapping[str, tuple[Step, ...]]) -> Table:
    """Return the inputs of every maneuver for a page."""
    rows = tuple(
        (name, control, shape, f"{start:g}", f"{step:g}", f"{amplitude:g}")
        for name, steps in maneuvers.items()
        for control, shape, start, step, amplitude in steps
    )
    return Table("Inputs", ("maneuver", "control", "shape", "start, s", "step, s", "amplitude, rad"), rows)
