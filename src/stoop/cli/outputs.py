"""Files that a verb writes: refused before the work begins, not after it."""

from __future__ import annotations

import argparse
from pathlib import Path

from stoop.errors import OutputError


def add_overwrite(parser: argparse.ArgumentParser) -> None:
    """Add the permission to replace a file."""
    parser.add_argument("--overwrite", action="store_true", help="replace the output file if it exists")


def check_target(path: Path, overwrite: bool) -> None:
    """Refuse a file that exists, or that has no folder to lie in.

    Raises
    ------
    OutputError
        With what to do instead.
    """
    if path.is_dir():
        raise OutputError(f"{path}: this is a folder; name a file in it")
    if path.exists() and not overwrite:
        raise OutputError(f"{path}: exists already; add --overwrite to replace it, or choose another name")
    if not path.parent.is_dir():
        raise OutputError(f"{path}: there is no folder {path.parent}; make it first, or choose another")
