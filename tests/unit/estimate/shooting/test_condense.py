"""Elimination of the windows' states against the whole system, solved at once."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop.estimate.shooting_problem import Weighted, reduced
from stoop.estimate.shooting_windows import Shot

Windows = list[tuple[Shot, np.ndarray]]  # and the weights of its gap


def windows(seed: int, count: int, unknowns: int = 4, states: int = 3) -> Windows:
    rng = np.random.default_rng(seed)
    out = []
    for w in range(count):
        gaps = states if w + 1 < count else 0
        shot = Shot(
            rng.normal(size=(20, 1)),
            rng.normal(size=(20, 1, unknowns)),
            rng.normal(size=(20, 1, states)),
            rng.normal(size=gaps),
            rng.normal(size=(gaps, unknowns)),
            rng.normal(size=(gaps, states)),
        )
        out.append((shot, rng.uniform(0.5, 3.0, gaps)))
    return out


def whole(found: Windows) -> tuple[np.ndarray, np.ndarray]:
    """Rows and right side of everything: unknowns, then the states of all windows but the first."""
    u, e = found[0][0].by_unknown.shape[2], found[0][0].by_state.shape[2]
    size = u + e * (len(found) - 1)
    rows, right = [], []
    for w, (one, closing) in enumerate(found):
        own, after = u + e * (w - 1), u + e * w
        block = np.zeros((20, size))
        block[:, :u] = one.by_unknown[:, 0]
        meet = np.zeros((len(one.gap), size))
        meet[:, :u] = one.gap_by_unknown
        if w > 0:
            block[:, own : own + e] = one.by_state[:, 0]
            meet[:, own : own + e] = one.gap_by_state
        if len(one.gap):
            meet[:, after : after + e] = -np.diag(closing)
        rows += [block, meet]
        right += [one.residual[:, 0], one.gap]
    return np.concatenate(rows), np.concatenate(right)


@given(seed=st.integers(0, 1000), count=st.integers(1, 6))
@settings(max_examples=30, deadline=None)
def test_the_step_is_that_of_the_whole_system(seed: int, count: int) -> None:
    found = windows(seed, count)
    rows, right = whole(found)
    solution = -np.linalg.lstsq(rows, right, rcond=None)[0]
    weighted = [
        Weighted(one.products, one.by_state, one.gap, one.gap_by_unknown, one.gap_by_state, closing)
        for one, closing in found
    ]
    left = reduced(weighted, damping=0.0)
    step = -np.linalg.solve(left.normal, left.gradient)
    assert np.allclose(step, solution[:4], rtol=1e-8, atol=1e-10)
    assert np.allclose(left.moves(step)[1:].ravel(), solution[4:], rtol=1e-8, atol=1e-10)
    gained = np.sum(right**2) - np.sum((rows @ solution + right) ** 2)
    assert np.isclose(left.gain - left.gradient @ step, gained, rtol=1e-8)


def test_a_window_that_diverges_leaves_no_singular_system() -> None:
    """Its readings are huge and all alike, beside which its gap is lost in rounding."""
    (first, closing), (last, nothing) = windows(3, 2)
    alike = 2.0**40 * np.ones_like(last.by_state)
    diverged = Shot(last.residual, last.by_unknown, alike, last.gap, last.gap_by_unknown, last.gap_by_state)
    weighted = [
        Weighted(one.products, one.by_state, one.gap, one.gap_by_unknown, one.gap_by_state, weight)
        for one, weight in ((first, closing), (diverged, nothing))
    ]
    left = reduced(weighted, damping=0.0)
    assert np.isfinite(left.normal).all()
    assert np.isfinite(left.moves(np.zeros(4))).all()
