"""Every claim of the page on security names tests, and these exist."""

from __future__ import annotations

import ast
import re
from functools import cache

from docs.pages import DOCS, ROOT, table

PAGE = DOCS / "security.md"


@cache
def names(file: str) -> set[str]:
    """Return the names of the tests of a file, those in classes among them."""
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    return {node.name for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}


def test_each_claim_has_tests_that_exist() -> None:
    rows = table(PAGE, "Claims", "claim").rows
    assert len(rows) >= 20
    for claim, cell in rows:
        tests = re.findall(r"([\w/]+\.py)::(test_\w+)", cell)
        assert tests, claim
        for file, name in tests:
            assert name in names(file), f"{claim}: {file}::{name}"


def test_what_is_left_in_the_process_is_said() -> None:
    """Libraries in C that read files, other than by the child, are named on the page."""
    text = PAGE.read_text(encoding="utf-8")
    assert all(name in text for name in ("pandas", "zlib", "SQLite"))


def test_other_pages_lead_there() -> None:
    assert "(security.md)" in (DOCS / "robustness.md").read_text(encoding="utf-8")
    assert "\nsecurity\n" in (DOCS / "index.md").read_text(encoding="utf-8")
