"""Rows of `stoop verify decisions` by hand, and which decision earns its place by them."""

from __future__ import annotations

from stoop_studies.findings import Setting
from stoop_studies.verify import decisions

GOOD = {"coverage": 0.95, "bias": 1.0, "log_likelihood": 10.0, "theil": 0.1, "seconds": 4.0}


def record(**without: dict[str, float | str]) -> dict[str, object]:
    return {"failed": False, "default": GOOD, "without": without, "method": "output-error"}


def test_a_decision_whose_absence_makes_errors_larger_earns_its_place() -> None:
    samples = {
        "a": [
            record(bounds={**GOOD, "bias": 2.0}, gusts=GOOD),
            record(bounds={**GOOD, "bias": 3.0}, gusts=GOOD),
        ],
        "b": [{"failed": True, "without": {}}, record(faults={"error": "diverges"})],
    }
    found = decisions.show(Setting(1), samples)
    verdicts = {claim.statement: claim.verdict for claim in found.claims}
    assert verdicts["The decision bounds earns its place"] == "holds"
    assert verdicts["The decision gusts earns its place"] == "does not hold"
    assert verdicts["The decision faults earns its place"] == "holds"  # no fit without it
    (bounds,) = (row for row in decisions._rows(samples["a"]) if row["without"] == "bounds")
    assert (bounds["applied"], bounds["bias"], bounds["bias_se"]) == (2, 1.5, 0.5)
    assert bounds["seconds"] == 0.0
