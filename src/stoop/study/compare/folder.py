"""The folder of a comparison: what lies in it, and what may be replaced."""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Final

from stoop.errors import OutputError

STORE: Final = "compare.sqlite"
SCORES: Final = "compare.csv"
RUNS: Final = "runs.csv"
PAGE: Final = "compare.html"
_OURS: Final = b"SQLite format 3\x00"  #: how a store begins


def prepare(folder: Path, overwrite: bool) -> None:
    """See to it that a folder may be written into: continue the store that is there, or with `overwrite` forget it.

    Raises
    ------
    OutputError
        It is a file, holds tables of something else, or a store that is no store or is in use.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file; name a folder")
    store = folder / STORE
    if store.exists():
        if overwrite:
            _forget(store)
        return
    strange = [folder / name for name in (SCORES, RUNS, PAGE) if (folder / name).exists()]
    if strange and not overwrite:
        raise OutputError(
            f"{strange[0]}: exists already, and no {STORE} beside it; add --overwrite to replace it, or choose another folder"
        )


def _forget(store: Path) -> None:
    """Remove a store that nobody uses."""
    try:
        with store.open("rb") as file:
            begins = file.read(len(_OURS))
        if begins and begins != _OURS:
            raise OutputError(f"{store}: is no store of a comparison; move it away, or choose another folder")
        with closing(sqlite3.connect(store, timeout=0.0)) as connection:
            connection.execute("BEGIN EXCLUSIVE")
        for path in (store, store.with_name(f"{STORE}-journal")):
            path.unlink(missing_ok=True)
    except sqlite3.Error as error:
        raise OutputError(
            f"{store}: cannot be removed ({error}); end the process that uses it, or choose another folder"
        ) from None
    except OSError as error:
        raise OutputError(f"{store}: cannot be removed ({error.strerror}); choose another folder") from None
