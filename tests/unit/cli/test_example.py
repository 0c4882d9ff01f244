"""`stoop example` lists the examples and copies their files; every command in their README runs as it stands."""

from __future__ import annotations

import json
import re
import shlex
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest

from stoop.cli.main import main
from stoop.workflow import examples as listed

ROOT = Path(__file__).parents[3]


def test_all_are_listed_and_their_files_copied(
    done: Callable[..., str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    said, names = done("example"), listed.examples()
    assert {path.stem for path in (ROOT / "examples").glob("*.ipynb")} == set(names)
    assert all(name in said for name in names)
    for name in names:
        assert ("flight2" in done(f"example {name}")) == (name == "vtail"), (
            "flights that are needed are named"
        )
        wanted = listed.example(name).names
        assert sorted(path.name for path in Path(name).iterdir()) == sorted(wanted)
        for file in wanted:
            assert Path(name, file).read_bytes() == (ROOT / "examples" / file).read_bytes()
        cells = json.loads(Path(name, f"{name}.ipynb").read_text("utf-8"))["cells"]
        text = "".join("".join(cell["source"]) for cell in cells)
        assert all(file in text for file in wanted[1:]), "nothing that the notebook does not read"
    Path("error_bars/maneuver_3211.toml").write_text("mine")
    assert main(["example", "error_bars"]) == 2
    assert Path("error_bars/maneuver_3211.toml").read_text() == "mine"
    done("example error_bars --overwrite")
    assert Path("error_bars/maneuver_3211.toml").read_text() != "mine"


def test_an_installation_without_examples_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Callable[..., str]
) -> None:
    monkeypatch.setattr(listed, "folder", lambda: tmp_path)
    assert "no examples" in refused("example")


def test_commands_of_the_readme(examples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (examples / "README.md").read_text()
    commands = [shlex.split(line) for line in re.findall(r"^\$ stoop (.*)$", text, re.MULTILINE)]
    assert {words[0] for words in commands} >= {"trim", "linearize", "simulate", "info"}
    shutil.copytree(examples, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    for words in commands:
        assert main(words) == 0, words
