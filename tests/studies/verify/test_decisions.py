import numpy as np

from stoop_studies.findings import Setting
from stoop_studies.verify import decision_fleet, decisions

GOOD = {
    "coverage": 0.95, "bias": 1.0, "score": 3.0, "error": 0.1, "log_likelihood": 10.0, "theil": 0.1, "seconds": 4.0,
}  # fmt: skip


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


def test_a_seed_is_a_vehicle_of_its_own() -> None:
    one, other, again = (decision_fleet.pose("aircraft-calm", seed) for seed in (0, 1, 0))
    assert one.truth == again.truth
    assert one.truth != other.truth
    assert np.array_equal(one.flights["first"].column("q"), again.flights["first"].column("q"))
    assert not np.array_equal(one.flights["first"].column("q"), one.flights["second"].column("q"))
    assert all(abs(one.start.value(n) / v - 1.0) <= decision_fleet.SPREAD for n, v in one.truth.items())
