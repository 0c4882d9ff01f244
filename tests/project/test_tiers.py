"""The tiers: which line decides, which files are left out, and what breaks the rule of the standard tier."""

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import tier_rule
import tiers

WORDS = {
    "tests/a.py::test_x": "full",
    "tests/a.py::test_x[2]": "guard",
    "tests/b.py": "full",
    "tests/c.py": "studies",
    "tests/c.py::test_y": "standard",
}


@pytest.mark.parametrize(
    ("test", "tier"),
    [
        ("tests/a.py::test_x", "full"),
        ("tests/a.py::test_x[1]", "full"),
        ("tests/a.py::test_x[2]", "standard"),
        ("tests/a.py::test_y", "standard"),
        ("tests/b.py::test_x[1]", "full"),
        ("tests/c.py::test_y", "standard"),
    ],
)
def test_the_most_specific_line_decides(test: str, tier: str) -> None:
    assert tiers.tier_of(test, WORDS) == tier


def test_files_without_a_test_of_the_tier_are_left_out() -> None:
    out = {tier: [f for f in "abc" if tiers.left_out(f"tests/{f}.py", tier, WORDS)] for tier in tiers.TIERS}
    assert out == {"standard": ["b"], "full": ["c"], "studies": ["b"]}
    assert not any(tiers.left_out(f"tests/{f}.py", "all", WORDS) for f in "abc")


def test_stale_entries_are_named() -> None:
    here = "tests/project/test_tiers.py"
    words = dict.fromkeys(
        (f"{here}::test_gone", f"{here}::test_x[1]", f"{here}::test_x", "tests/z.py"), "full"
    )
    gone = [f"{here}::test_gone", f"{here}::test_x[1]", "tests/z.py"]
    assert tiers.stale(words, [f"{here}::test_x[2]"]) == gone


RUN = """
import time

def burn(s):
    began = time.process_time()
    while time.process_time() - began < s:
        pass

def test_a(): burn(3.0)
def test_b(): burn(0.3)
def test_c(): burn(1.5)
def test_d(): burn(0.0 if hasattr(time, "warm") else 1.5); time.warm = True
"""


@pytest.mark.parametrize("workers", ["0", "1"])
def test_the_rule_fails_a_run_with_a_slow_test_but_for_guards_and_a_first_time(
    workers: str, tmp_path: Path
) -> None:
    tests = tmp_path / "tests"
    tests.mkdir()
    for name in ("conftest.py", "tiers.py", "tier_rule.py"):
        shutil.copy(tiers.HERE / name, tests)
    (tests / "helpers").symlink_to(tiers.HERE / "helpers")
    (tests / "tiers.txt").write_text("guard tests/test_x.py::test_c\n")
    (tests / "test_x.py").write_text(RUN)
    (tmp_path / "pyproject.toml").write_text('[tool.pytest.ini_options]\npythonpath = ["tests"]\n')
    options = ["-q", "-p", "no:cacheprovider", "-n", workers, "--tier", "standard"]
    command = [sys.executable, "-m", "pytest", *options]
    # others may compile into the user's cache meanwhile, which excuses a slow test
    quiet = os.environ | {"STOOP_CACHE_DIR": str(tmp_path / "cache")}
    done = subprocess.run(command, cwd=tmp_path, env=quiet, capture_output=True, text=True, check=False)
    assert done.returncode == 1, done.stdout + done.stderr
    rules = [line for line in done.stdout.splitlines() if line.startswith("RULE: ")]
    assert len(rules) == 1, done.stdout
    assert rules[0].startswith("RULE: tests/test_x.py::test_a takes ")


def test_too_many_guards_break_the_rule() -> None:
    many = WORDS | {f"tests/{i}.py::test_x": "guard" for i in range(tiers.GUARDS)}
    assert [line.split()[2] for line in tier_rule.broken({}, many)] == ["41"]


def test_the_words_of_the_list_are_known() -> None:
    assert set(tiers.listed().values()) <= set(tiers.WORDS)


def test_tests_of_the_core_import_no_package_but_to_write_logs() -> None:
    """Readers are tested on logs that stoop_plan writes byte by byte."""
    found = set()
    for file in (f for folder in ("core", "helpers") for f in (tiers.HERE / folder).rglob("*.py")):
        for node in ast.walk(ast.parse(file.read_text("utf-8"))):
            names = [a.name for a in node.names] if isinstance(node, ast.Import | ast.ImportFrom) else []
            found |= {f"{getattr(node, 'module', '')}.{name}".lstrip(".") for name in names}
    imported = {name for name in found if name.startswith("stoop_")}
    assert {name.split(".")[1] for name in imported} == {"log_bytes", "blackbox_bytes"}, imported
