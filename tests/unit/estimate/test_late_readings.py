"""Readings of late sensors moved to when they were true, for filters and windows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stoop.errors import IdentificationError
from stoop.estimate.fit import Options, estimation_problem
from stoop.estimate.linearization import advanced, aligned, as_recorded, undelayed
from stoop.problem import Layout, Misfit
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow.demo import MANEUVER

LATE = "[sensors.q]\ndelay = 0.03\n[sensors.psi]\ndelay = 0.015\n"


def late_problem(bounds: tuple[float, float]) -> Misfit:
    vehicle = parse_vehicle(resolve_vehicle("twin-boom").text + LATE, "late").with_numbers(
        {"sensors.q.delay": {"free": True, "bounds": bounds}}
    )
    flight = simulate_flight(vehicle, parse_maneuver(MANEUVER, "m"), name="sim")
    return estimation_problem(vehicle, {"sim": flight}, [Window("sim", 0.0, 8.0)], Options())[0]


def with_gap(problem: Misfit, first: int, behind: int) -> Misfit:
    measured = problem.pieces[0].measured.copy()
    measured[first:behind] = np.nan
    return replace(problem, pieces=(replace(problem.pieces[0], measured=measured),))


@pytest.mark.parametrize("samples", [-2.3, 0.5, 1.0, 3.7])
def test_a_smooth_signal_is_read_where_it_will_be(samples: float) -> None:
    t = np.arange(400.0)
    found = advanced(np.sin(0.2 * t) + 0.01 * t, samples)
    later = t + samples
    assert found[10:-10] == pytest.approx((np.sin(0.2 * later) + 0.01 * later)[10:-10], abs=2e-3)


@pytest.mark.parametrize("samples", [0.25, 0.5, 2.5])
def test_noise_stays_as_large_and_as_white(samples: float) -> None:
    noise = np.random.default_rng(1).standard_normal(20_000)
    found = advanced(noise, samples)
    assert np.var(found) == pytest.approx(np.var(noise), rel=1e-3)
    before, after = (np.mean(x[1:] * x[:-1]) for x in (noise, found))
    assert after == pytest.approx(before, abs=1e-3)


def test_a_filter_leaves_out_what_a_gap_or_an_end_is_near_to() -> None:
    problem = late_problem((0.0, 0.1))
    held = problem.layout.vehicle.with_numbers({"sensors.q.delay": {"free": False}})
    layout = Layout.of(held, problem.layout.nuisances)
    problem = with_gap(replace(problem, layout=layout), 100, 103)
    piece, psi = problem.pieces[0], problem.layout.vehicle.outputs.index("psi")
    (shifted,) = undelayed(problem).pieces
    late = 0.015 / piece.dt
    missing = np.flatnonzero(np.isnan(shifted.measured[:, psi]))
    expected = {
        round(x) for x in np.arange(len(piece.time)) if _near(x + late, [*range(100, 103)], len(piece.time))
    }
    assert set(missing.tolist()) == expected


def _near(at: float, gap: list[int], count: int) -> bool:
    return any(not 0 <= k < count or k in gap for k in range(round(at) - 3, round(at) + 4))


def test_windows_move_readings_without_changing_them() -> None:
    problem = late_problem((0.0, 0.1))
    piece, q = problem.pieces[0], problem.layout.vehicle.outputs.index("q")
    moved = aligned(problem, problem.layout.start).pieces[0]
    assert moved.moved[q] == round(0.03 / piece.dt)
    n = round(0.1 / piece.dt)
    back = np.roll(moved.measured[:, q], round(moved.moved[q]))
    assert np.isnan(back[:n]).all()
    assert np.array_equal(back[n:], piece.measured[n:, q])
    simulated = as_recorded(moved, np.arange(len(back))[:, None] * np.ones(len(moved.moved)))
    assert np.array_equal(simulated[n:, q], np.arange(len(back))[n:] - moved.moved[q])


def test_a_short_piece_beside_a_long_one_may_lose_its_late_readings() -> None:
    problem = late_problem((0.0, 1.0))
    whole, q = problem.pieces[0], problem.layout.vehicle.outputs.index("q")
    short = whole.part(0, round(0.8 / whole.dt), whole.start)
    both = aligned(replace(problem, pieces=(whole, short)), problem.layout.start).pieces
    assert np.isfinite(both[0].measured[:, q]).sum() == len(whole.time) - round(1.0 / whole.dt)
    assert np.isnan(both[1].measured[:, q]).all()
    with pytest.raises(IdentificationError, match=r"sensors\.q\.delay: its bounds leave .*; narrow them"):
        aligned(replace(problem, pieces=(short,)), problem.layout.start)
    with pytest.raises(
        IdentificationError, match=r"sensors\.q\.delay: a filter needs .* --fix sensors\.q\.delay"
    ):
        undelayed(problem)
