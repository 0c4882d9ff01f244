"""The measuring itself: what is counted, what passes, what the loop of multiply-adds does."""

from __future__ import annotations

import importlib
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest

from stoop import optimize
from stoop.kernels.instructions import Function

ROOT = Path(__file__).parents[3]


@pytest.fixture
def part(monkeypatch: pytest.MonkeyPatch) -> Any:
    """Import a module of the benchmarks, which lie outside the package."""
    monkeypatch.syspath_prepend(str(ROOT))

    def load(name: str) -> ModuleType:
        return importlib.import_module(f"benchmarks.{name}")

    return load


# JAX is not in the extra of the tests
PARTS = {file.stem for file in (ROOT / "benchmarks").glob("[a-z]*.py")} - {"solver_jax"}


@pytest.mark.parametrize("name", sorted(PARTS))
def test_every_part_finds_what_it_measures(part: Any, name: str) -> None:
    assert part(name)


def test_operations_are_counted_where_a_step_repeats_them(part: Any) -> None:
    code = Function("i64 %samples", 4)
    x = code.rows(1)
    x[0] = x[0] * 2.0
    with code.loop(0, "%samples"):
        x[0] = -(x[0] * x[0] + 1.0).unary("sqrt")
        with code.loop(0, 3):
            x[0] = (x[0] / 2.0).unary("fabs") - x[0]
    assert part("flops").operations(code.text()) == 3 + 3 * 2, "magnitude and sign are free"


def test_the_loop_of_multiply_adds_computes_them(part: Any) -> None:
    peak = part("peak")
    compiled = peak.compiled()
    if compiled is None:
        pytest.skip("no fused multiply-add on this processor")
    call, operations = compiled
    assert call() == pytest.approx(peak.SUMS * 1.0), "x = x / 2 + 1 / 2 rests at one in each of the sums"
    assert operations == 2 * peak.SUMS * peak.lanes() * peak.STEPS


@pytest.mark.parametrize(
    ("value", "bounds", "asked", "verdict"),
    [
        (1.05, {"at_most": 1.1}, "<= 1.1", "pass"),
        (1.2, {"at_most": 1.1}, "<= 1.1", "falls short"),
        (130.0, {"at_least": 120.0}, ">= 120", "pass"),
        (3.0, {"at_least": 3.9, "at_most": 4.1}, "3.9 to 4.1", "falls short"),
        (0.0, {"at_most": 0.0}, "0", "pass"),
        (1.0, {}, "", ""),
        (None, {"at_most": 1.0}, "<= 1", ""),
    ],
)
def test_verdicts(part: Any, value: float | None, bounds: dict[str, float], asked: str, verdict: str) -> None:
    row = part("table").Row("part", "figure", value, **bounds)
    assert (row.asked, row.verdict) == (asked, verdict)
    assert row.as_json()["verdict"] == verdict
    assert ("not measured" in part("table").markdown([row])) == (value is None)


def test_things_are_timed_in_turn(part: Any) -> None:
    order: list[str] = []
    ticks = iter(np.arange(100.0))
    times = part("clock").interleave(
        {"a": lambda: order.append("a"), "b": lambda: order.append("b")}, 3, lambda: float(next(ticks)), 0.0
    )
    assert order == list("ab" * 4), "once to warm up, then three rounds"
    assert {name: t.tolist() for name, t in times.items()} == {"a": [1.0] * 3, "b": [1.0] * 3}


@pytest.mark.parametrize("kind", ["N", "W", "S"])
def test_boxes_hold_the_truth_off_their_middle(part: Any, kind: str) -> None:
    truth = np.array([2.0, -0.5, 10.0])
    places = []
    for seed in range(50):
        low, high = part("paper").box(kind, seed, truth)
        assert (low < truth).all()
        assert (truth < high).all()
        places.append((truth - low) / (high - low))
    assert np.ptp(places, axis=0).min() > 0.25


def test_the_log_that_is_measured_is_sound(part: Any, tmp_path: Path) -> None:
    from stoop.logs import read

    ulog = part("ulog")
    size = ulog.make(tmp_path / "flight.ulg", 3_000_000)
    recording = read(tmp_path / "flight.ulg", topics=frozenset(ulog.USEFUL))
    assert 1_500_000 < size < 3_100_000
    assert recording.defects == ()
    assert set(recording.streams) == set(ulog.USEFUL) < set(ulog.MIX)
    assert recording.streams["vehicle_attitude"].period == pytest.approx(1 / 200, abs=1e-6)


@pytest.mark.parametrize("width", [8.0, 30.0])
def test_the_truth_lies_in_a_corner_that_the_seed_draws(part: Any, width: float) -> None:
    corners, truth = part("corners"), np.array([0.5, -40.0, 3.0])
    places = []
    for seed in range(40):
        low, high = corners.corner(width, seed, truth)
        assert high - low == pytest.approx(width * np.abs(truth))
        places.append((truth - low) / (high - low))
    place = np.array(places)
    assert np.minimum(place, 1.0 - place) == pytest.approx(np.full(place.shape, 0.05))
    assert len(np.unique(place > 0.5, axis=0)) == 8, "every corner"


def test_the_search_ends_by_itself_in_a_corner(part: Any) -> None:
    """One of the development seeds, on which a population of the whole record alone had not ended after 10 000."""
    corners = part("corners")
    problem = corners.in_corner(30.0, 28)
    outcome = optimize.minimize(
        optimize.create(), problem, seed=28, stop=optimize.Stop(budget=corners.BUDGET)
    )
    assert outcome.status == "converged"
    truth = np.array([corners.paper().vehicle.value(p.name) for p in problem.layout.parameters])
    assert problem.layout.physical(outcome.z[None, :])[0] == pytest.approx(truth, rel=1e-6)
