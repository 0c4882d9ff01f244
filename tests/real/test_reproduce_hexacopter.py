"""The real hexacopter of `stoop reproduce multirotor`: outputs mixed anew, and the optimum that is found blind."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from stoop import optimize
from stoop.flight import load
from stoop_studies.problems import hexacopter, pose

COMMITTED = Path(__file__).parents[2] / "docs" / "reproduce"


def records(name: str) -> list[dict[str, str]]:
    with (COMMITTED / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return [row for row in csv.DictReader(file) if row["case"] == "real"]


def test_outputs_mixed_of_moments_are_those_that_were_logged(shared_data: Path) -> None:
    """A second's mean of what the mixer makes of 236 Hz is that of the outputs, which were logged at 43 Hz."""
    mapping = Path(hexacopter.__file__).parent / "hexacopter_mapping.toml"
    flight = load(shared_data / hexacopter.FOLDER, mapping, hexacopter.RATE)
    mixed, used = hexacopter.mixed(flight), (flight.time > 140.0) & (flight.time < 214.0)
    holes = np.array(
        [np.isnan([f.column(f"pwm_{i}") for i in range(1, 7)]).any(axis=0) for f in (flight, mixed)]
    )
    assert holes[0].any()
    assert not (holes[0] & ~holes[1]).any(), "no number where no output was recorded"
    for i in range(1, 7):
        both = np.stack([flight.column(f"pwm_{i}"), mixed.column(f"pwm_{i}")])[:, used]
        both = both[:, np.isfinite(both).all(axis=0)]
        seconds = both[:, : both.shape[1] // 50 * 50].reshape(2, -1, 50).mean(axis=2)
        assert np.corrcoef(seconds)[0, 1] > 0.9
        assert np.abs(np.diff(seconds.mean(axis=1))) < 5.0, "us"


def test_the_default_finds_the_least_cost_known_blind(shared_data: Path) -> None:
    posed = pose("hexacopter", 0, data=str(shared_data))
    best = {r["parameter"]: r for r in records("multirotor-parameters") if r["method"] == "ps-gde-lm"}
    found = optimize.minimize(optimize.create(), posed.problem, seed=77)
    assert found.status == "converged"
    assert found.cost < posed.target
    least = float(next(r for r in records("multirotor") if r["method"] == "ps-gde-lm")["median_fitness"])
    assert found.cost == pytest.approx(least, rel=0.02)
    for name, value in zip(posed.parameters, posed.values(found.z), strict=True):
        row = best[name]
        assert value == pytest.approx(float(row["truth_or_best"]), abs=0.5 * float(row["deviation"]))
