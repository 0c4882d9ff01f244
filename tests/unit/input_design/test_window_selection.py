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


@pytest.mark.parametrize(
    ("windows", "told", "fitted", "held_out"),
    [
        ([(0.0,), (20.0,), (40.0,)], [(100.0, 0.0), (102.0, 0.0), (0.0, 50.0)], {1, 2}, {0}),  # doubles
        ([(0.0,), (4.0,)], [(100.0, 0.0), (0.0, 99.0)], {0}, set()),  # they overlap
        ([(0.0,), (1.0, 4.0)], [(30.0, 30.0)] * 2, {1}, set()),  # the shorter of two equals
        ([(0.0, 4.0), (0.5, 5.0, "roll")], [(30.0, 30.0)] * 2, {1}, set()),  # a whole maneuver
        ([(0.0,)], [(0.05, 0.05, 0.05)], set(), set()),  # what tells little is left
        # the weaker one of an axis is held out, and the only one about an axis never is
        ([(0.0, 7.0, "roll"), (10.0, 3.0, "roll"), (20.0, 5.0, "yaw")], [(900.0, 0.0), (400.0, 0.0), (0.0, 50.0)], {0, 2}, {1}),
        ([(0.0, 7.0, "roll"), (20.0, 5.0, "yaw")], [(900.0, 0.0), (0.0, 50.0)], {0, 1}, set()),
        # each axis flown twice is predicted once
        ([(10.0 * i, 5.0, ("pitch", "yaw", "roll")[i % 3]) for i in range(6)], [*60.0 * np.eye(3), *10.0 * np.eye(3)],
         {0, 1, 2}, {3, 4, 5}),
    ],
)  # fmt: skip
def test_windows_that_tell_different_things_are_taken(
    windows: list, told: list, fitted: set, held_out: set
) -> None:
    choice = chosen([at(*one) for one in windows], *map(np.diag, told))
    assert (set(choice.fitted), set(choice.held_out)) == (fitted, held_out)
    if len(windows) == 3 and told[0][0] == 100.0:
        assert choice.gains[0] == pytest.approx(0.25 * np.log(103.0))


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


def test_a_command_that_rests_at_its_end_is_saturated_and_a_peak_or_a_pulsed_pusher_is_not() -> None:
    flying, x = np.ones(400, dtype=bool), 0.5 + 0.3 * np.sin(np.arange(400) / 20.0)
    assert not saturated(x, flying).sum() > 16
    held, starved = np.minimum(x, 0.7), np.maximum(x, 0.3)
    found = saturated(held, flying)
    assert found[held == 0.7].all()
    assert not found[np.abs(held - 0.5) < 0.1].any()
    assert saturated(starved, flying)[starved == 0.3].all()
    for moved in (np.full(100, 0.4), 0.3 + 0.1 * np.random.default_rng(0).random(100)):
        assert not saturated(np.concatenate([np.zeros(100), moved, np.zeros(200)]), flying).any()


def test_no_more_is_held_out_than_the_error_bars_allow() -> None:
    """Doubled information shrinks error bars by log(2) / 2, each pair alone by half of that over two numbers: 0.17, then 0.35."""
    told = [np.diag([1e6, 0.0]), np.diag([0.0, 1e6])] * 2
    choice = chosen([at(10.0 * i, 5.0, ("pitch", "roll")[i % 2]) for i in range(4)], *told)
    assert len(choice.held_out) == 1
    assert len(choice.fitted) == 3
