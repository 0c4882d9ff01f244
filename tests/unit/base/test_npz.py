"""Archives of arrays that say something else than they hold."""

from __future__ import annotations

import io
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest

from stoop.base.npz import read_arrays


def _understated(method: int) -> io.BytesIO:
    """Return an archive whose member unfolds to more than it states: 128 bytes."""
    sink = io.BytesIO()
    with zipfile.ZipFile(sink, "w") as archive:
        archive.writestr("a.npy", bytes(10 * 2**20), compress_type=method)
    content = sink.getbuffer()
    central = sink.getvalue().index(b"PK\x01\x02")
    for place in (22, central + 24):  # of the size, in both headers
        content[place : place + 4] = struct.pack("<I", 128)
    return sink


@pytest.mark.parametrize("method", [zipfile.ZIP_DEFLATED, zipfile.ZIP_LZMA])
def test_no_more_is_unpacked_than_is_stated(method: int) -> None:
    archive = _understated(method)
    assert len(archive.getvalue()) < 2**17
    tracemalloc.start()
    with pytest.raises((ValueError, zipfile.BadZipFile)):
        read_arrays(archive, 2**20)
    assert tracemalloc.get_traced_memory()[1] < 2**21
    tracemalloc.stop()


def test_a_header_that_is_no_python_is_a_value_error() -> None:
    cut = "{'descr': '<f8', 'fortran_order': False, 'shape': (3,"
    for head in (cut, "{[]: 1}", "-" * 50_000 + "1", "(" * 300):
        sink, text = io.BytesIO(), head.encode() + b"\n"
        with zipfile.ZipFile(sink, "w") as archive:
            head_bytes = b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little")
            archive.writestr("a.npy", head_bytes + text + bytes(8))
        with pytest.raises(ValueError, match=r"header|Header"):
            read_arrays(sink, 2**20)


def test_arrays_at_the_bound_are_read() -> None:
    sink = io.BytesIO()
    np.savez_compressed(sink, a=np.zeros(2**10))
    size = sum(one.file_size for one in zipfile.ZipFile(sink).infolist())
    assert read_arrays(sink, size)["a"].size == 2**10
    with pytest.raises(ValueError, match="unfolds"):
        read_arrays(sink, size - 1)
