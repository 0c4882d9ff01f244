from collections import Counter
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from stoop_studies.optimizers import mutation as m
from stoop_studies.optimizers.evolution import Islands
from stoop_studies.optimizers.mutation import Trigonometric, best_2, distinct, ordered, rand_1

SEEDS = st.integers(0, 2**32 - 1)
OPERATORS = [
    rand_1, best_2, ordered, m.unordered, m.localized, Trigonometric(), Trigonometric(1.0), m.ScaledByCost(),
    m.weighted_centroid,
]  # fmt: skip
Twin = Callable[[np.ndarray, np.ndarray, np.ndarray, int], np.ndarray]


def _population(seed: int, n: int = 12, d: int = 4) -> tuple[np.ndarray, np.ndarray]:
    generator = np.random.default_rng(seed)
    return generator.random((n, d)), 5.0 * generator.random(n)


def test_distinct_indices_are_uniform() -> None:
    generator, expected = np.random.default_rng(1), 6000 / 24
    counts = Counter(tuple(distinct(5, 3, generator)[:, 0].tolist()) for _ in range(6000))
    assert len(counts) == 4 * 3 * 2
    chi2 = sum((c - expected) ** 2 / expected for c in counts.values())
    assert chi2 < 49.7  # 99.9 % of chi-square with 23 degrees of freedom


def by_cost(F: np.ndarray, *picks: int) -> list[int]:
    return sorted(picks, key=lambda m: F[m])


def _ordered(X: np.ndarray, F: np.ndarray, i: int, *picks: int) -> np.ndarray:
    r1, r2, r3 = by_cost(F, *picks)
    return X[i] + 0.7 * (X[r1] - X[i] + X[r2] - X[r3])


def _localized(X: np.ndarray, F: np.ndarray, i: int, *three: int) -> np.ndarray:
    base = by_cost(F, *three)[0]
    k = three.index(base)
    return X[base] + 0.7 * (X[three[(k + 1) % 3]] - X[three[(k + 2) % 3]])


def _graded(X: np.ndarray, F: np.ndarray, i: int, *picks: int) -> np.ndarray:
    b, m, w = by_cost(F, *picks)
    return X[b] + (0.1 + 0.6 * (F[m] - F[b]) / (F[w] - F[b])) * (X[m] - X[w])


def _weighted_centroid(X: np.ndarray, F: np.ndarray, i: int, *picks: int) -> np.ndarray:
    a, b, c, d, e = picks
    factor = 1.0 - np.mean([max(column) - min(column) for column in X.T])
    weights = [max(F) - F[m] for m in (a, b, c)]
    centroid = sum(w * X[m] for w, m in zip(weights, (a, b, c), strict=True)) / sum(weights)
    return X[c] + factor * (centroid - X[c]) + 0.7 * (X[d] - X[e])


def test_mutation_equals_its_naive_twin() -> None:
    X, F = _population(5, d=5)
    for operator, twin, k, near in (
        (rand_1, lambda X, F, i, a, b, c: X[c] + 0.7 * (X[a] - X[b]), 3, 1e-14),
        (best_2, lambda X, F, i, a, b, c, d: X[F.argmin()] + 0.7 * (X[a] - X[b] + X[c] - X[d]), 4, 1e-14),
        (m.unordered, lambda X, F, i, a, b, c: X[i] + 0.7 * (X[a] - X[i] + X[b] - X[c]), 3, 1e-12),
        (ordered, _ordered, 3, 1e-14), (m.localized, _localized, 3, 1e-12), (m.ScaledByCost(0.1), _graded, 3, 1e-12),
        (m.weighted_centroid, _weighted_centroid, 5, 1e-12),
    ):  # fmt: skip
        mutants = operator(X, F, 0.7, np.random.default_rng(8))
        picks = distinct(len(X), k, np.random.default_rng(8))
        expected = np.array([twin(X, F, i, *picks[:, i].tolist()) for i in range(len(X))])
        assert mutants == pytest.approx(expected, rel=near), operator


def test_trigonometric_mutation_is_the_published_formula() -> None:
    X, F = _population(6)
    generator = np.random.default_rng(3)
    mutants = Trigonometric(0.5)(X, F, 0.7, np.random.default_rng(3))
    chosen, picks = generator.random(len(X)) < 0.5, distinct(len(X), 3, generator)
    assert 0 < chosen.sum() < len(X)
    for i, (a, b, c) in enumerate(picks.T):
        p1, p2, p3 = (F[m] / (F[a] + F[b] + F[c]) for m in (a, b, c))
        step = (p2 - p1) * (X[a] - X[b]) + (p3 - p2) * (X[b] - X[c]) + (p1 - p3) * (X[c] - X[a])
        expected = (X[a] + X[b] + X[c]) / 3 + step if chosen[i] else X[c] + 0.7 * (X[a] - X[b])
        assert mutants[i] == pytest.approx(expected, rel=1e-12)


@settings(deadline=None)
@given(st.sampled_from(OPERATORS), SEEDS, st.integers(6, 40), st.integers(1, 6))
def test_on_islands_a_mutation_sees_its_island_only(operator: Twin, seed: int, n: int, number: int) -> None:
    X, F = _population(seed, n)
    islands, scale = Islands(number), np.linspace(0.3, 0.9, n)[:, None]
    mutants = islands.breed(operator, X, F, scale, np.random.default_rng(seed))
    generator = np.random.default_rng(seed)
    places = islands.places(n)
    assert [m for place in places for m in range(n)[place]] == list(range(n))
    assert all(place.stop - place.start >= 6 for place in places)
    for place in places:
        assert (mutants[place] == operator(X[place], F[place], scale[place], generator)).all()


def test_signed_scales_are_uniform_in_size_and_of_either_sign() -> None:
    scales, rate = m.Signed(0.4, 1.0, rate=0.5).sample(None, np.ones(20_000), np.random.default_rng(1))
    assert rate == 0.5
    assert scales.shape == (20_000, 1)
    assert ((np.abs(scales) >= 0.4) & (np.abs(scales) <= 1.0)).all()
    assert (scales > 0.0).mean() == pytest.approx(0.5, abs=0.02)
    shares = np.histogram(np.abs(scales), bins=6, range=(0.4, 1.0))[0] / 20_000
    assert shares == pytest.approx(np.full(6, 1 / 6), abs=0.015)


def test_rates_by_cost_equal_their_naive_twin() -> None:
    F = np.array([3.0, 1.0, 9.0, 5.0, np.inf])
    scale, rates = m.ByCost(0.9, 0.1, 0.6).sample(None, F, np.random.default_rng(0))
    finite, expected = [3.0, 1.0, 9.0, 5.0], []
    for f in F:
        place = 1.0 if f == np.inf else (f - min(finite)) / (max(finite) - min(finite))
        expected.append(0.1 + 0.5 * place if f > sum(finite) / 4 else 0.1)
    assert scale == 0.9
    assert rates[:, 0].tolist() == pytest.approx(expected)
