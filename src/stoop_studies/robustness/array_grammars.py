"""Files of arrays drawn at random and written by the libraries of their formats: MATLAB, HDF5, netCDF and Parquet.

They hold what the formats allow and flight logs seldom have: every type and width of number, texts, complex numbers, empty and
nested arrays, links in circles, fill values and scales. A clock and a gyroscope are among them, so that most are read.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from stoop_studies.robustness.damaged_logs import Sample, single
from stoop_studies.robustness.log_grammars import Draw
from stoop_studies.robustness.sample_logs import ARRAY_MAPPING, NETCDF_MAPPING

TYPES: Final = (
    "f2",
    "f4",
    "f8",
    "i1",
    "u1",
    "i2",
    "u2",
    "i4",
    "u4",
    "i8",
    "u8",
    ">f4",
    ">i4",
    "?",
    "c8",
    "c16",
)
NETCDF_TYPES: Final = {
    "f4": "f",
    "f8": "d",
    "i1": "b",
    "i2": "h",
    "i4": "i",
    "S1": "",
}  #: type -> letter of struct
DEPTH: Final = 4  #: of groups and structures
NAMES: Final = ("time", "t", "gyro", "x", "y", "z", "q", "name", "acc", "data")
Array = npt.NDArray[Any]


def numbers(draw: Draw, count: int, letters: str = "") -> Array:
    """Draw an array of any type of number, of `count` samples or of another shape."""
    kind = letters or draw.rng.choice(TYPES)
    shape = draw.rng.choice(
        (
            (count,),
            (count, 1),
            (1, count),
            (count, 3),
            (3, count),
            (0,),
            (),
            (2, 2, count),
            (3, 1, count),
            (count, 80),
        )
    )
    size = math.prod(shape)
    with np.errstate(all="ignore"):
        return (
            np.array([draw.number("d") for _ in range(min(size, 400))] + [0.5] * max(size - 400, 0))
            .astype(kind)
            .reshape(shape)
        )


def motion(draw: Draw, count: int) -> dict[str, Array]:
    """Draw a clock and a gyroscope."""
    t = np.array(draw.clock(count, 0.02))
    return {"time": t, "gyro": np.array([[draw.number("f") for _ in range(3)] for _ in range(count)])}


def _value(draw: Draw, count: int, depth: int) -> Any:
    """Draw what SciPy writes into a MATLAB file."""
    choice = draw.rng.randrange(8)
    if choice == 0 and depth < DEPTH:
        return {
            draw.rng.choice(NAMES): _value(draw, count, depth + 1) for _ in range(draw.rng.randrange(1, 4))
        }
    if choice == 1:
        return draw.word("text")
    if choice == 2 and depth < DEPTH:
        cells = np.empty(draw.rng.randrange(4), dtype=object)
        for i in range(len(cells)):
            cells[i] = _value(draw, count, depth + 1)
        return cells
    if choice == 3:
        return np.array([(1.0, 2)] * draw.rng.randrange(4), dtype=[("x", "f8"), ("n", "i4")])
    return numbers(draw, count)


DESCRIPTION: Final = b"MATLAB 5.0 MAT-file"  #: 116 bytes of text begin such a file


def matlab(draw: Draw) -> Sample:
    """Draw a MATLAB file of version 5."""
    from scipy.io import savemat

    count = draw.rng.choice((1, 2, 50))
    tree: dict[str, Any] = {
        draw.rng.choice(NAMES): _value(draw, count, 0) for _ in range(draw.rng.randrange(6))
    }
    known = motion(draw, count)
    tree |= {"time": known["time"], "gyro": {k: known["gyro"][:, i] for i, k in enumerate("xyz")}}
    sink: Any = io.BytesIO()  # SciPy's types know paths only
    savemat(sink, tree, do_compression=draw.rng.random() < 0.5, oned_as=draw.rng.choice(("row", "column")))
    dated = sink.getvalue()  # its first line says when it was written
    return single("a.mat", DESCRIPTION.ljust(116) + dated[116:], "matlab", ARRAY_MAPPING)


def _grow(draw: Draw, group: Any, count: int, depth: int) -> None:
    """Fill a group of HDF5."""
    import h5py

    for i in range(draw.rng.randrange(5)):
        name = draw.rng.choice(NAMES) + (str(i) if draw.rng.random() < 0.5 else "")
        if name in group:
            continue
        choice = draw.rng.randrange(9)
        if choice == 0 and depth < DEPTH:
            _grow(draw, group.create_group(name), count, depth + 1)
        elif choice == 1:
            link = draw.rng.choice(
                (h5py.SoftLink("/"), h5py.SoftLink("/none"), h5py.ExternalLink("/etc/passwd", "/"))
            )
            group[name] = link
        elif choice == 2:
            group[name] = group  # a circle
        elif choice == 3:
            group.create_dataset(name, data=np.array(["a", "b"] * 3, dtype=object), dtype=h5py.string_dtype())
        elif choice == 4:
            group.create_dataset(name, data=h5py.Empty("f8"))
        else:
            data = numbers(draw, count)
            packed = (
                {"compression": "gzip", "fillvalue": 1}
                if data.ndim and data.size and data.dtype.kind in "fiu"
                else {}
            )
            made = group.create_dataset(name, data=data, **packed)
            made.attrs["units"] = np.bytes_(draw.word("rad/s").encode("utf-8", "surrogatepass") or b" ")


def hdf5(draw: Draw) -> Sample:
    """Draw an HDF5 file, as MATLAB 7.3 and netCDF 4 write them."""
    import h5py

    sink, count = io.BytesIO(), draw.rng.choice((1, 2, 50))
    with h5py.File(sink, "w") as file:
        known = motion(draw, count)
        file["time"] = known["time"]
        for i, axis in enumerate("xyz"):
            file[f"gyro/{axis}"] = known["gyro"][:, i]
        _grow(draw, file, count, 0)
    return single("a.h5", sink.getvalue(), "hdf5", ARRAY_MAPPING)


def netcdf(draw: Draw) -> Sample:
    """Draw a netCDF 3 file."""
    from scipy.io import netcdf_file

    sink, count = io.BytesIO(), draw.rng.choice((1, 2, 50))
    file = netcdf_file(sink, "w")
    file.createDimension("time", draw.rng.choice((None, count)))
    columns = {"time": "f8", "q": "f8"} | {
        n: draw.rng.choice(list(NETCDF_TYPES)) for n in draw.rng.sample(NAMES[1:], 3)
    }
    for name, kind in columns.items():
        variable: Any = file.createVariable(name, kind, ("time",))
        if kind == "S1":
            variable[:] = np.full(count, b"a")
            continue
        known = motion(draw, count)
        with np.errstate(all="ignore"):
            variable[:] = (known["time"] if name == "time" else known["gyro"][:, 0]).astype(kind)
        for key in draw.rng.sample(("scale_factor", "add_offset", "_FillValue", "missing_value"), 2):
            setattr(variable, key, draw.number(NETCDF_TYPES[kind] if key == "_FillValue" else "d"))
        variable.units = draw.word("rad/s").encode("utf-8", "replace")
    with np.errstate(all="ignore"):  # of attributes that do not fit; closing writes once more
        file.flush()
        content = sink.getvalue()
        file.close()
    return single("a.nc", content, "words", NETCDF_MAPPING)


def parquet(draw: Draw) -> Sample:
    """Draw a Parquet file."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    count = draw.rng.choice((0, 1, 2, 50))
    known = motion(draw, max(count, 1))
    columns: dict[str, Any] = {"time": known["time"][:count], "gyro.x": known["gyro"][:count, 0]}
    for i in range(draw.rng.randrange(5)):
        kinds: tuple[Callable[[], Any], ...] = (
            lambda: pa.array([None] * count, pa.null()),
            lambda: pa.array([draw.word("a").encode("utf-8", "replace") for _ in range(count)], pa.binary()),
            lambda: pa.array([[0.5] * draw.rng.randrange(4) for _ in range(count)], pa.list_(pa.float64())),
            lambda: pa.array(
                [{"x": 1.0, "y": "a"}] * count, pa.struct([("x", pa.float64()), ("y", pa.string())])
            ),
            lambda: pa.array(
                [draw.number("q") for _ in range(count)],
                pa.timestamp(draw.rng.choice(("ms", "us", "ns"))),
            ),
            lambda: pa.array(
                [{"x": draw.number("d")} if draw.rng.random() < 0.7 else None for _ in range(count)],
                pa.struct([("x", pa.float64())]),
            ),
            lambda: pa.array([[0.5, draw.number("d")] for _ in range(count)], pa.list_(pa.float64(), 2)),
            lambda: pa.array([draw.rng.choice((None, 1, 7)) for _ in range(count)], pa.decimal128(12, 3)),
            lambda: pa.array(["a"] * count).dictionary_encode(),
            lambda: pa.array([True] * count),
            lambda: pa.array(np.zeros(count, "f2")),
            lambda: pa.array([draw.number("Q") for _ in range(count)], pa.uint64()),
        )
        name = draw.rng.choice(NAMES) + (str(i) if draw.rng.random() < 0.7 else "")
        columns[name] = draw.rng.choice(kinds)()
    sink = io.BytesIO()
    pq.write_table(pa.table(columns), sink, compression=draw.rng.choice(("none", "snappy", "zstd", "gzip")))
    return single("a.parquet", sink.getvalue(), "parquet", ARRAY_MAPPING)


ARRAY_GRAMMARS: Final[Mapping[str, Callable[[Draw], Sample]]] = {
    "matlab": matlab,
    "hdf5": hdf5,
    "netcdf": netcdf,
    "parquet": parquet,
}  #: format -> its files
