"""Maneuvers of these tests."""

from __future__ import annotations

from typing import Any

from stoop.simulation.maneuver import Maneuver

Step = tuple[str, str, float, float, float]


def maneuver(duration: float, *inputs: Step, rate: float = 100.0, **more: Any) -> Maneuver:
    """Return inputs of a control: its shape, start, s, length of a step, s, and amplitude."""
    keys = ("control", "shape", "start", "step", "amplitude")
    written = [dict(zip(keys, one, strict=True)) for one in inputs]
    return Maneuver.model_validate({"duration": duration, "rate": rate, "input": written, **more})
