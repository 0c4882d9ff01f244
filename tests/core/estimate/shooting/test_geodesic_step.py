"""Steps through windows, straight and bent, against the whole system solved at once."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from stoop.estimate.geodesic_step import Step, bent
from stoop.estimate.shooting_problem import Iterate, Weighted, reduced
from stoop.estimate.shooting_windows import Shot

UNKNOWNS, STATES, READINGS = 4, 3, 20


class Quadratic:
    """Readings and gaps of windows that are quadratic in the unknowns and in the states that windows begin with."""

    def __init__(self, count: int, seed: int) -> None:
        self.rng, self.count = np.random.default_rng(seed), count
        size = UNKNOWNS + STATES * (count - 1)
        self.gaps = STATES * (count - 1)
        rows = READINGS * count + self.gaps
        self.closing = self.rng.uniform(0.5, 3.0, (count, STATES))  # weights of gaps
        self.linear = self.rng.normal(size=(rows, size))
        self.curved = self.rng.normal(size=(rows, size, size))
        # a window's readings and gap depend on its own state only, and a gap on the next
        for w in range(count):
            for at in [self.state(k) for k in range(1, count) if k != w]:
                self.linear[self.readings(w), at] = 0.0
                self.curved[self.readings(w), at] = self.curved[self.readings(w), :, at] = 0.0
                if w + 1 < count:
                    self.linear[self.gap(w), at] = 0.0
                    self.curved[self.gap(w), at] = self.curved[self.gap(w), :, at] = 0.0
            if w + 1 < count:
                self.linear[self.gap(w), self.state(w + 1)] = -np.diag(self.closing[w])
        self.rest = self.rng.normal(size=rows)

    def state(self, w: int) -> slice:
        return slice(UNKNOWNS + STATES * (w - 1), UNKNOWNS + STATES * w)

    def readings(self, w: int) -> slice:
        return slice(READINGS * w, READINGS * (w + 1))

    def gap(self, w: int) -> slice:
        first = READINGS * self.count + STATES * w
        return slice(first, first + STATES)

    def values(self, x: np.ndarray) -> np.ndarray:
        return self.rest + self.linear @ x + 0.5 * np.einsum("rij,i,j->r", self.curved, x, x)

    def whole(self, z: np.ndarray, nodes: np.ndarray) -> np.ndarray:
        return np.concatenate([z, nodes.T[1:].ravel()])

    def shots(self) -> list[Shot]:
        out = []
        for w in range(self.count):
            own, by_state = self.state(w) if w else slice(0, 0), np.zeros((READINGS, 1, STATES))
            gap_by_state = np.zeros((STATES, STATES))[: STATES * (w + 1 < self.count)]
            read, gap = self.readings(w), self.gap(w) if w + 1 < self.count else slice(0, 0)
            if w:
                by_state[:, 0] = self.linear[read, own]
                gap_by_state[:] = self.linear[gap, own]
            by_unknown = self.linear[read, None, :UNKNOWNS]
            rest = self.rest[read, None], by_unknown, by_state, self.rest[gap], self.linear[gap, :UNKNOWNS]
            out.append(Shot(*rest, gap_by_state))
        return out

    def problem(self) -> Any:
        def whitened(z: np.ndarray, nodes: list[np.ndarray]) -> list[tuple[np.ndarray, np.ndarray]]:
            values, cut = self.values(self.whole(z, nodes[0])), READINGS * self.count
            return [(values[:cut, None], values[cut:].reshape(-1, STATES))]

        def iterate(z: np.ndarray, nodes: list[np.ndarray]) -> Iterate:
            return Iterate(z, tuple(nodes), float(np.sum(self.values(self.whole(z, nodes[0])) ** 2)), 0.0)

        shots = SimpleNamespace(entries=np.arange(UNKNOWNS), perturbed=lambda own, steps: own + steps)
        problem = SimpleNamespace(dimension=0)
        return SimpleNamespace(shots=(shots,), problem=problem, whitened=whitened, iterate=iterate)


def first_step(case: Quadratic) -> tuple[Any, Iterate, list[Shot], list[Weighted], Step]:
    """Return a problem, its origin, the windows there, and the Gauss-Newton step from it."""
    problem = case.problem()
    at, linear = problem.iterate(np.zeros(UNKNOWNS), [np.zeros((STATES, case.count))]), case.shots()
    weighted = [
        Weighted(s.products, s.by_state, s.gap, s.gap_by_unknown, s.gap_by_state, closing[: len(s.gap)])
        for s, closing in zip(linear, case.closing, strict=True)
    ]
    left = reduced(weighted, 0.0)
    straight = -np.linalg.solve(left.normal, left.gradient)
    return problem, at, linear, weighted, Step(straight, [left], left.normal, np.arange(UNKNOWNS), 0.0, 1.0)


@pytest.mark.parametrize("count", [1, 2, 5])
def test_a_step_and_its_bend_are_those_of_the_whole_system(count: int) -> None:
    """Of a quadratic function the second derivative along a step is the same everywhere."""
    case = Quadratic(count, seed=count)
    problem, at, linear, weighted, step = first_step(case)
    x, (left,) = -np.linalg.lstsq(case.linear, case.rest, rcond=None)[0], step.windows
    assert step.z == pytest.approx(x[:UNKNOWNS], rel=1e-8, abs=1e-10)
    assert left.moves(step.z)[1:].ravel() == pytest.approx(x[UNKNOWNS:], rel=1e-8, abs=1e-10)
    gained = np.sum(case.rest**2) - np.sum((case.linear @ x + case.rest) ** 2)
    assert left.gain - left.gradient @ step.z == pytest.approx(gained, rel=1e-8)
    found = bent(problem, at, [linear], [weighted], step)
    x = x - 0.5 * np.linalg.lstsq(case.linear, np.einsum("rij,i,j->r", case.curved, x, x), rcond=None)[0]
    assert case.whole(found.z, found.nodes[0]) == pytest.approx(x, rel=1e-6, abs=1e-8)
    assert found.cost == pytest.approx(np.sum(case.values(x) ** 2))


def test_windows_that_diverge_leave_a_regular_system_and_the_iterate() -> None:
    """No vehicle is simulated with numbers that are none; beside huge readings, all alike, a gap is lost in rounding."""
    problem, at, linear, weighted, step = first_step(Quadratic(2, seed=2))
    whitened = problem.whitened
    problem.whitened = lambda z, nodes: [(np.full_like(r, np.inf), g) for r, g in whitened(z, nodes)]
    with np.errstate(invalid="ignore"):
        assert bent(problem, at, [linear], [weighted], step) is at
    huge = replace(linear[1], by_state=2.0**40 * np.ones_like(linear[1].by_state))
    left = reduced([weighted[0], replace(weighted[1], products=huge.products, by_state=huge.by_state)], 0.0)
    assert np.isfinite(left.normal).all()
    assert np.isfinite(left.moves(np.zeros(UNKNOWNS))).all()
