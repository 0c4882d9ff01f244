"""`stoop reproduce`, `verify` and `compare`: what is written, said, refused; the same command gives the same bytes."""

import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest
from helpers.command_line import Cli, Done, Refused

from stoop.errors import StoopError
from stoop.parallel import Plan
from stoop_studies.cli.reproduce import NAMES
from stoop_studies.findings import Findings, Results, Setting, holds
from stoop_studies.reproduce.registry import EXPERIMENTS
from stoop_studies.verify import study

SMALL = "--optimizers ps-gde-lm,ps-gde --problems paper-N --seeds 1 --budget"


def test_a_figure_is_page_and_table_and_the_same_bytes_again(tmp_path: Path, done: Done) -> None:
    assert tuple(EXPERIMENTS) == NAMES
    folder = tmp_path / "new" / "folder"
    said = done(f"reproduce figure3 -o {folder}")
    assert "- reproduces: Trim at 35 m/s" in said
    assert f"page: {folder / 'figure3.html'}" in said
    first = {p.name: p.read_bytes() for p in folder.iterdir()}
    assert sorted(first) == ["figure3.csv", "figure3.html"]
    page = first["figure3.html"].decode()
    assert "stoop reproduce figure3 --runs 1 --seed 0 --box N" in page
    assert "studies.html#reproduce-figure3" in page, "every page leads to what the paper leaves open"
    done(f"reproduce figure3 -o {folder}")
    assert {p.name: p.read_bytes() for p in folder.iterdir()} == first


def test_files_of_others_stay(refused: Refused, done: Done) -> None:
    for file, experiment in (("figure3.html", "figure3"), ("figure3.csv", "figure3"), ("index.html", "all"),
                             ("lateral-biases.csv", "lateral")):  # fmt: skip
        path = Path(file)
        path.write_text("mine")
        assert "is of something else" in refused(f"reproduce {experiment} -o ."), file
        path.unlink()
    path.write_text("mine")
    Path("figure3.csv").write_text("mine")
    done("reproduce figure3 -o . --overwrite")
    assert Path("figure3.csv").read_text() != "mine"
    assert path.read_text() == "mine"


@dataclass(frozen=True)
class Quick:
    name: str = "quick"
    runs: int = 3
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan | None:
        return None

    def findings(self, setting: Setting, results: Results) -> Findings:
        claim = holds("three is three", setting.runs == 3, f"{setting.runs}")
        return Findings("Quick", (claim,), (), ("runs",), ((setting.runs,),))


def test_every_experiment_is_found_and_named_alike() -> None:
    for name in study.EXPERIMENTS:
        assert study.load_experiment(name).name == name


def test_pages_and_a_missing_package(tmp_path: Path, cli: Cli, monkeypatch: pytest.MonkeyPatch) -> None:
    module = ModuleType("quick_experiments")
    module.__dict__["EXPERIMENT"] = Quick()
    monkeypatch.setitem(sys.modules, "quick_experiments", module)
    entries = {"quick": ("quick_experiments", "x"), "lame": ("lame_experiments", "y")}
    monkeypatch.setattr(study, "EXPERIMENTS", entries)
    code, out, _ = cli(["verify", "quick", "-o", tmp_path, "--data", "a b"])
    assert code == 0
    assert "- holds: three is three (3)" in out
    page = (tmp_path / "quick.html").read_text(encoding="utf-8")
    assert "stoop verify quick --runs 3 --seed 0 --data &#39;a b&#39;" in page
    assert "--box" not in page
    assert (tmp_path / "quick.csv").read_text() == "runs\n3\n"
    code, out, err = cli(["verify", "all", "-o", tmp_path])
    assert code == 2
    assert "lame: needs the package lame_experiments" in err
    assert len(err.splitlines()) == 1
    assert "Quick" in (tmp_path / "index.html").read_text(encoding="utf-8")


def test_a_bug_inside_is_not_a_missing_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "EXPERIMENTS", {"odd": ("stoop.no_such", "z")})
    with pytest.raises(ModuleNotFoundError):
        study.load_experiment("odd")
    monkeypatch.setattr(study, "EXPERIMENTS", {"lame": ("elsewhere_experiments.inner", "z")})
    with pytest.raises(StoopError, match="pip install elsewhere_experiments"):
        study.load_experiment("lame")


def test_writes_tables_and_page_goes_on_and_refuses_another_plan(done: Done, refused: Refused) -> None:
    Path("file").write_text("mine")
    assert "is a file" in refused(f"compare -o file {SMALL} 100")
    said = done(f"compare -o deep/out {SMALL} 100 --workers 1")
    assert "No rival beats ps-gde-lm here." in said
    assert "No optimizer claimed a wrong optimum" in said
    folder = Path("deep/out")
    assert {p.name for p in folder.iterdir()} == {"compare.csv", "compare.html", "compare.sqlite", "runs.csv"}
    before = {p.name: p.read_bytes() for p in folder.glob("compare.[ch]*")}
    done(f"compare -o deep/out {SMALL} 100")  # nothing is left to run
    assert {p.name: p.read_bytes() for p in folder.glob("compare.[ch]*")} == before
    line = f"stoop compare {SMALL.removesuffix(' --budget')} --first-seed 1 --budget 100<"
    assert line in before["compare.html"].decode(), "wherever it is made"
    assert "compare.sqlite" in refused(f"compare -o deep/out {SMALL} 50")
    done(f"compare -o deep/out {SMALL} 50 --overwrite --workers 1")
