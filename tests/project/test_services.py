"""Files for services that build, test and publish: they agree with pyproject.toml."""

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
WORKFLOWS = ROOT / ".github" / "workflows"
pytestmark = pytest.mark.skipif(
    not WORKFLOWS.exists(), reason="a source distribution has none of these files"
)


def read(place: Path) -> Any:
    return yaml.safe_load(place.read_text(encoding="utf-8"))


def spaceless(requirements: list[str]) -> set[str]:
    return {requirement.replace(" ", "") for requirement in requirements}


def test_conda_recipe_is_in_step() -> None:
    recipe = read(ROOT / "conda" / "recipe.yaml")
    needs, context, build = recipe["requirements"], recipe["context"], PYPROJECT["build-system"]["requires"]
    assert (recipe["package"]["name"], context["version"]) == (PROJECT["name"], PROJECT["version"])
    assert f">={context['python_min']}" == PROJECT["requires-python"]
    assert spaceless(needs["run"]) == {"python>=${{python_min}}", *PROJECT["dependencies"]}
    assert spaceless(needs["host"]) == {"python${{python_min}}.*", "pip", *build}
    command, entry = next(iter(PROJECT["scripts"].items()))
    assert recipe["build"]["python"]["entry_points"] == [f"{command} = {entry}"]
    packages = [Path(p).name for p in PYPROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]]
    assert recipe["tests"][0]["python"]["imports"] == packages


def test_tests_run_on_every_python_that_is_named() -> None:
    named = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", c)]
    matrix = read(WORKFLOWS / "tests.yml")["jobs"]["tests"]["strategy"]["matrix"]
    assert matrix["python"] == named
    assert {name.partition("-")[0] for name in matrix["os"]} == {"ubuntu", "macos", "windows"}


def test_only_the_publishing_job_may_write_and_actions_are_pinned() -> None:
    for path in WORKFLOWS.glob("*.yml"):
        workflow = read(path)
        assert workflow["permissions"] == {"contents": "read"}
        raised = {name: job["permissions"] for name, job in workflow["jobs"].items() if "permissions" in job}
        assert raised == ({"publish": {"id-token": "write"}} if path.stem == "release" else {})
        uses = re.findall(r"uses: (\S+)", path.read_text(encoding="utf-8"))
        assert uses
        assert not [action for action in uses if not re.search(r"@(release/)?v\d+$", action)]
