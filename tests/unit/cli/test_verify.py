"""The verb: experiments by name, pages that name the verb, one that fails keeps `all` from nothing."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from types import ModuleType

import pytest

from stoop.errors import StoopError
from stoop.parallel import Plan
from stoop_studies.findings import Findings, Results, Setting, holds
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


def test_every_experiment_is_found_and_named_alike() -> None:
    for name in EXPERIMENTS:
        experiment = study.load_experiment(name)
        assert experiment.name == name
        assert experiment.runs >= 1


def test_pages_and_a_missing_package(
    tmp_path: Path, cli: Callable[..., tuple[int, str, str]], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One experiment that runs, and one whose package is missing."""
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
    assert "all pages:" in out
    assert "Quick" in (tmp_path / "index.html").read_text(encoding="utf-8")
    (other := tmp_path / "other").mkdir()
    (other / "quick.csv").write_text("mine")
    code, _, err = cli(["verify", "quick", "-o", other])
    assert code == 2
    assert "is of something else than stoop verify quick" in err
    assert (other / "quick.csv").read_text() == "mine"


def test_a_bug_inside_is_not_a_missing_package(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(study, "EXPERIMENTS", {"odd": ("stoop.no_such", "z")})
    with pytest.raises(ModuleNotFoundError):
        study.load_experiment("odd")
    monkeypatch.setattr(study, "EXPERIMENTS", {"lame": ("elsewhere_experiments.inner", "z")})
    with pytest.raises(StoopError, match="pip install elsewhere_experiments"):
        study.load_experiment("lame")
