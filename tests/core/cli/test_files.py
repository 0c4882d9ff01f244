"""Mappings, models, examples and vehicle files: printed or written as they stand, and never over another."""

import json
import re
import shlex
import shutil
from pathlib import Path

import pytest
from helpers.command_line import Done, Refused

import stoop.data
from stoop.cli.main import main
from stoop.vehicle.builtin import BUILT_IN
from stoop.workflow import examples as listed

ROOT = Path(__file__).parents[3]


def test_all_are_listed_and_their_files_copied(done: Done, here: Path) -> None:
    said, names = done("example"), listed.examples()
    assert {path.stem for path in (ROOT / "examples").glob("*.ipynb")} == set(names)
    assert all(name in said for name in names)
    for name in names:
        assert ("flight2" in done(f"example {name}")) == (name == "vtail"), "a flight that is needed"
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


def test_an_installation_without_examples_says_so(monkeypatch: pytest.MonkeyPatch, refused: Refused) -> None:
    monkeypatch.setattr(listed, "folder", Path)
    assert "no examples" in refused("example")


def test_commands_of_the_readme(examples: Path, here: Path) -> None:
    text = (examples / "README.md").read_text()
    commands = [shlex.split(line) for line in re.findall(r"^\$ stoop (.*)$", text, re.MULTILINE)]
    assert {words[0] for words in commands} >= {"trim", "linearize", "simulate", "info"}
    shutil.copytree(examples, here, dirs_exist_ok=True)
    for words in commands:
        assert main(words) == 0, words


DATA = Path(next(iter(stoop.data.__path__)))


def test_listed_printed_and_written_as_they_stand(tmp_path: Path, done: Done) -> None:
    _, *lines, own, example = done("vehicle").splitlines()
    assert "stoop vehicle new LOG" in own
    assert [line.split()[0] for line in lines] == list(BUILT_IN)
    assert all(len(line.split()) > 2 for line in lines)
    assert "stoop vehicle quad-x -o my.toml" in example
    for name, file in BUILT_IN.items():
        target = tmp_path / f"{name}.toml"
        assert f"stoop trim {target}" in done(f"vehicle {name} -o {target}")
        assert target.read_bytes() == (DATA / file).read_bytes()
        assert done(["vehicle", name]).encode() == target.read_bytes()
        assert target.read_text(encoding="utf-8").startswith("# ")
    target.write_text("mine", encoding="utf-8")
    assert main(["vehicle", "quad-x", "-o", str(target)]) == 2
    assert target.read_text(encoding="utf-8") == "mine"
    done(f"vehicle quad-x -o {target} --overwrite")
    assert target.read_bytes() == (DATA / "quad_x.toml").read_bytes()
    assert len([*tmp_path.iterdir()]) == len(BUILT_IN)
