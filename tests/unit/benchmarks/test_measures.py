"""Benchmarks measure the named quantities: operations, timing in turn, boxes and corners around the truth, readable logs."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.kernels.instructions import Function
from stoop.logs import read

ROOT = Path(__file__).parents[3]


def part(name: str) -> Any:
    """Import a module of the benchmarks, which lie outside the package."""
    if str(ROOT) not in sys.path:
        sys.path.insert(0, str(ROOT))
    return importlib.import_module(f"benchmarks.{name}")


def test_operations_are_counted_where_a_step_repeats_them() -> None:
    code = Function("i64 %samples", 4)
    x = code.rows(1)
    x[0] = x[0] * 2.0
    with code.loop(0, "%samples"):
        x[0] = -(x[0] * x[0] + 1.0).unary("sqrt")
        with code.loop(0, 3):
            x[0] = (x[0] / 2.0).unary("fabs") - x[0]
    assert part("flops").operations(code.text()) == 3 + 3 * 2, "magnitude and sign are free"


def test_a_verdict_compares_with_both_bounds() -> None:
    for value, bounds, asked, verdict in (
        (1.05, {"at_most": 1.1}, "<= 1.1", "pass"),
        (1.2, {"at_most": 1.1}, "<= 1.1", "falls short"),
        (130.0, {"at_least": 120.0}, ">= 120", "pass"),
        (3.0, {"at_least": 3.9, "at_most": 4.1}, "3.9 to 4.1", "falls short"),
        (None, {"at_most": 1.0}, "<= 1", ""),
    ):
        row = part("table").Row("part", "figure", value, **bounds)
        assert (row.asked, row.verdict) == (asked, verdict)


def test_boxes_and_corners_hold_the_truth_wherever_the_seed_draws_it() -> None:
    truth = np.array([2.0, -0.5, 10.0])
    for kind in "NWS":
        places = []
        for seed in range(50):
            low, high = part("paper").box(kind, seed, truth)
            places.append((truth - low) / (high - low))
        assert np.min(places) > 0.0, kind
        assert np.max(places) < 1.0, kind
        assert np.ptp(places, axis=0).min() > 0.25, "off the middle"
    corners = []
    for seed in range(40):
        low, high = part("corners").corner(8.0, seed, truth)
        assert high - low == pytest.approx(8.0 * np.abs(truth))
        corners.append((truth - low) / (high - low))
    place = np.array(corners)
    assert np.minimum(place, 1.0 - place) == pytest.approx(np.full(place.shape, 0.05))
    assert len(np.unique(place > 0.5, axis=0)) == 8, "every corner"


def test_the_log_that_is_measured_is_sound(tmp_path: Path) -> None:
    ulog = part("ulog")
    size = ulog.make(tmp_path / "flight.ulg", 3_000_000)
    recording = read(tmp_path / "flight.ulg", topics=frozenset(ulog.USEFUL))
    assert 1_500_000 < size < 3_100_000
    assert recording.defects == ()
    assert set(recording.streams) == set(ulog.USEFUL) < set(ulog.MIX)
    assert recording.streams["vehicle_attitude"].period == pytest.approx(1 / 200, abs=1e-6)
