"""The columns of a log as they stand in it: stated unit, range and samples, for whoever names them."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.extend import recordings
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import LogError

SAMPLES: Final = 3  #: of a column, evenly spaced in time


def read_unmapped(path: Path) -> recordings.Recording:
    """Read a log of any kind that stoop reads, or a folder of CSV files, without a mapping.

    Raises
    ------
    LogError
        When the log cannot be read.
    """
    if path.is_dir() and not recordings.is_bag_folder(path):
        try:
            return recordings.read_px4_folder(path)
        except LogError:
            return recordings.read_raw_csv(path)
    if path.is_file() and (known := recordings.kind(path)):
        return recordings.read_as(known, path)
    table = path.is_file() and path.name.lower().endswith((".csv", ".csv.gz", ".txt"))
    return recordings.read_raw_csv(path) if table else recordings.read(path)


def columns_of(recording: recordings.Recording) -> Iterator[dict[str, Any]]:
    """Yield each column: stream, name, unit as the file states it, and finite values: lowest, highest and samples."""
    for name, stream in recording.streams.items():
        stated = recording.units.get(name, {})
        for column, x in stream.columns.items():
            yield {"stream": name, "column": column, "unit": stated.get(column, ""), **_values(x)}


def _values(x: FloatArray) -> dict[str, Any]:
    known = x[np.isfinite(x)]
    if not known.size:
        return {"low": None, "high": None, "samples": []}
    places = np.linspace(0, known.size - 1, SAMPLES + 2)[1:-1].astype(int)
    return {"low": float(known.min()), "high": float(known.max()), "samples": known[places].tolist()}
