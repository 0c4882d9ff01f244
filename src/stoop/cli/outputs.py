"""Files that a verb writes: refused before the work begins, not after it."""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
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


def check_targets(folder: Path, names: Sequence[str], overwrite: bool, inputs: Sequence[Path] = ()) -> None:
    """Refuse a folder that cannot take files of these names, before any work is done.

    Raises
    ------
    OutputError
        It is a file, holds an input or an earlier output of the same name, or cannot be made.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file; name a folder with -o")
    for target in (folder / name for name in names):
        if any(target.exists() and path.exists() and target.samefile(path) for path in inputs):
            raise OutputError(
                f"{target}: is read by this run and would be replaced; name another folder with -o"
            )
        if target.exists() and not overwrite:
            raise OutputError(
                f"{target}: exists already; add --overwrite to replace it, or name another folder"
            )
    parent = next(p for p in (folder, *folder.absolute().parents) if p.exists())
    if not parent.is_dir():
        raise OutputError(f"{folder}: {parent} is a file and holds no folder; name another one with -o")
    if not os.access(parent, os.W_OK):
        raise OutputError(f"{folder}: cannot be written; name another folder with -o")
