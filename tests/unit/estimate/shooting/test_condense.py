"""Elimination of the windows' states against the whole system, solved at once."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.estimate.shooting_problem import Weighted, reduced


def windows(seed: int, count: int, unknowns: int = 4, states: int = 3) -> list[Weighted]:
    rng = np.random.default_rng(seed)
    out = []
    for w in range(count):
        gaps = states if w + 1 < count else 0
        out.append(
            Weighted(
                rng.normal(size=20),
                rng.normal(size=(unknowns, 20)),
                rng.normal(size=(states, 20)),
                rng.normal(size=gaps),
                rng.normal(size=(gaps, unknowns)),
                rng.normal(size=(gaps, states)),
                rng.uniform(0.5, 3.0, gaps),
            )
        )
    return out


def whole(found: list[Weighted]) -> tuple[np.ndarray, np.ndarray]:
    """Rows and right side of everything: unknowns, then the states of all windows but the first."""
    u, e = found[0].by_unknown.shape[0], found[0].by_state.shape[0]
    size = u + e * (len(found) - 1)
    rows, right = [], []
    for w, one in enumerate(found):
        own, after = u + e * (w - 1), u + e * w
        block = np.zeros((20, size))
        block[:, :u] = one.by_unknown.T
        meet = np.zeros((len(one.gap), size))
        meet[:, :u] = one.gap_by_unknown
        if w > 0:
            block[:, own : own + e] = one.by_state.T
            meet[:, own : own + e] = one.gap_by_state
        if len(one.gap):
            meet[:, after : after + e] = -np.diag(one.closing)
        rows += [block, meet]
        right += [one.residual, one.gap]
    return np.concatenate(rows), np.concatenate(right)


@given(seed=st.integers(0, 1000), count=st.integers(1, 6))
@settings(max_examples=30, deadline=None)
def test_the_step_is_that_of_the_whole_system(seed: int, count: int) -> None:
    found = windows(seed, count)
    rows, right = whole(found)
    solution = -np.linalg.lstsq(rows, right, rcond=None)[0]
    left = reduced(found, damping=0.0)
    step = -np.linalg.solve(left.normal, left.gradient)
    assert np.allclose(step, solution[:4], rtol=1e-8, atol=1e-10)
    assert np.allclose(left.moves(step)[1:].ravel(), solution[4:], rtol=1e-8, atol=1e-10)
    gained = np.sum(right**2) - np.sum((rows @ solution + right) ** 2)
    assert np.isclose(left.gain - left.gradient @ step, gained, rtol=1e-8)
