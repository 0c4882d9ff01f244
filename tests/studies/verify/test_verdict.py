"""Error rates of the verdict: made-up results turn every claim round; one flight end to end."""

from __future__ import annotations

from typing import Any

from stoop_studies.findings import Setting
from stoop_studies.verify.defects import RIGHT
from stoop_studies.verify.study import run_key
from stoop_studies.verify.verdict import CASES, EXPERIMENT, HARM, REPEATS, examine

SETTING = Setting(runs=4)


def flight(grade: str, harm: float) -> dict[str, Any]:
    return {
        "grade": grade, "uses": [], "against": [], "harm": harm, "off": None, "seconds": 5.0, "inside": [0.95],
    }  # fmt: skip


def made_up(refused: int = 0, trusted: int = 0, harm: float = 10.0) -> dict[str, Any]:
    """Return results in which so many right models of a kind are refused, and so many of one defect are trusted."""
    out = {}
    for seed in SETTING.seeds:
        for case in CASES:
            if case in RIGHT:
                flights = [
                    flight("do not use" if REPEATS * seed + k < refused else "trusted", 1.0)
                    for k in range(REPEATS)
                ]
            else:
                flights = [flight("trusted" if seed < trusted else "do not use", harm)]
            out[run_key(case, seed)] = {"flights": flights}
    return out


def verdicts(results: dict[str, Any]) -> list[str]:
    return [claim.verdict for claim in EXPERIMENT.findings(SETTING, results).claims]


def test_error_rates() -> None:
    assert verdicts(made_up()) == ["holds", "holds"]
    assert verdicts(made_up(refused=1)) == ["holds", "holds"]
    assert verdicts(made_up(refused=2)) == ["does not hold", "holds"]
    assert verdicts(made_up(trusted=1)) == ["holds", "does not hold"]
    assert verdicts(made_up(trusted=4, harm=0.9 * HARM)) == ["holds", "holds"], "no bad model"


def test_every_case_has_a_row() -> None:
    found = EXPERIMENT.findings(SETTING, made_up())
    rows = {row[0]: dict(zip(found.head, row, strict=True)) for row in found.rows}
    assert tuple(rows) == CASES
    assert (rows["none"]["flights"], rows["none"]["bad"]) == (REPEATS * SETTING.runs, 0)
    assert (rows["lag-all"]["bad"], rows["lag-all"]["do not use"]) == (4, 4)


def test_a_lag_of_all_servos_is_named_and_leaves_no_control_design() -> None:
    """Error bars hold what it moves, by far more than those of the model as it is, and are too wide to design by."""
    (result,) = examine({"case": "lag-all", "seed": 1}, [None])
    (found,) = result["flights"]
    assert found["grade"] == "usable"
    assert {"verdict-lacks", "verdict-need-inaccurate"} <= set(found["against"])
    assert found["uses"] == ["simulation", "performance"]
    assert found["harm"] > 5.0
    assert found["off"] < 0.2
