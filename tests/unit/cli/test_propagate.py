"""`stoop propagate`: tables, JSON and page of the demonstration; bad input in one line."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stoop.cli.main import main


@pytest.fixture(scope="module")
def fitted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("propagate") / "demo"
    assert main(["demo", "-o", str(folder)]) == 0
    return folder


def test_tables_and_page(fitted: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    page = tmp_path / "page.html"
    given = [
        "propagate",
        str(fitted),
        "--draws",
        "200",
        "--expression",
        "ratio=Cmalpha/CLalpha",
        "-o",
        str(page),
    ]
    assert main(given) == 0
    printed = capsys.readouterr().out
    for words in (
        "200 draws from the covariance",
        "static margin",
        "short period, damping",
        "ratio",
        "chord",
    ):
        assert words in printed
    html = page.read_text(encoding="utf-8")
    assert "What the uncertainty means" in html
    assert "Cmalpha/CLalpha" in html
    assert main(given) == 2
    assert "page.html" in capsys.readouterr().err


def test_json_holds_the_truth(fitted: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["propagate", str(fitted), "--draws", "300", "--airspeed", "33:38", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["format"] == "stoop-propagation/1"
    margin = next(f for f in found["figures"] if f["name"] == "static margin")
    assert margin["ci95_lower"] < 2.12 / 4.78 < margin["ci95_upper"]
    assert found["curves"][0]["airspeed"][0] == 33.0


@pytest.mark.parametrize(
    ("given", "message"),
    [
        (["--expression", "x=CLalpa"], "no number 'CLalpa'; did you mean CLalpha"),
        (["--expression", "CLalpha"], "write NAME=EXPRESSION"),
        (["--expression", "a=CD0", "a=CL0"], "given twice"),
        (["--airspeed", "40"], "write A:B in m/s"),
        (["--airspeed", "40:30"], "write A:B in m/s"),
        (["--airspeed", "2:3"], "nothing trims at 3 m/s with the estimates; give --airspeed A:B"),
        (["--source", "posterior"], "its posterior was not sampled"),
        (["--draws", "5"], "needs 100 or more"),
    ],
)
def test_bad_input_is_one_line(
    fitted: Path, given: list[str], message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    capsys.readouterr()
    assert main(["propagate", str(fitted), *given]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1


def test_the_folder_of_a_result_is_linearized_as_its_vehicle_file(
    fitted: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shown = []
    for model in (fitted, fitted / "vehicle.toml"):
        capsys.readouterr()
        assert main(["linearize", str(model)]) == 0
        shown.append(capsys.readouterr().out)
    assert shown[0] == shown[1]
