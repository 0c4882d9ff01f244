"""The columns of a log as they stand in it: stated unit, range and samples, for whoever names them."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.recordings import Recording

SAMPLES: Final = 3  #: of a column, evenly spaced in time


def columns_of(recording: Recording) -> Iterator[dict[str, Any]]:
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
