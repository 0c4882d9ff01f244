"""Size and power of the tests of extensions: made-up results turn every verdict round; one flight end to end."""

from __future__ import annotations

from typing import Any

import pytest

from stoop_studies.findings import Setting
from stoop_studies.verify.defects import RIGHT, defects
from stoop_studies.verify.extensions import CASES, EXPERIMENT, REPEATS, examine
from stoop_studies.verify.study import run_key

SETTING = Setting(runs=10)


def flight(found: list[str], named: bool, seconds: float = 0.5) -> dict[str, Any]:
    return {
        "found": found, "value": 0.04, "rivals": 1, "first": named, "named": named, "tested": 100, "harm": 10.0,
        "outside": 0.3, "status": "converged", "fit_seconds": 1.0, "test_seconds": seconds,
    }  # fmt: skip


def made_up(suggested: int = 0, missed: int = 0, seconds: float = 0.5) -> dict[str, Any]:
    """Return results in which so many fits of each right model suggest something, and so many of each defect miss it."""
    out = {}
    for seed in SETTING.seeds:
        for case in CASES:
            if case in RIGHT:
                flights = [
                    flight(["CLbeta"] if REPEATS * seed + k < suggested else [], False, seconds)
                    for k in range(REPEATS)
                ]
            else:
                name = min(defects()[case].names)
                flights = [flight([name if seed >= missed else "CLbeta"], seed >= missed, seconds)]
            out[run_key(case, seed)] = {"flights": flights}
    return out


def verdicts(results: dict[str, Any]) -> list[str]:
    return [claim.verdict for claim in EXPERIMENT.findings(SETTING, results).claims]


def test_size_power_and_time() -> None:
    assert verdicts(made_up()) == ["holds"] * 4
    assert verdicts(made_up(suggested=2)) == ["holds"] * 4
    assert verdicts(made_up(suggested=3)) == ["does not hold", *["holds"] * 3]
    assert verdicts(made_up(missed=2)) == ["holds", "does not hold", "does not hold", "holds"]
    assert verdicts(made_up(seconds=1.5)) == [*["holds"] * 3, "does not hold"]


def test_every_case_has_a_row() -> None:
    found = EXPERIMENT.findings(SETTING, made_up())
    rows = {row[0]: dict(zip(found.head, row, strict=True)) for row in found.rows}
    assert tuple(rows) == CASES
    assert rows["none"]["flights"] == REPEATS * SETTING.runs
    assert rows["none"]["named"] is None
    assert rows["lag-aileron"]["most_often"] == "controls.aileron.delay"


def test_one_flight() -> None:
    (result,) = examine({"case": "lag-aileron", "seed": 1}, [None])
    (found,) = result["flights"]
    assert found["named"]
    assert found["harm"] > 5.0
    assert found["value"] == pytest.approx(0.04, abs=0.02)
