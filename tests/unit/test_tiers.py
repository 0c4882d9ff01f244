"""Every test belongs to one of standard and full, and the list of tiers names tests that exist."""

from __future__ import annotations

import ast

import pytest
import tiers

ROOT = tiers.HERE.parent
TIERS = tiers.listed(tiers.TIERS)


def functions(file: str) -> set[str]:
    """Return the tests of a file as pytest names them, without parameters."""
    tree = ast.parse((ROOT / file).read_text("utf-8"))
    tests = [(f"{file}::", node) for node in tree.body]
    tests += [(f"{file}::{c.name}::", n) for c in tree.body if isinstance(c, ast.ClassDef) for n in c.body]
    return {p + n.name for p, n in tests if isinstance(n, ast.FunctionDef) and n.name.startswith("test_")}


def test_standard_and_full_are_everything_and_share_nothing(pytestconfig: pytest.Config) -> None:
    smallest = pytestconfig.stash[tiers.COLLECTED]
    run = {tier: {test for test, s in smallest.items() if tiers.runs(tier, s)} for tier in tiers.CHOICES}
    assert run["standard"] | run["full"] == run["all"] == set(smallest)
    assert not run["standard"] & run["full"]
    assert run["quick"] <= run["standard"]


def test_every_line_of_tiers_names_a_test() -> None:
    files = {test.partition("::")[0] for test in TIERS}
    missing = sorted(file for file in files if not (ROOT / file).is_file())
    assert not missing, "tests/tiers.txt names files that are gone"
    existing = files.union(*(functions(file) for file in files))
    assert not sorted(test for test in TIERS if test.partition("[")[0] not in existing)


def test_every_parameter_that_a_line_names_is_collected(pytestconfig: pytest.Config) -> None:
    smallest = pytestconfig.stash[tiers.COLLECTED]
    tests = {test.partition("[")[0] for test in smallest}
    gone = [
        test for test in TIERS if test.partition("[")[0] in tests and "[" in test and test not in smallest
    ]
    assert not gone or any("::" in argument for argument in pytestconfig.args), gone


def test_lines_name_tiers() -> None:
    assert set(TIERS.values()) == {"quick", "standard", "full"}


@pytest.mark.parametrize(
    ("test", "expected"),
    [
        ("a.py::test_x", "full"),
        ("a.py::test_x[1]", "full"),
        ("a.py::test_x[2]", "standard"),
        ("a.py::test_y", "standard"),
        ("a.py::test_z", "quick"),
        ("b.py::test_x[1]", "full"),
        ("b.py::test_fit", "quick"),
    ],
)
def test_the_most_specific_line_decides(test: str, expected: str) -> None:
    lists = {"a.py::test_x": "full", "a.py::test_x[2]": "standard", "b.py": "full", "b.py::test_fit": "quick"}
    long = dict.fromkeys(("a.py::test_x", "a.py::test_y", "b.py::test_fit"), "9.0")
    assert tiers.tier_of(test, lists, long) == expected
