"""The example of the campaigns page runs, and prints what the page says."""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

from docs.pages import DOCS, blocks, table
from stoop.base.verbs import shared_options
from stoop.cli.options import add_options

PAGE = DOCS / "campaigns.md"


def test_example(tmp_path: Path) -> None:
    (tmp_path / "gusts.py").write_text(blocks(PAGE, "python")[0], encoding="utf-8")
    for _ in range(2):
        done = subprocess.run(
            [sys.executable, "gusts.py"],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=False,
        )
        assert done.returncode == 0, done.stderr
        assert f"it prints `{done.stdout.strip()}`" in PAGE.read_text(encoding="utf-8")
    assert (tmp_path / "gusts.sqlite").exists()


def test_options() -> None:
    parser = argparse.ArgumentParser(add_help=False)
    shared = shared_options()
    add_options(parser, (shared["workers"], shared["scheduler"]))
    known = {f"{a.option_strings[0]} {a.metavar}" for a in parser._actions}
    assert set(table(PAGE, "While it runs", "option").column("option")) == known
