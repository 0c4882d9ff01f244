from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from stoop.optimize import Ledger
from stoop.optimize.ladder import GATE, Optima, explains, passes
from stoop.optimize.ledger import Evaluations
from stoop.optimize.local_refinement import Refinement


def pen(problem: Any) -> Ledger:
    return Ledger(problem, Evaluations.none(problem))


@dataclass
class Known:
    known: float
    dimension, extra, prices = 1, 0, (0.5, 1.0)

    def reference(self, rung: int) -> float:
        return self.known


def test_gates() -> None:
    for reference, open_ in ((np.nan, True), (np.inf, True), (0.0, False)):
        assert explains(pen(Known(reference)), 5.0, 0) is open_, "without a reference there is no gate"
    ledger = pen(Known(100.0))
    assert explains(ledger, GATE * 100.0, 0)
    assert not explains(ledger, GATE * 100.0 + 1e-9, 0)
    # an imperfect model never explains, but it may do as well as any
    assert not passes(ledger, 60.0, 0, np.array([np.inf, np.inf]))
    assert passes(ledger, 60.0, 0, np.array([55.0, np.inf]))
    assert not passes(ledger, 60.0, 0, np.array([30.0, np.inf]))
    assert not passes(ledger, np.inf, 0, np.array([np.inf, np.inf]))


def ends(*rows: Any) -> Optima:
    found = Optima.none(2)
    for cost, lineage, ending in rows:
        found = found.add(Refinement(np.zeros(3), cost, ending, 5), lineage)
    return found


def test_confirmation_needs_two_independent_refinements_to_the_best() -> None:
    for second, confirmed in (
        ([], False),
        ([(100.05, 2, "converged")], True),
        ([(100.05, 2, "agreed")], True),
        ([(100.05, 1, "converged")], False),  # not independent
        ([(100.5, 2, "converged")], False),  # another optimum
        ([(100.05, 2, "limit")], False),
        ([(50.0, 2, "converged")], False),  # a better one: begin again
        ([(50.0, 2, "stalled"), (100.0, 3, "converged")], False),
        ([(300.0, 2, "hopeless"), (100.0, 3, "converged")], True),
    ):
        rows = [(100.0, 1, "converged"), *second]
        assert ends(*rows).confirmed(min(r[0] for r in rows), 1e4) is confirmed, second
    assert not ends((100.0, 1, "stalled"), (100.05, 2, "converged")).confirmed(100.0, 1e4)
    exact = ends((1e-11, 1, "converged"), (3e-12, 2, "converged"))
    assert exact.confirmed(3e-12, 1e4)
    assert not exact.confirmed(3e-12, np.inf)


def test_three_must_agree_where_much_is_left_unexplained() -> None:
    two = ends((100.0, 1, "converged"), (100.05, 2, "agreed"))
    assert two.confirmed(100.0, 1001.0)
    assert not two.confirmed(100.0, 999.0)
    assert two.add(Refinement(np.zeros(3), 100.02, "agreed", 5), 3).confirmed(100.0, 999.0)
    assert not two.add(Refinement(np.zeros(3), 100.02, "agreed", 5), 2).confirmed(100.0, 999.0)
    assert not ends(*[(100.0, i, "agreed") for i in range(4)]).confirmed(100.0, 999.0)
