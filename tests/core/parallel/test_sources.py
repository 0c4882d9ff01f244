"""Which sources, versions and processor results depend on, and that driver, worker and store hold on to them."""

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from core.parallel.test_execute import Here

from stoop.errors import OutputError
from stoop.parallel import CampaignError, Plan, Run, environment, execute, source_digest, worker
from stoop.parallel.worker import differences, source_files, work_sources

WORK = "herd.far.graze:graze"
GRAZE = """
import json
from herd import grass
from ..weather import today
def graze(arguments, stops):
    return [1 for _ in stops]
"""
FILES = {
    "__init__.py": "from herd import pages\n", "pages.py": "WORDS = 1\n", "grass.py": "def late():\n    from . import water\n",
    "water.py": "", "weather/__init__.py": "import importlib\ntoday = 1\n", "weather/rain.py": "", "far/__init__.py": "",
    "far/graze.py": GRAZE, "far/other.py": "",
}  # fmt: skip


@pytest.fixture
def herd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
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


def test_a_study_counts_what_it_imports_and_no_pages() -> None:
    """Rooms of stoop that every environment has are not counted again."""
    assert {"optimize", "base", "vehicle"} <= set(worker.ROOMS)
    rooms = {name.removesuffix(".py") for name in worker.ROOMS}
    counts = dict.fromkeys(("search", "compare.race"), "stoop_studies.problems.paper.py")
    counts["verify.design"] = "stoop_plan.input_design.optimization.py"
    counts["verify.propagate"] = "stoop_analysis.draws.py"
    counts["verify.delays"] = "stoop.reconstruction.compatibility.py"
    for work, counted in counts.items():
        files = set(source_files(f"stoop_studies.{work}"))
        assert {f"stoop_studies.{work}.py", counted} <= files
        assert not {name for name in files if name.startswith("stoop.") and name.split(".")[1] in rooms}
        assert not {name for name in files if ".report." in name or "page" in name}


def test_what_a_package_imports_of_stoop_counts(herd: Path) -> None:
    before = work_sources([WORK])
    (herd / "grass.py").write_text("from stoop_plan.input_design.inputs import Frame\n")
    assert "stoop_plan.input_design.inputs.py" in source_files("herd.far.graze")
    assert work_sources([WORK]) != before
    (herd.parent / "alone.py").write_text("import herd\n")  # one entry per module
    found = work_sources(["alone:f", "alone:g", WORK, "nowhere:f", "no colon", "", "__main__:f", "math:sin"])
    assert sorted(found) == ["sources of alone", "sources of herd.far.graze"]
    (herd / "grass.py").write_text("not python")
    assert work_sources([WORK]) != found


def graze(herd: Path, store: str, before: Callable[[], None] = lambda: None) -> dict[str, object]:
    plan = Plan("herd", {}, (Run("a", WORK, {}),))
    return dict(execute(plan, herd.parent / store, Here(before)))


def test_a_worker_or_a_store_of_other_sources_is_refused(herd: Path) -> None:
    def edit() -> None:
        (herd / "weather" / "rain.py").write_text("WET = 1\n")

    with pytest.raises(CampaignError, match=r"^worker .*\(sources of herd.far.graze\); install the same"):
        graze(herd, "edited", edit)
    worker._own_sources.cache_clear()
    assert graze(herd, "s") == {"a": 1} == graze(herd, "s")
    (herd / "pages.py").write_text("WORDS = 2\n")
    assert graze(herd, "s") == {"a": 1}
    (herd / "grass.py").write_text("GREEN = 1\n")
    with pytest.raises(OutputError, match=r"another environment \(sources of herd.far.graze\)"):
        graze(herd, "s")


def test_functions_that_stoop_calls_by_name_count(herd: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(worker, "tables", lambda _: [("stoop_herd", {"graze": WORK})])
    before = worker._environment.__wrapped__()
    (herd / "grass.py").write_text("GREEN = 2\n")
    assert differences(before, worker._environment.__wrapped__()) == "sources of hooks"


def test_differences_name_what_both_have() -> None:
    assert environment()["numpy"] == np.__version__
    names = {"Python", "stoop", "scipy", "processor", "processor's features", "sources of stoop"}
    assert names <= {*environment()}
    assert not differences({"numpy": "2.1", "cma": "4.0"}, {"numpy": "2.1"})
    assert differences({"numpy": "2.1", "x": "1"}, {"numpy": "2.0", "x": "1"}) == "numpy 2.1 here, 2.0 there"
    assert differences({"features": "a" * 99}, {"features": "b"}) == "features"


def test_digest_sees_content_names_and_nothing_else(tmp_path: Path) -> None:
    source, other = tmp_path / "a.py", tmp_path / "b.py"
    source.write_text("one")
    before = source_digest(tmp_path)
    source.with_suffix(".pyc").write_text("compiled")
    assert source_digest(tmp_path) == before
    source.write_text("two")
    changed = source_digest(tmp_path)
    source.rename(other)
    assert len({before, changed, source_digest(tmp_path), source_digest(other)}) == 4
