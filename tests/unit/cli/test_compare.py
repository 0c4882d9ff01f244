"""`stoop compare` on the command line: what it writes, resumes, and refuses."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from stoop.cli.main import parser_for
from stoop_studies.cli import compare

SMALL = "--optimizers ps-gde-lm,ps-gde --problems paper-N --seeds 1 --budget"
Refused = Callable[..., str]


def test_writes_tables_and_page_goes_on_and_refuses_another_plan(
    done: Callable[..., str], refused: Refused
) -> None:
    Path("file").write_text("mine")
    assert "is a file" in refused(f"compare -o file {SMALL} 100")
    said = done(f"compare -o deep/out {SMALL} 100 --workers 1")
    assert "No rival beats ps-gde-lm here." in said
    assert "No optimizer claimed a wrong optimum" in said
    folder = Path("deep/out")
    assert sorted(p.name for p in folder.iterdir()) == [
        "compare.csv", "compare.html", "compare.sqlite", "runs.csv",
    ]  # fmt: skip
    before = {p.name: p.read_bytes() for p in folder.glob("compare.[ch]*")}
    done(f"compare -o deep/out {SMALL} 100")  # nothing is left to run
    assert {p.name: p.read_bytes() for p in folder.glob("compare.[ch]*")} == before
    line = f"stoop compare {SMALL.removesuffix(' --budget')} --first-seed 1 --budget 100<"
    assert line in before["compare.html"].decode(), "wherever it is made"
    assert "compare.sqlite" in refused(f"compare -o deep/out {SMALL} 50")
    done(f"compare -o deep/out {SMALL} 50 --overwrite --workers 1")


def test_a_flight_is_part_of_the_command() -> None:
    words = ["compare", "-o", "out", "--flight", "my logs", "--vehicle", "v.toml", "--maneuver", "1:2", "3:4"]
    told = compare._command(parser_for([*words]).parse_args([*words, "--budget", "2.5", "--workers", "3"]))
    assert told == (
        "stoop compare --flight 'my logs' --vehicle v.toml --maneuver 1:2 3:4"
        " --seeds 20 --first-seed 1 --budget 2.5"
    )
