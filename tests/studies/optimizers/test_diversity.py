import numpy as np
import pytest
from naive.landscapes import Only

from stoop.optimize.ledger import Evaluations, Ledger
from stoop_studies.optimizers import evolution
from stoop_studies.optimizers.evolution import Acceleration, Islands, Migration, RingMigration
from stoop_studies.optimizers.local_search import LevenbergMarquardt, PreySchedule


def bowl(X: np.ndarray) -> np.ndarray:
    return 2.0 + ((X - 0.4) ** 2).sum(axis=1)


def selected(X: np.ndarray, improved: bool = False) -> evolution.Selected:
    return evolution.Selected(X, bowl(X), bowl(X) + improved)


def pen() -> Ledger:
    return Ledger(Only(bowl, 3), Evaluations.none(Only(bowl, 3)))


def cloud(n: int = 12, spread: float = 1.0, seed: int = 0) -> np.ndarray:
    return 0.9 - spread * 0.8 * np.random.default_rng(seed).random((n, 3))


def test_in_a_ring_the_best_of_each_island_comes_to_the_next() -> None:
    islands, now = Islands(3), selected(cloud(18))
    X, F = RingMigration(islands, 1.0)(now, pen(), np.random.default_rng(0))
    places = islands.places(18)
    for k, place in enumerate(places):
        source = places[k - 1]
        best = now.X[source][now.F[source].argmin()]
        changed = np.flatnonzero((X[place] != now.X[place]).any(axis=1))
        assert len(changed) == 1
        assert X[place][changed[0]].tolist() == best.tolist()
        assert F[place][changed[0]] == now.F[source].min()
        assert F[place].min() <= now.F[place].min()


def test_acceleration_moves_the_best_down_its_gradient_only_when_the_generation_failed() -> None:
    now, ledger = selected(cloud()), pen()
    best = int(now.F.argmin())
    X, F = Acceleration()(now, ledger, np.random.default_rng(0))
    step, descent = X[best] - now.X[best], 0.4 - now.X[best]
    assert step @ descent == pytest.approx(np.linalg.norm(step) * np.linalg.norm(descent), rel=1e-4)
    assert F[best] < now.F[best]
    assert F[best] == bowl(X[best][None, :])[0]
    assert (np.delete(X, best, axis=0) == np.delete(now.X, best, axis=0)).all()
    assert 4.0 <= ledger.spent <= 3.0 + 5.0
    ledger, content = pen(), selected(cloud(), improved=True)
    assert Acceleration()(content, ledger, np.random.default_rng(0))[0] is content.X
    assert ledger.spent == 0.0


def test_migration_draws_all_but_the_best_anew_once_they_have_contracted() -> None:
    apart, ledger = selected(cloud()), pen()
    assert Migration(width=1e-3)(apart, ledger, np.random.default_rng(0))[0] is apart.X
    assert ledger.spent == 0.0
    together = selected(cloud(spread=1e-4))
    X, F = Migration(width=1e-3)(together, ledger, np.random.default_rng(0))
    best = int(together.F.argmin())
    assert X[best].tolist() == together.X[best].tolist()
    assert F.tolist() == pytest.approx(bowl(X).tolist())
    assert np.ptp(X, axis=0).min() > 0.3
    assert ledger.spent == 11.0


def test_relative_variance_has_no_unit() -> None:
    F = np.array([1.0, 2.0, 6.0])
    assert evolution.relative_variance(F) == pytest.approx(np.var(F) / np.mean(F) ** 2)
    for without in (np.array([1.0, np.inf]), np.zeros(3)):
        assert evolution.relative_variance(without) == np.inf


def test_a_schedule_as_printed_searches_locally_where_the_repaired_one_evolves() -> None:
    repaired, printed = (PreySchedule(LevenbergMarquardt(), period=4, swapped=s) for s in (False, True))
    assert [g for g in range(1, 13) if repaired.due(g)] == [4, 8, 12]
    assert [printed.due(g) for g in range(1, 13)] == [not repaired.due(g) for g in range(1, 13)]
