"""Files for services that build, test and publish: they say what pyproject.toml and the documentation say."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path
from typing import Any

import pytest
import yaml

ROOT = Path(__file__).parents[2]
PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
PROJECT = PYPROJECT["project"]
GITHUB = ROOT / ".github"
pytestmark = pytest.mark.skipif(not GITHUB.exists(), reason="a source distribution has none of these files")


def read(place: str) -> Any:
    """Return the content of a YAML file."""
    return yaml.safe_load((ROOT / place).read_text(encoding="utf-8"))


def spaceless(requirements: list[str]) -> set[str]:
    return {requirement.replace(" ", "") for requirement in requirements}


def test_conda_recipe_is_in_step() -> None:
    recipe = read("conda/recipe.yaml")
    needs, context = recipe["requirements"], recipe["context"]
    name, (command, entry) = PROJECT["name"], next(iter(PROJECT["scripts"].items()))
    assert recipe["package"]["name"] == name
    assert context["version"] == PROJECT["version"]
    assert f">={context['python_min']}" == PROJECT["requires-python"]
    assert spaceless(needs["run"]) == {"python>=${{python_min}}", *PROJECT["dependencies"]}
    assert spaceless(needs["host"]) == {
        *("python${{python_min}}.*", "pip"),
        *PYPROJECT["build-system"]["requires"],
    }
    assert recipe["build"]["python"]["entry_points"] == [f"{command} = {entry}"]
    packages = [Path(p).name for p in PYPROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]]
    assert recipe["tests"][0]["python"]["imports"] == packages
    about = recipe["about"]
    assert about["summary"] == PROJECT["description"]
    assert about["license"] == PROJECT["license"]
    assert [about[k] for k in ("homepage", "repository", "documentation")] == [
        PROJECT["urls"][k] for k in ("Homepage", "Source", "Documentation")
    ]


def test_tests_run_on_every_python_that_is_named() -> None:
    named = [c.rpartition(" ")[2] for c in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", c)]
    matrix = read(".github/workflows/tests.yml")["jobs"]["tests"]["strategy"]["matrix"]
    assert matrix["python"] == named
    assert {name.partition("-")[0] for name in matrix["os"]} == {"ubuntu", "macos", "windows"}


def test_only_the_publishing_job_may_write() -> None:
    for path in (GITHUB / "workflows").glob("*.yml"):
        workflow = read(path.relative_to(ROOT).as_posix())
        assert workflow["permissions"] == {"contents": "read"}
        raised = {name: job["permissions"] for name, job in workflow["jobs"].items() if "permissions" in job}
        assert raised == ({"publish": {"id-token": "write"}} if path.stem == "release" else {})


def test_actions_are_pinned_by_major_version() -> None:
    for path in (GITHUB / "workflows").glob("*.yml"):
        uses = re.findall(r"uses: (\S+)", path.read_text(encoding="utf-8"))
        assert uses
        assert not [action for action in uses if not re.search(r"@(release/)?v\d+$", action)]


def test_forms_ask_for_what_is_needed_and_link_to_pages() -> None:
    for name in ("bug", "question", "feature"):
        form = read(f".github/ISSUE_TEMPLATE/{name}.yml")
        ids = [part["id"] for part in form["body"] if "id" in part]
        assert len(ids) == len(set(ids))
        assert ("log" in ids) == (name == "question")
    site = PROJECT["urls"]["Documentation"]
    for path in (GITHUB / "ISSUE_TEMPLATE").glob("*.yml"):
        for address in re.findall(r"https://[^\s)]+", path.read_text(encoding="utf-8")):
            page = address.removeprefix(f"{site}/en/latest/")
            assert address == site or (ROOT / "docs" / page).with_suffix(".md").exists(), address


def test_documentation_is_built_as_by_the_checks() -> None:
    settings = read(".readthedocs.yaml")
    assert settings["sphinx"]["fail_on_warning"]
    assert (ROOT / settings["sphinx"]["configuration"]).exists()
    (install,) = settings["python"]["install"]
    assert set(install["extra_requirements"]) <= set(PROJECT["optional-dependencies"])


def test_commits_are_checked_by_the_same_tools() -> None:
    hooks = [hook["id"] for repo in read(".pre-commit-config.yaml")["repos"] for hook in repo["hooks"]]
    assert {"ruff-check", "ruff-format", "end-of-file-fixer", "check-toml", "check-yaml"} <= set(hooks)
