"""Rows of `stoop verify decisions` by hand, which decision earns its place by them, and a few vehicles of its fleet."""

from __future__ import annotations

import numpy as np
import pytest

from stoop.strategy import Strategy
from stoop_studies.findings import Setting
from stoop_studies.verify import decision_fleet, decisions

GOOD = {
    "coverage": 0.95,
    "bias": 1.0,
    "score": 3.0,
    "error": 0.1,
    "log_likelihood": 10.0,
    "theil": 0.1,
    "seconds": 4.0,
}


def record(**without: dict[str, float | str]) -> dict[str, object]:
    return {"failed": False, "default": GOOD, "without": without, "method": "output-error"}


def with_bias(*biases: float) -> list[dict[str, object]]:
    return [record(bounds={**GOOD, "bias": bias}, gusts=GOOD) for bias in biases]


def test_a_decision_whose_absence_makes_errors_larger_earns_its_place() -> None:
    lost = [record(faults={"failure": "diverges"})] * decisions.MIN_VEHICLES
    samples = {
        "aircraft-calm": with_bias(2.0, 3.0, 2.0, 2.5, 2.2),
        "aircraft-gusts": [{"failed": True, "without": {}}, *lost],
        "real-v-tail": with_bias(0.1),
    }
    found = decisions.show(Setting(1), samples)
    verdicts = {claim.statement.split()[2]: claim.verdict for claim in found.claims[1:]}
    assert verdicts == {"bounds": "holds", "gusts": "not shown", "faults": "holds"}
    (bounds,) = (row for row in decisions._rows(with_bias(2.0, 3.0)) if row["without"] == "bounds")
    assert (bounds["vehicles"], bounds["bias"], bounds["bias_se"]) == (2, 1.5, 0.5)
    assert bounds["seconds"] == 0.0


@pytest.mark.parametrize(
    ("biases", "verdict"),
    [
        ((2.0, 3.0, 2.0, 2.5), "not shown"),  # too few
        ((0.1, 3.0, -2.0, 2.5, -1.0), "not shown"),  # no more than chance
        ((0.5, 0.4, 0.6, 0.5, 0.45), "does not hold"),  # better without
        ((1.5, 1.4, 1.6, 1.5, 1.45), "holds"),
    ],
)
def test_a_claim_needs_vehicles_and_a_standard_error(biases: tuple[float, ...], verdict: str) -> None:
    found = decisions.show(Setting(1), {"aircraft-calm": with_bias(*biases)})
    (claim,) = (one for one in found.claims if "bounds" in one.statement)
    assert claim.verdict == verdict
    assert f"{len(biases)} vehicles" in claim.figures


def test_two_decisions_that_replace_each_other_work_together() -> None:
    """Without either nothing changes, without both the error is larger by one."""
    one = record(**{"bounds": GOOD, "gusts": GOOD, "bounds + gusts": {**GOOD, "bias": 2.0}})
    (row,) = decisions._together([one, one])
    assert (row["pair"], row["vehicles"], row["bias"], row["coverage"]) == ("bounds + gusts", 2, 1.0, 0.0)


@pytest.mark.parametrize(
    ("case", "called"),
    [
        ("aircraft-clipped", "faults"),
        ("aircraft-stuck", "stuck-channels"),
        ("aircraft-reduced", "recorded-motion"),
    ],
)
def test_a_case_calls_for_its_decision(case: str, called: str) -> None:
    found = decisions.compare({"case": case, "seed": 3}, [None])[0]
    assert called in found["without"]
    assert "all" in found["without"]
    assert set(found["default"]) == set(decisions.FIGURES)
    assert found["default"]["bias"] < 2.5


def test_a_seed_is_a_vehicle_of_its_own() -> None:
    one, other, again = (decision_fleet.pose("aircraft-calm", seed) for seed in (0, 1, 0))
    assert one.truth == again.truth
    assert one.truth != other.truth
    assert np.array_equal(one.flights["first"].column("q"), again.flights["first"].column("q"))
    assert not np.array_equal(one.flights["first"].column("q"), one.flights["second"].column("q"))
    assert all(abs(one.start.value(n) / v - 1.0) <= decision_fleet.SPREAD for n, v in one.truth.items())


def test_strategies_leave_out_each_and_pairs_for_the_first_seeds() -> None:
    class Applied:
        def __init__(self, name: str) -> None:
            self.name, self.state = name, "applied"

    class Done:
        decisions = (Applied("bounds"), Applied("gusts"))

    names = [name for name, _ in decisions.strategies(Done(), 0)]  # type: ignore[arg-type]
    assert names == ["all", "bounds", "gusts", "bounds + gusts"]
    later = dict(decisions.strategies(Done(), decisions.PAIR_SEEDS))  # type: ignore[arg-type]
    assert list(later) == ["all", "bounds", "gusts"]
    assert later["all"] == Strategy.textbook()
