"""The interface for packages: what it promises, and the package of somebody else in examples/extension."""

import os
import subprocess
import sys
import tomllib
from importlib import import_module
from pathlib import Path

from docs.pages import DOCS, ROOT, blocks

SOURCE, EXAMPLE = ROOT / "src", ROOT / "examples" / "extension"
HEAVY = ("numpy", "numba", "pandas", "matplotlib", "sympy", "stoop.flight", "stoop.report")


def python(*words: str, folder: Path = ROOT) -> str:
    paths = {**os.environ, "PYTHONPATH": f"{SOURCE}{os.pathsep}{EXAMPLE}"}
    command = [sys.executable, *words]
    return subprocess.run(
        command, cwd=folder, stdout=subprocess.PIPE, text=True, env=paths, check=True
    ).stdout


def test_each_name_exists_and_a_group_loads_nothing_before() -> None:
    groups = [import_module(f"stoop.extend.{path.stem}") for path in (SOURCE / "stoop/extend").glob("*.pyi")]
    names = [getattr(group, name) for group in groups for name in group.__all__]
    assert len({name for group in groups for name in group.__all__}) == len(names)  # no two meanings
    assert f"{len(names)} names" in (DOCS / "extending.md").read_text("utf-8")
    code = "".join(f"import {group.__name__}\n" for group in groups)
    assert python("-c", f"{code}import sys\nprint({set(HEAVY)} & set(sys.modules))") == "set()\n"
    listed = "import stoop.extend\nprint(*dir(stoop.extend), stoop.extend.units.STANDARD_GRAVITY)"
    assert python("-c", listed).split() == [*sorted(g.__name__.split(".")[-1] for g in groups), "9.80665"]
    alone = f"for block in {blocks(DOCS / 'extending.md', 'python')}: exec(block, {{}})"
    assert "made@2:5" in python("-c", alone)


def test_the_contract_of_packages_names_every_room() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    (one,) = [c for c in contracts if c["name"].startswith("Packages take of the core")]
    rooms = {p.parent.name for p in SOURCE.glob("stoop/*/__init__.py")} - {"extend", "data"}
    assert {f"stoop.{room}" for room in rooms | {"api", "errors"}} == set(one["forbidden_modules"])
    assert set(one["source_modules"]) == {p.name for p in SOURCE.glob("stoop_*")} - {"stoop_studies"}


def test_the_package_of_somebody_else_adds_what_it_says(tmp_path: Path) -> None:
    told = python(str(EXAMPLE / "use.py"), str(EXAMPLE.parent / "maneuver_3211.toml"), folder=tmp_path)
    assert told.endswith("\n24.0  18.51\nwrote out/numbers.csv\n['left out'] 47.6\n")
