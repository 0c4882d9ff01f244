"""Which sources a work function is made of, and that driver, worker and store hold on to them."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from unit.parallel.test_execute import Here

from stoop.errors import OutputError
from stoop.parallel import CampaignError, Plan, Run, execute, worker
from stoop.parallel.worker import source_files, work_sources

WORK = "herd.far.graze:graze"
FILES = {
    "__init__.py": "from herd import pages\n",
    "pages.py": "WORDS = 1\n",
    "grass.py": "def late():\n    from . import water\n",
    "water.py": "",
    "weather/__init__.py": "import importlib\ntoday = 1\n",
    "weather/rain.py": "",
    "far/__init__.py": "",
    "far/graze.py": "import json\nfrom herd import grass\nfrom ..weather import today\n"
    "def graze(arguments, stops):\n    return [1 for _ in stops]\n",
    "far/other.py": "",
}


@pytest.fixture
def herd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Make a package; forget it afterwards."""
    for name, text in FILES.items():
        path = tmp_path / "herd" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    monkeypatch.syspath_prepend(tmp_path)
    for name in [n for n in sys.modules if n.partition(".")[0] == "herd"]:
        monkeypatch.delitem(sys.modules, name)
    worker._own_sources.cache_clear()
    return tmp_path / "herd"


def test_a_module_and_what_it_imports_count_and_nothing_else(herd: Path) -> None:
    before = work_sources([WORK])
    assert list(before) == ["sources of herd.far.graze"]
    seen = set()
    for name, text in FILES.items():
        (herd / name).write_text(f"{text}# touched\n")
        if work_sources([WORK]) != before:
            seen.add(name)
        (herd / name).write_text(text)
    assert seen == set(FILES) - {"pages.py", "far/other.py"}
    assert "herd" not in sys.modules, "looked at, not imported"


def test_one_entry_per_module(herd: Path) -> None:
    (herd.parent / "alone.py").write_text("import herd\n")
    found = work_sources(["alone:f", "alone:g", WORK, "nowhere:f", "no colon", "", "__main__:f", "math:sin"])
    assert sorted(found) == ["sources of alone", "sources of herd.far.graze"]
    (herd / "grass.py").write_text("not python")
    assert work_sources([WORK]) != found


@pytest.mark.parametrize("room", ["optimize", "base", "vehicle"])
def test_every_room_that_makes_numbers_is_in_the_environment(room: str) -> None:
    assert room in worker.ROOMS


@pytest.mark.parametrize(
    "work", ["stoop_studies.search", "stoop_studies.reproduce.noise", "stoop_studies.compare.race"]
)
def test_a_study_counts_problems_and_no_pages(work: str) -> None:
    files = source_files(work)
    assert {f"{work}.py", "stoop_studies.problems.paper.py"} <= set(files)
    assert not {name for name in files if ".report." in name or "page" in name or ".optimize." in name}


@pytest.mark.parametrize(
    ("work", "own"),
    [
        (
            "stoop_studies.verify.design",
            {"stoop_studies.verify.scenes.py", "stoop.input_design.optimization.py"},
        ),
        (
            "stoop_studies.verify.delays",
            {"stoop_studies.verify.scenes.py", "stoop.reconstruction.compatibility.py"},
        ),
    ],
)
def test_a_study_counts_what_it_imports_of_stoop(work: str, own: set[str]) -> None:
    """Rooms of stoop that every environment has are not counted again."""
    files = set(source_files(work))
    assert {f"{work}.py", *own} <= files
    rooms = {name.removesuffix(".py") for name in worker.ROOMS}
    assert not {name for name in files if name.startswith("stoop.") and name.split(".")[1] in rooms}


def test_what_a_package_imports_of_stoop_counts(herd: Path) -> None:
    before = work_sources([WORK])
    (herd / "grass.py").write_text("from stoop.input_design.inputs import Frame\n")
    assert "stoop.input_design.inputs.py" in source_files("herd.far.graze")
    assert work_sources([WORK]) != before


def graze(herd: Path, store: str, before: Callable[[], None] = lambda: None) -> dict[str, object]:
    plan = Plan("herd", {}, (Run("a", WORK, {}),))
    return dict(execute(plan, herd.parent / store, Here(before)))


def test_a_worker_with_other_sources_is_refused(herd: Path) -> None:
    def edit() -> None:
        (herd / "weather" / "rain.py").write_text("WET = 1\n")

    with pytest.raises(CampaignError, match=r"^worker .*\(sources of herd.far.graze\); install the same"):
        graze(herd, "s", edit)


def test_a_store_of_other_sources_is_refused(herd: Path) -> None:
    assert graze(herd, "s") == {"a": 1} == graze(herd, "s")
    (herd / "pages.py").write_text("WORDS = 2\n")
    assert graze(herd, "s") == {"a": 1}
    (herd / "grass.py").write_text("GREEN = 1\n")
    with pytest.raises(OutputError, match=r"another environment \(sources of herd.far.graze\)"):
        graze(herd, "s")
