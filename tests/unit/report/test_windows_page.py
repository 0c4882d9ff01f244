"""The page of proposed windows: each window's information where the window is, and nowhere else."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.input_design.windows import Proposed
from stoop.report.design import information_strip


def window(start: float, stop: float, information: float) -> Proposed:
    return Proposed("f", start, stop, "roll", "why", information, 0.0, True, "fit")


def test_information_is_drawn_over_its_windows_alone() -> None:
    strip = information_strip([window(1.0, 3.0, 2.0), window(3.0, 8.0, 0.5)])
    (series,) = strip.series
    assert series.x == pytest.approx(np.array([1.0, 3.0, np.nan, 3.0, 8.0, np.nan]), nan_ok=True)
    assert series.y == pytest.approx(np.array([2.0, 2.0, np.nan, 0.5, 0.5, np.nan]), nan_ok=True)
    assert strip.zero
