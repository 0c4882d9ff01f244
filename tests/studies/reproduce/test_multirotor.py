from typing import Any

import numpy as np

from stoop_studies.findings import Setting
from stoop_studies.problems import pose
from stoop_studies.reproduce.multirotor import PROBLEM, STOPS, Multirotor, cases, seeds
from stoop_studies.reproduce.suite import METHODS

SETTING = Setting(runs=2)


def made_up(errors: dict[str, float], hits: dict[str, float | None]) -> dict[str, Any]:
    truth = pose(PROBLEM, 0).truth
    assert truth is not None
    return {
        run.key: {
            "values": (truth * (1.0 + errors[method])).tolist(), "cost": 1e5 * errors[method], "hit": hits[method],
            "evaluations": 1e4,
        }
        for run in Multirotor().plan(SETTING).runs
        for method in METHODS
        if f"/{METHODS[method]}/" in run.key
    }  # fmt: skip


def verdicts(results: dict[str, Any]) -> dict[str, str]:
    found = Multirotor().findings(SETTING, results)
    assert len(found.rows) == len(METHODS) * 5
    assert len(found.parts["parameters"][1]) == len(METHODS) * 2 * 10 + 10
    assert "--data DIR" in str(found.sections[-1])
    return {claim.statement: claim.verdict for claim in found.claims}


def test_as_it_should_be() -> None:
    errors = {"GA": 0.03, "PSO": 0.02, "PS-GDE": 1e-5, "default": 1e-8}
    said = verdicts(made_up(errors, {"GA": None, "PSO": 9000.0, "PS-GDE": 4000.0, "default": 60.0}))
    assert [v for k, v in said.items() if k.startswith("GA")] == ["does not hold"]
    others = [v for k, v in said.items() if not k.startswith("GA")]
    assert others == ["reproduces", *["holds"] * 6, "does not hold"]


def test_the_real_flight_is_run_with_half_the_seeds_where_its_data_is(tmp_path: Any) -> None:
    there = Setting(runs=5, seed=7, data=tmp_path)
    assert cases(SETTING) == ("clean", "noise")
    assert cases(there) == ("clean", "noise", "real")
    assert list(seeds("real", there)) == [7, 8, 9]
    runs = Multirotor().plan(there).runs
    assert len(runs) == len(METHODS) * (5 * (len(STOPS["clean"]) + 1) + 3 * len(STOPS["real"]))
    assert len({run.key for run in runs}) == len(runs)
    assert np.all([run.arguments["history"] == 0 for run in runs])
