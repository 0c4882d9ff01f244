"""`stoop compare` on the command line: what it writes, and what it says to bad input, in one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from stoop.cli.main import main, parser_for
from stoop.errors import IdentificationError
from stoop_studies.cli import compare

SMALL = ["--optimizers", "ps-gde-lm,ps-gde", "--problems", "paper-N", "--seeds", "2", "--budget", "300"]


def refusal(words: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Return the one line that is said; nothing may be written."""
    assert main(["compare", *words]) == 2
    (line,) = capsys.readouterr().err.splitlines()
    return line


def test_writes_tables_and_page_and_says_who_is_ahead(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "deep" / "out"
    assert main(["compare", "-o", str(folder), *SMALL, "--workers", "1"]) == 0
    said = capsys.readouterr().out
    assert "No rival beats ps-gde-lm here." in said
    assert "No optimizer claimed a wrong optimum" in said
    assert sorted(p.name for p in folder.iterdir()) == [
        "compare.csv", "compare.html", "compare.sqlite", "runs.csv",
    ]  # fmt: skip
    before = (folder / "compare.csv").read_bytes()
    # again: nothing is left to run
    assert main(["compare", "-o", str(folder), *SMALL]) == 0
    assert (folder / "compare.csv").read_bytes() == before
    capsys.readouterr()
    line = refusal(["-o", str(folder), *SMALL[:-1], "200"], capsys)
    assert "compare.sqlite" in line
    assert (folder / "compare.csv").read_bytes() == before
    assert main(["compare", "-o", str(folder), *SMALL[:-1], "200", "--overwrite", "--workers", "1"]) == 0


def test_the_page_is_the_same_wherever_it_is_made(tmp_path: Path) -> None:
    few = ["--seeds", "1", "--budget", "50", "--optimizers", "ps-gde-lm", "--problems", "paper-N"]
    for folder, more in (("a", ["--workers", "1"]), ("b", ["--overwrite"])):
        assert main(["compare", "-o", str(tmp_path / folder), *few, *more]) == 0
    a, b = ((tmp_path / folder / "compare.html").read_text(encoding="utf-8") for folder in "ab")
    assert a == b
    line = "stoop compare --optimizers ps-gde-lm --problems paper-N --seeds 1 --first-seed 1 --budget 50<"
    assert line in a


def test_a_flight_is_part_of_the_command() -> None:
    words = ["compare", "-o", "out", "--flight", "my logs", "--vehicle", "v.toml", "--maneuver", "1:2", "3:4"]
    told = compare._command(parser_for([*words]).parse_args([*words, "--budget", "2.5", "--workers", "3"]))
    assert told == (
        "stoop compare --flight 'my logs' --vehicle v.toml --maneuver 1:2 3:4"
        " --seeds 20 --first-seed 1 --budget 2.5"
    )


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["--optimizers", "ps-gde,cmaes"], "optimizer cmaes"),
        (["--optimizers", "ps-gde:speed=2"], "no speed can be chosen"),
        (["--problems", "paper-M"], "did you mean paper-W"),
        (["--problems", "bbob-99"], "bbob-"),
        (["--problems", "bbob-01", "--first-seed", "0"], "instance 0"),
        (["--problems", "bbob-01", "--optimizers", "ps-gde-lm"], "none of these optimizers"),
        (["--problems", "flight"], "--flight"),
        (["--flight", "log.ulg"], "--vehicle and --maneuver"),
        (["--flight", "no.ulg", "--vehicle", "v.toml", "--maneuver", "1:2"], "no.ulg"),
        (["--seeds", "0"], "--seeds"),
        (["--budget", "-1"], "--budget"),
        (["--budget", "inf"], "'inf' is not a positive number"),
        (["--optimizers", ","], "--optimizers"),
    ],
)
def test_bad_input(words: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    line = refusal(["-o", str(tmp_path / "out"), *words], capsys)
    assert told in line
    assert not (tmp_path / "out").exists()


def test_a_file_is_no_folder(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "out").write_text("mine", encoding="utf-8")
    assert "is a file" in refusal(["-o", str(tmp_path / "out"), *SMALL], capsys)
    assert (tmp_path / "out").read_text(encoding="utf-8") == "mine"


def test_a_missing_package_is_said_for_those_asked_for_and_listed_for_all_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    from stoop import optimize

    create = optimize.create

    def lacking(name: str = "ps-gde-lm", budget: float | None = None) -> object:
        if name != "ps-gde-lm":
            raise IdentificationError(f"optimizer {name}: needs it; pip install '.[compare]'")
        return create(name, budget)

    monkeypatch.setattr(optimize, "create", lacking)
    line = refusal(["-o", str(tmp_path / "out"), *SMALL], capsys)
    assert "pip install '.[compare]'" in line
    few = ["--problems", "paper-N", "--seeds", "1", "--budget", "100", "--workers", "1"]
    assert main(["compare", "-o", str(tmp_path / "out"), *few]) == 0
    page = (tmp_path / "out" / "compare.html").read_text(encoding="utf-8")
    assert "cma: optimizer cma: needs it" in page or "ps-gde: optimizer ps-gde: needs it" in page
