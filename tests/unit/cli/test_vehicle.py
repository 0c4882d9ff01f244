"""`stoop vehicle`: the packaged files as they stand, comments included, and never over another."""

from __future__ import annotations

from pathlib import Path

import pytest

import stoop.data
from stoop.cli.main import main
from stoop.vehicle.builtin import BUILT_IN, resolve_vehicle

DATA = Path(next(iter(stoop.data.__path__)))


@pytest.mark.parametrize("name", BUILT_IN)
def test_written_as_it_stands(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "my.toml"
    assert main(["vehicle", name, "-o", str(target)]) == 0
    assert f"stoop trim {target}" in capsys.readouterr().out
    assert target.read_bytes() == (DATA / BUILT_IN[name]).read_bytes()
    assert target.read_text(encoding="utf-8").startswith("# ")
    assert resolve_vehicle(target).structure == resolve_vehicle(name).structure


def test_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["vehicle", "quad-x"]) == 0
    assert capsys.readouterr().out == (DATA / "quad_x.toml").read_text(encoding="utf-8")


def test_never_over_another(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    target = tmp_path / "my.toml"
    target.write_text("mine", encoding="utf-8")
    assert main(["vehicle", "quad-x", "-o", str(target)]) == 2
    assert "exists already" in capsys.readouterr().err
    assert target.read_text(encoding="utf-8") == "mine"
    assert main(["vehicle", "quad-x", "-o", str(target), "--overwrite"]) == 0
    assert target.read_text(encoding="utf-8") != "mine"
    assert [p.name for p in tmp_path.iterdir()] == ["my.toml"]


def test_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["vehicle"]) == 0
    _, *lines, own, example = capsys.readouterr().out.splitlines()
    assert "stoop vehicle new LOG" in own
    assert [line.split()[0] for line in lines] == list(BUILT_IN)
    assert all(len(line.split()) > 2 for line in lines)
    assert "stoop vehicle quad-x -o my.toml" in example


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["quad_x.toml"], "did you mean the built-in vehicle quad-x?"),
        (["submarine"], "there is no such built-in vehicle"),
        (["-o", "my.toml"], "-o needs the name of a vehicle"),
    ],
)
def test_asked_wrongly(
    words: list[str], said: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    assert main(["vehicle", *words]) == 2
    assert said in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
