"""Files of arrays, as SciPy, h5py and pyarrow write them."""

from __future__ import annotations

import io
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop_studies.verify.readers.sample import Sample, single

N: Final = 40
MAPPING: Final = b"""\
[variables]
p = { column = "gyro.x", unit = "rad/s" }
q = { column = "q", unit = "rad/s", optional = true }
"""
FLAT: Final = b'[variables]\nq = { column = "q[0]", unit = "rad/s" }\n'


def _time() -> FloatArray:
    return np.asarray(5.0 + 0.02 * np.arange(N))


def _gyro() -> FloatArray:
    return np.asarray(np.random.default_rng(1).normal(size=(N, 3)))


def old_matlab() -> list[Sample]:
    """Return files of version 5, packed and not, and of version 4."""
    ins = {
        "t": _time()[:, None], "gyro": {"x": _gyro()[:, :1], "all": _gyro()}, "name": "imu",
        "cell": np.array([1, "a"], object),
    }  # fmt: skip
    air = {"time_ms": np.arange(0.0, 100.0, 5.0)[:, None], "p": np.arange(20, dtype=np.int16)}
    deep = {"ins": ins, "air": air, "mass": 2.5, "turned": _gyro().T}
    flat = {"t": _time()[:, None], "q": _gyro()}
    return [
        _matlab(deep, MAPPING, "words", do_compression=False),
        _matlab({"ins": ins}, MAPPING, "matlab", do_compression=True),
        _matlab(flat, FLAT, "words", format="4"),
    ]


def _matlab(content: dict[str, Any], mapping: bytes, form: str, **how: Any) -> Sample:
    from scipy.io import savemat

    file: Any = io.BytesIO()  # SciPy's stubs know names only
    savemat(file, content, **how)
    raw = file.getvalue()
    undated = raw if "format" in how else b"MATLAB 5.0 MAT-file".ljust(116) + raw[116:]
    return single("a.mat", undated, form, mapping)


def hdf5_matlab() -> list[Sample]:
    """Return a file of version 7.3."""
    arrays = {
        "ins/t": _time()[None], "ins/gyro/x": _gyro()[None, :, 0], "ins/gyro/all": _gyro().T, "air/p": np.arange(20.0)[None],
        "mass": np.array([[2.5]]),
    }  # fmt: skip
    raw = _hdf5(arrays, {"MATLAB_class": np.bytes_("double")}, 512)
    return [single("a.mat", b"MATLAB 7.3 MAT-file".ljust(124) + b"\0\2IM" + raw[128:], "hdf5", MAPPING)]


def hdf5_netcdf() -> list[Sample]:
    """Return files of version 4: plain, and in packed pieces with a checksum."""
    arrays = {"time": _time(), "q": _gyro()[:, 1], "h": np.arange(N, dtype="i2")}
    told = {"units": "s", "scale_factor": 1.0}
    mapping = b'[variables]\nq = { column = "q", unit = "rad/s" }\n'
    pieces = {"chunks": (20,), "compression": "gzip", "fletcher32": True}
    return [
        single("a.nc", _hdf5(arrays, told, 0, **more), "hdf5", mapping)
        for more in ({}, pieces, {"libver": "latest"})
    ]


def _hdf5(arrays: dict[str, Any], told: dict[str, Any], block: int, libver: Any = None, **how: Any) -> bytes:
    import h5py

    file = io.BytesIO()
    with h5py.File(file, "w", userblock_size=block, libver=libver) as hdf:
        for place, values in arrays.items():
            hdf.create_dataset(place, data=values, **how).attrs.update(told)
    return file.getvalue()


def netcdf3() -> list[Sample]:
    """Return a classic file with a fill value and a scale, and one with records."""
    from scipy.io import netcdf_file

    found = []
    for length in (N, None):
        raw = io.BytesIO()
        file = netcdf_file(raw, "w")
        file.createDimension("time", length)
        for name, values, unit in (
            ("time", _time(), b"seconds since 2026-01-01"),
            ("q", _gyro()[:, 1], b"rad/s"),
        ):
            variable: Any = file.createVariable(name, "d", ("time",))
            variable[:], variable.units = values, unit
        packed: Any = file.createVariable("h", "h", ("time",))
        packed[:], packed.scale_factor, packed._FillValue = np.arange(N), 0.5, 3
        file.flush()
        mapping = b'[variables]\nq = { column = "q", unit = "rad/s" }\n'
        found.append(single("a.nc", raw.getvalue(), "words", mapping))
    return found  # fmt: skip


def parquet() -> list[Sample]:
    """Return tables plain and packed, with nested columns, gaps and a dictionary."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    gyro = pa.FixedSizeListArray.from_arrays(pa.array(_gyro().ravel()), 3)
    nested = pa.StructArray.from_arrays([pa.array(_gyro()[:, 0])], ["x"])
    stamp = pa.array((1e6 * _time()).astype(np.int64), pa.timestamp("us"))
    gaps = pa.array([None, *range(N - 1)], pa.int32())
    rich = pa.table({"time": stamp, "all": gyro, "gyro": nested, "n": gaps, "name": ["a"] * N})
    flat = pa.table({"time": _time(), "gyro.x": _gyro()[:, 0], "k": np.arange(N) % 3})
    found = []
    for table, how in (
        (rich, {"compression": "none"}),
        (flat, {"compression": "snappy", "row_group_size": 16}),
        (flat, {"compression": "zstd", "data_page_version": "2.0", "use_dictionary": False}),
        (flat, {"compression": "gzip", "write_page_checksum": True}),
    ):
        sink = io.BytesIO()
        pq.write_table(table, sink, **how)
        found.append(single("a.parquet", sink.getvalue(), "parquet", MAPPING))
    return found
