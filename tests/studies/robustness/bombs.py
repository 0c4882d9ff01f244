"""Small files that unfold to very much: packed zeros, and shapes that no memory holds.

Where a library would write what is packed, one packed part is written many times, so that a file of 100 kB unfolds to 100 GB
without a second of work.
"""

from __future__ import annotations

import gzip
import io
import struct
import zlib
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, Final

import numpy as np
from studies.robustness.small_runs import inputs

CHUNK: Final = 2**23  #: numbers of a chunk, 64 MiB
MATLAB_HEAD: Final = b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM"


def _hdf5(fill: Callable[[Any], None], block: int = 0) -> bytes:
    import h5py

    stream = io.BytesIO()
    with h5py.File(stream, "w", userblock_size=block, libver="latest") as file:
        fill(file)
    content = stream.getvalue()
    return MATLAB_HEAD + content[len(MATLAB_HEAD) :] if block else content


def _packed_chunks(count: int) -> Callable[[Any], None]:
    """Return a dataset of chunks of zeros, packed twice: 64 MiB become some 200 bytes."""

    def fill(file: Any) -> None:
        import h5py

        kind = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        kind.set_chunk((CHUNK,))
        kind.set_deflate(9)
        kind.set_deflate(9)
        space = h5py.h5s.create_simple((count * CHUNK,))
        for name in (b"time", b"q"):
            dataset = h5py.h5d.create(file.id, name, h5py.h5t.IEEE_F64LE, space, kind)
            packed = zlib.compress(zlib.compress(bytes(8 * CHUNK), 9), 9)
            for i in range(count):
                dataset.write_direct_chunk((i * CHUNK,), packed)

    return fill


def _shape(shape: tuple[int, ...], **how: Any) -> Callable[[Any], None]:
    """Return two datasets of a shape, of which nothing is stored."""

    def fill(file: Any) -> None:
        for name in ("time", "q"):
            file.create_dataset(name, shape, "f8", **how)

    return fill


def _many(count: int) -> Callable[[Any], None]:
    """Return a tree of groups, and arrays in it."""

    def fill(file: Any) -> None:
        for i in range(count):
            file.create_group(f"{i % 50}/{i}").create_dataset("a", (1,), "f8")

    return fill


def _one_chunk(file: Any) -> None:
    """Make a short array in a chunk of 3.9 GB, packed twice."""
    import h5py

    file.create_dataset("time", data=np.arange(10.0))
    kind = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    kind.set_chunk((2**29 - 2**20,))
    kind.set_deflate(9)
    space = h5py.h5s.create_simple((10,), (h5py.h5s.UNLIMITED,))
    dataset = h5py.h5d.create(file.id, b"q", h5py.h5t.IEEE_F64LE, space, kind)
    dataset.write_direct_chunk((0,), zlib.compress(bytes(2**20)))


def _wide_elements(file: Any) -> None:
    """Make a short array of elements of 2 GB, each a text, and one of arrays of 2^27 numbers."""
    import h5py

    file.create_dataset("time", data=np.arange(10.0))
    file.create_dataset("text", (10,), "S2000000000", chunks=(1,))
    wide = h5py.h5t.array_create(h5py.h5t.IEEE_F64LE, (2**27,))
    kind = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
    kind.set_chunk((1,))
    h5py.h5d.create(file.id, b"q", wide, h5py.h5s.create_simple((10,)), kind)


HDF5: Final[Mapping[str, Callable[[Any], None]]] = {
    "100 GB packed": _packed_chunks(800),
    "a shape of 2^40": _shape((2**40,), chunks=(2**20,), compression="gzip"),
    "a shape of 2^20 x 2^20": _shape((2**20, 2**20), chunks=(1, 2**20)),
    "a shape of 2^40 in one dimension of three": _shape((2**40, 1, 1), chunks=(2**20, 1, 1)),
    "5 million numbers each in 60 arrays": lambda file: [
        file.create_dataset(f"a{i}", (5_000_000,), "f8", chunks=(2**16,)) for i in range(60)
    ],
    "a chunk of 4 GB": _one_chunk,
    "elements of 2 GB": _wide_elements,
    "20,000 groups": _many(20_000),
}  #: name -> content of an HDF5 file


def _flushed(part: bytes, times: int, wbits: int) -> bytes:
    """Return a deflate stream that unfolds to a part many times; its checksum is wrong, which only the end shows."""
    packer = zlib.compressobj(9, wbits=wbits)
    head = packer.compress(part) + packer.flush(zlib.Z_FULL_FLUSH)
    again = packer.compress(part) + packer.flush(zlib.Z_FULL_FLUSH)
    return head + again * (times - 1) + packer.flush()


ROW: Final = b"0,0\n"
HEAD: Final = gzip.compress(b"t,q\n", mtime=0)
GZIPS: Final[Mapping[str, Callable[[], bytes]]] = {
    "100 GB in lines": lambda: HEAD + _flushed(ROW * 2**20, 25_000, 31),
    "100 GB in one line": lambda: _flushed(bytes(2**22), 25_000, 31),
    "100 GB in one header": lambda: _flushed(b"a," * 2**21, 25_000, 31),
    "100 GB in 50,000 members": lambda: HEAD + gzip.compress(ROW * 500_000) * 50_000,
    "200 MB in lines": lambda: HEAD + gzip.compress(b"".join(b"%d,0\n" % i for i in range(2**17))) * 200,
    "gzip in gzip in gzip": lambda: gzip.compress(gzip.compress(GZIPS["100 GB in one line"]())),
}  #: name -> content of a packed table


def _matlab5(times: int) -> bytes:
    """Return a MATLAB 5 file with one packed matrix of zeros, 4 MiB many times."""
    count = times * 2**22 // 8
    name = b"q".ljust(8, b"\0")
    flags, shape = struct.pack("<IIII", 6, 8, 6, 0), struct.pack("<IIiI", 5, 8, min(count, 2**31 - 1), 1)
    words = flags + shape + struct.pack("<II", 1, 1) + name + struct.pack("<II", 9, 2**32 - 1)
    matrix = struct.pack("<II", 14, 2**32 - 1) + words
    packer = zlib.compressobj(9)
    head = packer.compress(matrix) + packer.flush(zlib.Z_FULL_FLUSH)
    part = packer.compress(bytes(2**22)) + packer.flush(zlib.Z_FULL_FLUSH)
    packed = head + part * times + packer.flush()
    return b"MATLAB 5.0 MAT-file".ljust(124) + b"\0\1IM" + struct.pack("<II", 15, len(packed)) + packed


def _parquet(table: Any, times: int, **how: Any) -> bytes:
    import pyarrow.parquet as pq

    sink = io.BytesIO()
    with pq.ParquetWriter(sink, table.schema, **how) as writer:
        for _ in range(times):
            writer.write_table(table)
    return sink.getvalue()


def _lists() -> bytes:
    import pyarrow as pa

    return _parquet(pa.table({"q": pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(2**22)), 2**20)}), 64)


def _footer() -> bytes:
    import pyarrow as pa

    content = bytearray(_parquet(pa.table({"time": np.arange(10.0), "q": np.arange(10.0)}), 1))
    at = content.rindex(b"time")
    content[at - 8 : at] = b"\xff" * 8
    return bytes(content)


PARQUETS: Final[Mapping[str, Callable[[], bytes]]] = {
    "2^28 rows": lambda: _parquet(_table({"time": np.zeros(2**22), "q": np.zeros(2**22)}), 64),
    "lists of 2^20 in 256 rows": _lists,
    "texts of 1 GB": lambda: _parquet(_table({"time": [0.0], "q": ["0" * 2**26]}), 16, compression="zstd"),
    "20,000 columns": lambda: _parquet(_table({str(i): [0.0] for i in range(20_000)}), 1),
    "a footer of other sizes": _footer,
}  #: name -> content of a Parquet file


def _table(columns: Mapping[str, Any]) -> Any:
    import pyarrow as pa

    return pa.table(dict(columns))


def _netcdf3(records: int, size: int) -> bytes:
    """Return a head of netCDF-3 that states many records of many numbers."""
    from scipy.io import netcdf_file

    stream = io.BytesIO()
    file = netcdf_file(stream, "w", version=2)
    file.createDimension("time", None)
    file.createDimension("wide", 7)
    file.createVariable("q", "d", ("time", "wide"))[:] = np.zeros((3, 7))
    file.flush()
    content = stream.getvalue().replace(struct.pack(">I", 7), struct.pack(">I", size), 1)
    return content[:4] + struct.pack(">I", records) + content[8:]


def _own_flight(samples: int) -> bytes:
    """Return a flight of stoop's own that states another number of samples."""
    content = inputs()["sim.nc"]
    at = content.index(b"\0\0\0\4time") + 8
    return content[:at] + struct.pack(">I", samples) + content[at + 4 :]


BOMBS: Final[Mapping[str, tuple[str, Callable[[], bytes]]]] = {
    **{f"netCDF-4: {kind}": ("a.nc", partial(_hdf5, fill)) for kind, fill in HDF5.items()},
    **{f"HDF5: {kind}": ("a.h5", partial(_hdf5, fill)) for kind, fill in HDF5.items()},
    **{f"MATLAB 7.3: {kind}": ("a.mat", partial(_hdf5, fill, 512)) for kind, fill in HDF5.items()},
    **{f"gzip: {kind}": ("a.csv.gz", made) for kind, made in GZIPS.items()},
    **{f"Parquet: {kind}": ("a.parquet", made) for kind, made in PARQUETS.items()},
    "MATLAB 5: 100 GB packed": ("a.mat", partial(_matlab5, 25_000)),
    "MATLAB 5: 4 MB that state 4 GB": ("a.mat", partial(_matlab5, 1)),
    "netCDF-3: 2^31 records": ("a.nc", partial(_netcdf3, 2**31 - 1, 7)),
    "netCDF-3: records of 16 GB": ("a.nc", partial(_netcdf3, 3, 2**31 - 1)),
    "flight: 2^31 samples": ("a.nc", partial(_own_flight, 2**31 - 1)),
    "flight: no samples": ("a.nc", partial(_own_flight, 0)),
}  #: kind -> name of a file, and what makes its content
