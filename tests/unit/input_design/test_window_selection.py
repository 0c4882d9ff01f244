"""The greedy choice, on information that is known."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.flight import Maneuver
from stoop.input_design.candidates import Candidate, saturated
from stoop.input_design.windows import CandidateInformation, Selection, select

SPAN = 8.0


def at(start: float, seconds: float = SPAN, axis: str = "") -> Candidate:
    found = Maneuver(axis, "u", start, start + seconds, 1.0, 2, 9.0, 1.0) if axis else None  # type: ignore[arg-type]
    return Candidate("f", start, start + seconds, found)


def chosen(found: list[Candidate], *told: np.ndarray) -> Selection:
    return select(found, CandidateInformation(np.eye(len(told[0])), tuple(told)))


def test_windows_that_tell_different_things_are_taken_and_doubles_held_out() -> None:
    first, second = np.diag([100.0, 0.0]), np.diag([0.0, 50.0])
    choice = chosen([at(0.0), at(20.0), at(40.0)], first, 1.02 * first, second)
    assert set(choice.fitted) == {1, 2}
    assert choice.held_out == (0,)
    assert choice.gains[0] == pytest.approx(0.25 * np.log(103.0))


def test_of_two_windows_one_is_taken() -> None:
    told, other = np.diag([100.0, 0.0]), np.diag([0.0, 99.0])
    choice = chosen([at(0.0), at(4.0)], told, other)
    assert (choice.fitted, choice.held_out) == ((0,), ()), "they overlap"
    same = 30.0 * np.eye(2)
    assert chosen([at(0.0), at(1.0, 4.0)], same, same).fitted == (1,), "the shorter of two equals"
    assert chosen([at(0.0, 4.0), at(0.5, 5.0, "roll")], same, same).fitted == (1,), "a whole maneuver"
    assert chosen([at(0.0)], 0.05 * np.eye(3)).fitted == (), "what tells little is left"


def test_greedy_is_near_the_best_of_its_size() -> None:
    """Submodular: no worse than 1 - 1/e of the best; here against all pairs."""
    rng = np.random.default_rng(0)
    told = [(v := rng.normal(size=(4, 2)) * rng.uniform(1, 9)) @ v.T for _ in range(9)]
    found = [at(10.0 * i) for i in range(9)]
    information = CandidateInformation(np.eye(4), tuple(told))
    both = select(found, information).fitted[:2]

    def total(pair: tuple[int, ...]) -> float:
        return float(np.linalg.slogdet(information.total(pair))[1])

    best = max(total((i, j)) for i in range(9) for j in range(i))
    assert total(both) > (1.0 - 1.0 / np.e) * best


def test_a_command_that_rests_at_its_end_is_saturated_and_a_peak_is_not() -> None:
    x = 0.5 + 0.3 * np.sin(np.arange(400) / 20.0)
    assert not saturated(x, np.ones(400, dtype=bool)).sum() > 16
    held = np.minimum(x, 0.7)
    found = saturated(held, np.ones(400, dtype=bool))
    assert found[held == 0.7].all()
    assert not found[np.abs(held - 0.5) < 0.1].any()


def test_a_pusher_that_rests_or_is_pulsed_is_not_saturated() -> None:
    flying = np.ones(400, dtype=bool)
    rng = np.random.default_rng(0)
    pulse = np.zeros(400)
    pulse[100:200] = 0.4
    assert not saturated(pulse, flying).any()
    ridden = np.zeros(400)
    ridden[100:200] = 0.3 + 0.1 * rng.random(100)
    assert not saturated(ridden, flying).any()
    starved = np.maximum(0.5 + 0.3 * np.sin(np.arange(400) / 20.0), 0.3)
    assert saturated(starved, flying)[starved == 0.3].all()


def test_the_best_maneuver_of_an_axis_is_fitted() -> None:
    """Of two that tell the same the weaker one is held out, and the only one about an axis never is."""
    told = [np.diag([900.0, 0.0]), np.diag([400.0, 0.0]), np.diag([0.0, 50.0])]
    found = [at(0.0, 7.0, "roll"), at(10.0, 3.0, "roll"), at(20.0, 5.0, "yaw")]
    choice = chosen(found, *told)
    assert set(choice.fitted) == {0, 2}
    assert choice.held_out == (1,)
    assert chosen(found[:1] + found[2:], told[0], told[2]).held_out == ()


def test_each_axis_flown_twice_is_predicted_once() -> None:
    """Two sets of three maneuvers: one of each axis is fitted, the other one held out."""
    axes = ("pitch", "yaw", "roll")
    told = [np.diag([size if i == k else 0.0 for i in range(3)]) for size in (60.0, 10.0) for k in range(3)]
    choice = chosen([at(10.0 * i, 5.0, axes[i % 3]) for i in range(6)], *told)
    assert set(choice.fitted) == {0, 1, 2}
    assert set(choice.held_out) == {3, 4, 5}


def test_no_more_is_held_out_than_the_error_bars_allow() -> None:
    """Doubled information shrinks error bars by log(2) / 2, each pair alone by half of that over two numbers: 0.17, then 0.35."""
    told = [np.diag([1e6, 0.0]), np.diag([0.0, 1e6])] * 2
    choice = chosen([at(10.0 * i, 5.0, ("pitch", "roll")[i % 2]) for i in range(4)], *told)
    assert len(choice.held_out) == 1
    assert len(choice.fitted) == 3
