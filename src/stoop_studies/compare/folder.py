"""The folder of a comparison: what lies in it, and what may be replaced."""

from __future__ import annotations

from pathlib import Path
from typing import Final

from stoop.errors import OutputError
from stoop.parallel.store import forget

STORE: Final = "compare.sqlite"
SCORES: Final = "compare.csv"
RUNS: Final = "runs.csv"
PAGE: Final = "compare.html"


def prepare(folder: Path, overwrite: bool) -> None:
    """See to it that a folder may be written into: continue the store that is there, or with `overwrite` forget it.

    Raises
    ------
    OutputError
        It is a file, holds tables of something else, or with `overwrite`: the store is another program's file, or in use.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file; name a folder")
    store = folder / STORE
    if store.exists():
        if overwrite:
            forget(store)
        return
    strange = [folder / name for name in (SCORES, RUNS, PAGE) if (folder / name).exists()]
    if strange and not overwrite:
        raise OutputError(
            f"{strange[0]}: exists already, and no {STORE} beside it; add --overwrite to replace it, or choose another folder"
        )
