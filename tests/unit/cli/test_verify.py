"""The verb: experiments by name, pages that name the verb, one that fails keeps `all` from nothing."""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest

from stoop.cli.main import main
from stoop.errors import StoopError
from stoop.parallel import Plan
from stoop_studies.findings import Experiment, Findings, Results, Setting, holds
from stoop_studies.verify import study
from stoop_studies.verify.study import EXPERIMENTS


@dataclass(frozen=True)
class Quick:
    """An experiment without runs."""

    name: str = "quick"
    runs: int = 3
    parts: tuple[str, ...] = ()

    def plan(self, setting: Setting) -> Plan | None:
        return None

    def findings(self, setting: Setting, results: Results) -> Findings:
        claim = holds("three is three", setting.runs == 3, f"{setting.runs}")
        return Findings("Quick", (claim,), (), ("runs",), ((setting.runs,),))


@pytest.fixture
def entries(monkeypatch: pytest.MonkeyPatch) -> None:
    """Register an experiment that runs and one whose package is missing."""
    module = ModuleType("quick_experiments")
    module.__dict__["EXPERIMENT"] = Quick()
    monkeypatch.setitem(sys.modules, "quick_experiments", module)
    found = {"quick": ("quick_experiments", "x"), "lame": ("lame_experiments", "y")}
    monkeypatch.setattr(study, "EXPERIMENTS", found)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_every_experiment_is_found_and_named_alike(name: str) -> None:
    experiment: Experiment = study.load_experiment(name)
    assert experiment.name == name
    assert experiment.runs >= 1


@pytest.mark.usefixtures("entries")
def test_page_names_the_command(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "quick", "-o", str(tmp_path), "--data", "a b"]) == 0
    assert "- holds: three is three (3)" in capsys.readouterr().out
    page = (tmp_path / "quick.html").read_text(encoding="utf-8")
    assert "stoop verify quick --runs 3 --seed 0 --data &#39;a b&#39;" in page
    assert "--box" not in page
    assert (tmp_path / "quick.csv").read_text() == "runs\n3\n"


@pytest.mark.usefixtures("entries")
def test_all_goes_on_where_a_package_is_missing(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["verify", "all", "-o", str(tmp_path)]) == 2
    out, err = capsys.readouterr()
    assert "lame: needs the package lame_experiments" in err
    assert len(err.splitlines()) == 1
    assert "all pages:" in out
    assert "Quick" in (tmp_path / "index.html").read_text(encoding="utf-8")


@pytest.mark.usefixtures("entries")
def test_files_of_others_stay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "quick.csv").write_text("mine")
    assert main(["verify", "quick", "-o", str(tmp_path)]) == 2
    assert "is of something else than stoop verify quick" in capsys.readouterr().err
    assert (tmp_path / "quick.csv").read_text() == "mine"


@pytest.mark.usefixtures("entries")
def test_a_bug_inside_is_not_a_missing_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "EXPERIMENTS", {"odd": ("stoop.no_such", "z")})
    with pytest.raises(ModuleNotFoundError):
        study.load_experiment("odd")
    monkeypatch.setattr(study, "EXPERIMENTS", {"lame": ("elsewhere_experiments.inner", "z")})
    with pytest.raises(StoopError, match="pip install elsewhere_experiments"):
        study.load_experiment("lame")
