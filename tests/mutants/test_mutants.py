"""The planted defects fit the sources, and every room has one."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
MUTANTS = tomllib.loads((Path(__file__).parent / "mutants.toml").read_text("utf-8"))["mutant"]


def test_every_defect_can_be_planted_and_every_room_has_one() -> None:
    names = [one["name"] for one in MUTANTS]
    assert len(set(names)) == len(names) >= 60
    sources = {file: (ROOT / file).read_text("utf-8") for file in {one["file"] for one in MUTANTS}}
    lost = [one["name"] for one in MUTANTS if sources[one["file"]].count(one["old"]) != 1]
    assert not lost, f"plant these elsewhere, or remove them: {', '.join(lost)}"
    rooms = {path.parent.name for path in (ROOT / "src/stoop").glob("*/__init__.py")} - {"extend"}
    packages = {path.name for path in (ROOT / "src").glob("stoop_*")} - {"stoop_studies"}
    parts = [Path(one["file"]).parts for one in MUTANTS]
    assert rooms | packages <= {own[2] if own[1] == "stoop" else own[1] for own in parts}


def test_the_test_that_noticed_a_defect_exists() -> None:
    gone = []
    for one in MUTANTS:
        file, _, name = one["killed_by"].partition("::")
        known = (ROOT / file).is_file() and f"def {name.partition('[')[0]}(" in (ROOT / file).read_text(
            "utf-8"
        )
        gone += [] if known or not file or (not name and (ROOT / file).is_file()) else [one["name"]]
    assert not gone, f"run scripts/mutants.py for these, and note what notices them: {', '.join(gone)}"
