"""`stoop example` lists the examples and copies their files, from a working copy or from a wheel."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from stoop.cli.main import main
from stoop.workflow import examples

ROOT = Path(__file__).parents[3]


def test_all_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["example"]) == 0
    said = capsys.readouterr().out
    assert {path.stem for path in (ROOT / "examples").glob("*.ipynb")} == set(examples.examples())
    assert all(name in said for name in examples.examples())
    assert "Which propeller is damaged?" in said


@pytest.mark.parametrize("name", examples.examples())
def test_files_are_copied(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["example", name]) == 0
    copied = sorted(path.name for path in (tmp_path / name).iterdir())
    assert copied == sorted(examples.example(name).names)
    for file in copied:
        assert (tmp_path / name / file).read_bytes() == (ROOT / "examples" / file).read_bytes()
    text = "".join(
        "".join(c["source"])
        for c in json.loads((tmp_path / name / f"{name}.ipynb").read_text("utf-8"))["cells"]
    )
    assert all(
        file in text for file in examples.example(name).names[1:]
    )  # nothing that the notebook does not read


def test_an_existing_file_is_replaced_only_on_request(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "here"
    command = ["example", "error_bars", "-o", str(target)]
    assert main(command) == 0
    (target / "maneuver_3211.toml").write_text("mine")
    assert main(command) == 2
    assert (target / "maneuver_3211.toml").read_text() == "mine"
    assert "--overwrite" in capsys.readouterr().err
    assert main([*command, "--overwrite"]) == 0
    assert (target / "maneuver_3211.toml").read_text() != "mine"


def test_flights_that_are_needed_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["example", "vtail", "-o", str(tmp_path / "v")]) == 0
    assert "flight2" in capsys.readouterr().out


def test_wrong_names_and_missing_ones(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["example", "quadroter", "-o", str(tmp_path / "q")]) == 2
    assert "did you mean quadrotor?" in capsys.readouterr().err
    assert main(["example", "-o", str(tmp_path / "q")]) == 2
    assert "needs the name" in capsys.readouterr().err
    assert not (tmp_path / "q").exists()


def test_an_installation_without_examples_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(examples, "folder", lambda: tmp_path)
    assert main(["example"]) == 2
    assert "no examples" in capsys.readouterr().err
