"""Hostile logs read by stoop and by independent readers: where both read, the numbers agree to the bit."""

from __future__ import annotations

import importlib
import re
from collections.abc import Iterator, Sequence
from functools import cache
from pathlib import Path

import numpy as np
import numpy.typing as npt
from studies.robustness.other_readers import (
    READERS,
    Found,
    Samples,
    TooSlowError,
    by_plain_name,
    limited,
    plain,
)
from studies.robustness.readers import in_this_process
from studies.robustness.trials import LISTED, READ, BrokenPromiseError

from stoop import logs
from stoop.base.arrays import FloatArray, IntArray
from stoop.errors import StoopError
from stoop.logs.recording import Defect, Recording

SAME = "same"  #: both read a log, and find the same


@cache
def prepare() -> None:
    """Load the other readers, whose time is limited."""
    for name in ("pyulog", "pymavlink.DFReader", "scipy.io", "h5py"):
        importlib.import_module(name)


def compare(name: str, path: Path, mapping: Path | None) -> str:
    """Read a log twice and compare; return the outcome.

    Raises
    ------
    BrokenPromiseError
        The numbers differ, or some are lost and no defect is listed.
    """
    prepare()
    try:
        with in_this_process():
            ours = logs.read(path, mapping)
    except StoopError as error:
        ours, refusal = None, error
    try:
        with limited():
            theirs = READERS[name](path, mapping)
    except (Exception, TooSlowError):
        if ours is None:
            raise refusal from None
        return READ
    if ours is None:
        if _is_readable(theirs) and " (" not in str(refusal):  # where the refusal names the damage
            raise BrokenPromiseError(f"refused, and the other reads: {refusal}".replace(str(path), ""))
        raise refusal
    known = {plain(key): (stream.time, by_plain_name(stream.columns)) for key, stream in ours.streams.items()}
    for key, other in theirs.streams.items():
        about = _defects_of(ours, key)
        if key in known and other.columns:  # texts make no stream
            compare_samples(key, *known[key], other, about)
        elif np.isfinite(other.time).any() and other.columns and not about:
            raise BrokenPromiseError(f"the stream {key!r} is lost")
    if theirs.arrays:
        compare_arrays(ours, theirs)
    return LISTED if ours.defects else SAME


def _is_readable(found: Found) -> bool:
    """Return whether there is something that stoop should have read: two samples of a number, a vector or a matrix."""
    return any(x.columns and longest_run(x.time) > 1 for x in found.streams.values()) or any(
        x.size > 1 and x.squeeze().ndim < 3 for x in found.arrays.values()
    )


def _defects_of(recording: Recording, stream: str) -> list[Defect]:
    """Return the defects that are about a stream, or about the file."""
    file = recording.path.name
    return [d for d in recording.defects if plain(d.place) == stream or d.place.startswith(file)]


def same(a: FloatArray, b: FloatArray) -> npt.NDArray[np.bool_]:
    """Return where numbers are the same to the bit; every NaN is like every other."""
    return np.asarray((a.view(np.int64) == b.view(np.int64)) | (np.isnan(a) & np.isnan(b)))


def compare_samples(
    name: str, time: FloatArray, columns: dict[str, FloatArray], other: Samples, about: Sequence[Defect]
) -> None:
    """Compare a stream with the samples that another reader finds in it.

    Where both have all samples they are compared one by one, else at the times that occur once in both. Stoop drops samples
    whose time is not finite or does not grow; it keeps a longest run, and says how many it dropped.

    Raises
    ------
    BrokenPromiseError
        They differ, or samples or columns are lost and no defect is listed.
    """
    lost = set(other.columns) - set(columns)
    if lost and not about:
        raise BrokenPromiseError(f"{name} has lost the columns {sorted(lost)[:5]}")
    if other.ordered and time.size == other.time.size and same(time, other.time).all():
        here = there = np.arange(time.size)
    else:
        alone = occurring_once(other.time)
        _, here, there = np.intersect1d(time, other.time[alone], return_indices=True)
        there = alone[there]
        kinds = {defect.kind for defect in about}
        if not kinds and not (np.isin(other.time, time) | ~np.isfinite(other.time)).all():
            raise BrokenPromiseError(f"{name} has lost samples: {time.size} of {other.time.size}")
        if kinds == {"time order"} and other.ordered:
            _check_dropped(name, time.size, other.time, about)
        if len(kinds) > 1 and "time order" in kinds:
            return  # of samples at one time, of which some are damaged, each reader may keep another
    damages = sum(defect.kind not in ("time order", "text") for defect in about)
    for key in columns.keys() & other.columns.keys():
        mine, others = columns[key][here], other.columns[key][there]
        if (wrong := np.flatnonzero(~same(mine, others))).size > damages:  # each damages a sample at most
            i = wrong[0]
            raise BrokenPromiseError(f"{name} {key}: {mine[i]!r} is not {others[i]!r}, sample {here[i]}")


def _check_dropped(name: str, kept: int, time: FloatArray, about: Sequence[Defect]) -> None:
    """Check that stoop had all samples before it dropped some, and that it kept as many as can be."""
    had = next(int(match[1]) for d in about if (match := re.search(r"of (\d+) samples dropped", d.message)))
    most = longest_run(time)
    if had < time.size or (had == time.size and kept != most):
        raise BrokenPromiseError(f"{name} has {kept} samples of {had}, not {most} of {time.size}")


def occurring_once(values: FloatArray) -> IntArray:
    """Return the places of the values that occur once."""
    _, first, counts = np.unique(values, return_index=True, return_counts=True)
    return np.asarray(first[counts == 1])


def longest_run(time: FloatArray) -> int:
    """Return the size of a longest run of finite times that grows: by each, the longest that ends in it."""
    finite = time[np.isfinite(time)]
    best = np.zeros(finite.size, dtype=np.int64)
    for i, value in enumerate(finite):
        best[i] = 1 + best[:i][finite[:i] < value].max(initial=0)
    return int(best.max(initial=0))


def compare_arrays(recording: Recording, theirs: Found) -> None:
    """Compare each column with the arrays of its name: it is one of their rows or columns, without the samples dropped.

    Raises
    ------
    BrokenPromiseError
        It is none of them; or an array of several numbers is in no stream, and no defect is listed.
    """
    seen: set[str] = set()
    for name, stream in recording.streams.items():
        dropped = any(d.kind == "time order" and d.place == name for d in recording.defects)
        for column, values in stream.columns.items():
            label = re.sub(r"\[\d+\]$", "", column).rpartition(".")[2]
            candidates = {k: x for k, x in theirs.arrays.items() if k.rpartition(".")[2] == label}
            fits = {k for k, x in candidates.items() if any(_holds(v, values, dropped) for v in vectors(x))}
            if not fits:
                raise BrokenPromiseError(f"{name} {column}: the numbers are not in the file")
            seen |= fits
    message = " ".join(map(str, recording.defects))
    for place, values in theirs.arrays.items():
        around = [
            place[: match.start()] for match in re.finditer(r"[.\[']|$", place)
        ]  # structures, and itself
        listed = " more" in message or any(re.search(rf"\b{re.escape(word)}\b", message) for word in around)
        if values.size > 1 and place not in seen and not listed:
            raise BrokenPromiseError(f"the array {place} of {values.shape} is lost")


def vectors(values: FloatArray) -> Iterator[FloatArray]:
    """Yield an array as vectors: itself, its columns, its rows."""
    squeezed = values.squeeze()
    if squeezed.ndim < 2:
        yield np.atleast_1d(squeezed)
    elif squeezed.ndim == 2:
        yield from np.ascontiguousarray(squeezed.T)
        yield from np.ascontiguousarray(squeezed)


def _holds(vector: FloatArray, values: FloatArray, dropped: bool) -> bool:
    """Return whether a vector holds values, all of them or some in their order."""
    if vector.size == values.size:
        return bool(same(np.ascontiguousarray(vector), values).all())
    if not dropped or vector.size < values.size:
        return False
    at = 0
    for x in vector:
        at += at < values.size and bool(same(np.array([x]), values[at : at + 1])[0])
    return at == values.size
