"""What a campaign does with one piece of work: some hundred cases of one reader, counted."""

from __future__ import annotations

import importlib
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from typing import Any, Final

from stoop_studies.verify.readers.child import try_all
from stoop_studies.verify.readers.samples import samples
from stoop_studies.verify.readers.trial import BAD, CONTAINED, GUARDED, Series

CASES: Final = 250  #: of one piece of work
_LIBRARIES: Final = ("pandas", "scipy.signal", "scipy.io", "stoop.flight.air_data_reconstruction")


def tried(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[dict[str, Any]]:
    """Try cases of a reader; see `stoop.parallel.Run`."""
    keys = ("reader", "seed", "guarded", "data")
    series = Series(**{key: arguments[key] for key in keys})
    prepare(series.reader, series.data)
    counts: Counter[str] = Counter()
    found = []
    for one in try_all(series, int(arguments["cases"])):
        counts[f"{one.way}/{one.damage}/{one.outcome}"] += 1
        if one.outcome in (*BAD, CONTAINED):
            found.append(asdict(one))
    return [{"counts": dict(sorted(counts.items())), "found": found} for _ in stops]


@cache
def prepare(reader: str, data: str) -> None:
    """Load what a reader needs once, so that copies of this process need not.

    Texts of pandas may be Arrow's, whose allocator takes a GiB of addresses when it is first asked: not from a case's room.
    """
    for name in (*_LIBRARIES, GUARDED.get(reader, "pandas")):
        importlib.import_module(name)
    importlib.import_module("pandas").Series(["text"]).isna()
    samples(reader, data)
