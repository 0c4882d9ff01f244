"""The paper's experiments with few seeds, whole: what the documentation says of many seeds shows in few."""

import csv
from pathlib import Path

import pytest

from stoop.cli.main import main


def reproduce(folder: Path, name: str, runs: int, workers: int = 1) -> list[dict[str, str]]:
    assert main(["reproduce", name, "-o", str(folder), "--runs", str(runs), "--workers", str(workers)]) == 0
    with (folder / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def test_table_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rows = {(r["method"], int(r["iterations"])): r for r in reproduce(tmp_path, "table1", 1)}
    said = capsys.readouterr().out
    assert len(rows) == 16
    for iterations in (500, 1000, 1500, 2000):
        assert rows["ps-gde", iterations]["within_1e-6"] == "1"
        assert rows["ps-gde-lm", iterations]["within_1e-6"] == "1"
        errors = [float(rows[m, iterations]["mean_error"]) for m in ("ga", "pso", "ps-gde")]
        assert errors == sorted(errors, reverse=True), "the paper's order"
    assert float(rows["ps-gde", 2000]["median_evaluations_to_target"]) == pytest.approx(5752, rel=0.2)
    assert float(rows["ps-gde", 2000]["mean_evaluations"]) > 90_000.0, "nothing is stopped early"
    assert float(rows["ps-gde-lm", 2000]["mean_evaluations"]) < 100.0, "the default ends by itself"
    assert "- reproduces: The mean error falls from GA over PSO to PS-GDE" in said


@pytest.mark.parametrize(
    ("name", "part", "models", "holds"),
    [
        ("lateral", "biases", (6 + 1) * 3, [
            "holds: default: all 18 values without noise", "does not reproduce: The asymmetry terms absorb most",
            "holds: Freeing the biases themselves instead removes the error",
        ]),
        ("longitudinal-full", "propulsion", 1 + (1 + 1) * 3, [
            "holds: default: all 14 values without noise", "reproduces: The V terms catch the propulsion",
            "reproduces: What they catch is the thrust slope",
            "reproduces: They keep the propulsion out of the other coefficients",
        ]),
    ],
)  # fmt: skip
def test_the_claims_of_the_text(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, part: str, models: int, holds: list[str]
) -> None:
    reproduce(tmp_path, name, 1)
    said = capsys.readouterr().out
    assert [words for words in holds if f"- {words}" not in said] == []
    with (tmp_path / f"{name}-{part}.csv").open(newline="", encoding="utf-8") as file:
        assert len(list(csv.DictReader(file))) == models
