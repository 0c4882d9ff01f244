from math import inf

import numpy as np
import pytest
from scipy import stats

from stoop_studies.compare.measures import running_time, score, sign_test
from stoop_studies.compare.page import distribution
from stoop_studies.compare.race import Race, levels


def runs(name: str, outcomes: list[float | None], budget: float = 1000.0) -> list[Race]:
    found = []
    for seed, hit in enumerate(outcomes, start=1):
        spent, cost, status = (budget, 2.0, "budget") if hit is None else (hit, 1.0, "target")
        hits = (None if hit is None else hit / 2.0, hit)
        found.append(Race("p", name, seed, hit, hits, spent, cost, status, 1.0, 100.0))
    return found


def test_running_time_counts_failures_until_they_ended() -> None:
    assert running_time(runs("a", [100.0, None, 300.0, None])) == (100.0 + 300.0 + 2 * 1000.0) / 2
    assert running_time(runs("a", [None, None])) == inf


def test_interval_agrees_with_scipys_bootstrap() -> None:
    times = np.random.default_rng(1).lognormal(5.0, 0.5, 60).tolist()
    found = score(runs("a", times), runs("a", times)).ert
    drawn = {"n_resamples": 4000, "method": "percentile", "rng": np.random.default_rng(2)}
    scipys = stats.bootstrap((times,), np.mean, **drawn).confidence_interval
    assert found.value == pytest.approx(np.mean(times))
    assert (found.low, found.high) == pytest.approx((scipys.low, scipys.high), rel=0.02)


def test_ratio_draws_the_same_seeds_for_both() -> None:
    """Twice as slow on every seed is twice as slow in every resample, however much seeds differ."""
    times = np.random.default_rng(1).lognormal(5.0, 2.0, 30)
    found = score(runs("b", (2.0 * times).tolist()), runs("a", times.tolist())).ratio
    assert (found.value, found.low, found.high) == pytest.approx((2.0, 2.0, 2.0))


def test_ahead_and_clear() -> None:
    quick, slow = [10.0, 11.0, 12.0, 10.0], [20.0, 21.0, 19.0, 22.0]
    found = score(runs("b", quick), runs("a", slow))
    doubtful = score(runs("b", [10.0, 30.0, 10.0, 10.0]), runs("a", [20.0, 10.0, 30.0, 20.0]))
    assert [found.ahead, found.clear, doubtful.ahead, doubtful.clear] == [True, True, True, False]


def test_a_wrong_optimum_is_claimed_and_clearly_above() -> None:
    def ended(status: str, cost: float, hit: float | None = None) -> Race:
        return Race("p", "o", 1, hit, (hit,), 10.0, cost, status, 1.0, 100.0)

    assert ended("converged", 1.5).wrong
    assert not ended("converged", 1.0005).wrong
    assert not ended("budget", 1.5).wrong
    assert not ended("converged", 0.9, hit=5.0).wrong
    several = [ended("converged", 1.5), ended("converged", 1.0005), ended("budget", 1.0005)]
    found = score(several, several)
    assert (found.wrong, found.short) == (1, 1)


@pytest.mark.parametrize(("a", "b"), [(0, 0), (5, 0), (3, 4), (12, 2), (40, 60)])
def test_sign_test_agrees_with_scipy(a: int, b: int) -> None:
    expected = stats.binomtest(a, a + b).pvalue if a + b else 1.0
    assert sign_test(a, b) == pytest.approx(expected)


def test_distribution_is_the_share_of_all_targets() -> None:
    series = distribution(runs("a", [10.0, None, 40.0]), "a", 1000.0)
    reached = dict(zip(series.x.tolist(), series.y.tolist(), strict=True))
    expected = {1.0: 0.0, 5.0: 1 / 6, 10.0: 2 / 6, 20.0: 3 / 6, 40.0: 4 / 6, 1000.0: 4 / 6}
    assert reached == pytest.approx(expected)


def test_levels_fall_evenly_to_the_target() -> None:
    found = levels(1e4, 1e-6)
    assert len(found) == 10
    assert found[-1] == pytest.approx(1e-6)
    assert found[:-1] / found[1:] == pytest.approx(10.0)
    assert levels(inf, 3.0) == pytest.approx(3.0)
