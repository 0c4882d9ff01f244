"""All pages: commands parse, Python names what exists, links lead somewhere, tables are those of their CSV files."""

import ast
import importlib
import re
import runpy
import tomllib
from functools import cache, reduce
from importlib.resources import files
from pathlib import Path

import pytest

import stoop
from docs.pages import DOCS, PAGES, ROOT, blocks, commands, table, tables

TEXTS = (".py", ".toml", ".md", ".ipynb", ".txt")  #: endings of files that may advise an installation


def test_links_lead_somewhere() -> None:
    for page in (*PAGES, ROOT / "CHANGELOG.md"):
        targets = re.findall(r"\]\(([^)\s]+)\)", page.read_text(encoding="utf-8"))
        local = [t.partition("#")[0] for t in targets if "://" not in t]
        assert not [t for t in local if not (page.parent / t).exists()], page.name


def test_rows_of_tables_are_as_wide_as_their_heads_and_python_compiles() -> None:
    for page in PAGES:
        for one in tables(page):
            assert {len(row) for row in one.rows} <= {len(one.head)}, (page.name, one.head)
        for block in blocks(page, "python"):
            compile(block, page.name, "exec")


def test_generated_tables_are_those_of_their_csv_files(capsys: pytest.CaptureFixture[str]) -> None:
    script = runpy.run_path(str(ROOT / "scripts" / "tables.py"))
    assert script["main"](["--check"]) == 0, capsys.readouterr().out


def listed() -> list[str]:
    lists = re.compile(
        r"(?:^\.\. currentmodule:: (stoop_\w+)\n)?^\.\. autosummary::\n(?:   :.*\n)*\n((?:   \S+\n)+)",
        re.MULTILINE,
    )
    found = lists.findall((DOCS / "api.md").read_text("utf-8"))
    return [f"{package}.{name}".lstrip(".") for package, names in found for name in names.split()]


def test_every_public_name_is_in_the_reference() -> None:
    assert len(listed()) == len(set(listed())) > 30
    assert set(stoop.__all__) <= set(listed())


def exists(name: str) -> bool:
    module, _, attribute = name.rpartition(".")
    try:
        importlib.import_module(name)
    except ImportError:
        return bool(module) and hasattr(importlib.import_module(module), attribute)
    return True


def names_of(tree: ast.AST) -> set[str]:
    found = set()
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
        elif isinstance(node, ast.Attribute) and getattr(node.value, "id", "") == "stoop":
            found.add(f"stoop.{node.attr}")
    return {name for name in found if name.partition(".")[0] == "stoop"}


def test_names_in_the_pages_exist() -> None:
    for page in PAGES:
        for block in blocks(page, "python"):
            unknown = [name for name in names_of(ast.parse(block)) if not exists(name)]
            assert not unknown, f"{page.name}: {unknown}"
    for name in listed():
        top, *path = (name if name.startswith("stoop_") else f"stoop.{name}").split(".")
        for i in range(len(path)):
            try:
                importlib.import_module(".".join((top, *path[:i])))
            except ModuleNotFoundError:
                break
        assert (reduce(getattr, path, importlib.import_module(top)).__doc__ or "").strip(), name


def test_version_is_one() -> None:
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\n## [{version}]" in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_installations_are_from_a_clone_by_names_of_extras_that_exist() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    sources = [p for folder in ("src", "examples") for p in (ROOT / folder).rglob("*.*") if p.suffix in TEXTS]
    installed = set()
    for place in (*PAGES, *sources):
        text = place.read_text(encoding="utf-8")
        assert not re.search(r"pip install (-\S+ )*['\"]?stoop\b", text), place
        installed |= set(",".join(re.findall(r"pip install '\.\[([\w,]+)\]'", text)).split(","))
        if place.suffix == ".py":
            installed |= set(re.findall(r"\binstall\([\"'](\w+)[\"']\)", text))
    assert "app" in installed
    assert installed - {""} <= set(project["optional-dependencies"])


def test_each_claim_of_security_has_tests() -> None:
    rows = table(DOCS / "security.md", "Claims", "claim").rows
    assert len(rows) >= 20
    text = cache(lambda file: (ROOT / file).read_text(encoding="utf-8"))
    for claim, cell in rows:
        tests = re.findall(r"([\w/]+\.py)::(test_\w+)", cell)
        assert tests, claim
        assert not [(file, name) for file, name in tests if f"def {name}(" not in text(file)], claim


def test_example_files_are_those_of_the_studies() -> None:
    data = files("stoop_studies")
    for example, source in (
        ("hexacopter_mapping.toml", data / "problems" / "hexacopter_mapping.toml"),
        ("hexacopter.toml", data / "verify" / "vehicles" / "hexacopter.toml"),
        ("crazyflie.toml", data / "verify" / "vehicles" / "crazyflie.toml"),
    ):
        text = source.read_text(encoding="utf-8")
        assert (ROOT / "examples" / example).read_text(encoding="utf-8") == text


def test_examples_of_two_pages_are_the_same() -> None:
    assert blocks(DOCS / "api.md", "python")[0] == blocks(ROOT / "README.md", "python")[0]
    windows = "--maneuver 140:145 146:152 160:168.3 --validate 187:196"
    for page in (ROOT / "README.md", DOCS / "vtail.md"):
        assert any(windows in " ".join(command.split()) for command in commands(page))


def test_a_table_that_differs_is_named_and_rewritten(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    main = runpy.run_path(str(ROOT / "scripts" / "tables.py"))["main"]
    (tmp_path / "a.csv").write_text("kind,x,y\nwings,0.12345,-3e-05\nrotors,1,2\nwings,,4\n", "utf-8")
    head = "<!-- rows of a.csv where kind = wings\n| {kind} | {x:%.1f} | {y:.2g} |\n-->\n| a | b | c |\n| --- | --- | --- |\n"
    (page := tmp_path / "page.md").write_text(f"# T\n\n{head}| wings | 1 | 2 |\n\nText.\n", "utf-8")
    assert main(["--check"], tmp_path) == 1
    assert "page.md: the table of a.csv differs" in capsys.readouterr().out
    assert main([], tmp_path) == main(["--check"], tmp_path) == 0
    assert page.read_text("utf-8") == f"# T\n\n{head}| wings | 12.3 | −3e−5 |\n| wings | – | 4 |\n\nText.\n"
