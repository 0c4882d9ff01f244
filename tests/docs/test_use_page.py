"""Using the result: the gain by hand is what the page prints."""

from __future__ import annotations

from pathlib import Path

from docs.pages import DOCS, blocks, run_python


def test_gain_by_hand(tmp_path: Path) -> None:
    page = DOCS / "use-the-result.md"
    assert run_python(page, tmp_path) == blocks(page, "text")[0]
