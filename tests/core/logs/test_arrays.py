"""Files of arrays, written by the libraries themselves: clocks are found, damage is an error in one line."""

from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import netcdf_file, savemat

from stoop.errors import LogError
from stoop.logs import read
from stoop.logs.arrays import Array, assemble
from stoop.logs.guard import parse

N = 40
TIME = 5.0 + 0.01 * np.arange(N)
GYRO = np.random.default_rng(1).normal(size=(N, 3))


def old_matlab(path: Path, compressed: bool = True) -> None:
    gyro, cell = {"x": GYRO[:, 0], "all": GYRO}, np.array([1, "a"], object)
    ins = {"t": TIME[:, None], "gyro": gyro, "name": "imu", "cell": cell}
    air = {"time_ms": np.arange(0.0, 100.0, 5.0)[:, None], "p": np.arange(20, dtype=np.int16)}
    savemat(path, {"ins": ins, "air": air, "mass": 2.5, "turned": GYRO.T}, do_compression=compressed)


def new_matlab(path: Path) -> None:
    with h5py.File(path, "w", userblock_size=512) as file:
        for place, values in (("ins/t", TIME[None]), ("ins/gyro/x", GYRO[None, :, 0]), ("ins/gyro/all", GYRO.T),
                              ("air/time_ms", np.arange(0.0, 100.0, 5.0)[None]), ("air/p", np.arange(20.0)[None]),
                              ("mass", np.array([[2.5]])), ("turned", GYRO)):  # fmt: skip
            file[place] = values
            file[place].attrs["MATLAB_class"] = np.bytes_("double")
        file["ins/name"] = np.frombuffer(b"i\0m\0u\0", np.uint16)[:, None]
        file["ins/name"].attrs["MATLAB_class"] = np.bytes_("char")
        file["link"] = h5py.ExternalLink("/etc/passwd", "/")
        file.create_dataset("outside", (N,), "u1", external=[("/etc/passwd", 0, N)])
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64".ljust(124) + b"\0\2IM")


def classic_netcdf(path: Path) -> None:
    with netcdf_file(path, "w") as file:
        file.createDimension("time", N)
        for name, values, unit in (("time", TIME, b"seconds since 2026-01-01"), ("q", GYRO[:, 1], b"rad/s")):
            variable = file.createVariable(name, "d", ("time",))
            variable[:], variable.units = values, unit
        packed = file.createVariable("h", "h", ("time",))
        packed[:], packed.scale_factor, packed.add_offset, packed._FillValue = np.arange(N), 0.5, 10.0, 3


def new_netcdf(path: Path) -> None:
    with h5py.File(path, "w") as file:
        file["time"], file["q"] = TIME, GYRO[:, 1]
        file["time"].attrs["units"], file["q"].attrs["units"] = "seconds since 2026-01-01", "rad/s"
        file["h"] = np.arange(N, dtype="i2")
        file["h"].attrs.update({"scale_factor": 0.5, "add_offset": 10.0, "_FillValue": np.int16(3)})


def table(path: Path) -> None:
    gyro = pa.FixedSizeListArray.from_arrays(pa.array(GYRO.ravel()), 3)
    nested = pa.StructArray.from_arrays([pa.array(GYRO[:, 0])], ["x"])
    stamp = pa.array((1e6 * TIME).astype(np.int64), pa.timestamp("us"))
    gaps = pa.array([None, *range(N - 1)], pa.int32())
    pq.write_table(pa.table({"time": stamp, "gyro": gyro, "ins": nested, "n": gaps, "name": ["a"] * N}), path)


WRITERS: dict[str, tuple[Callable[[Path], None], str]] = {
    "old.mat": (old_matlab, "matlab"),
    "new.mat": (new_matlab, "matlab"),
    "old.nc": (classic_netcdf, "foreign-netcdf"),
    "new.nc": (new_netcdf, "foreign-netcdf"),
    "a.parquet": (table, "parquet"),
}


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    folder = tmp_path_factory.mktemp("tables")
    for name, (write, _) in WRITERS.items():
        write(folder / name)
    return {name: folder / name for name in WRITERS}


@pytest.mark.parametrize("name", ["old.mat", "new.mat"])
def test_structures_of_matlab(files: dict[str, Path], name: str) -> None:
    recording = parse("matlab", files[name])
    assert recording.format == "mat"
    assert set(recording.streams) == {"ins", "air"}
    ins = recording.streams["ins"]
    np.testing.assert_array_equal(ins.time, TIME)
    vectors = {f"{of}[{k}]" for of in ("gyro.all", "turned") for k in range(3)}
    assert set(ins.columns) == {"t", "gyro.x", *vectors}
    np.testing.assert_array_equal(ins.columns["gyro.all[2]"], GYRO[:, 2])
    np.testing.assert_array_equal(ins.columns["turned[1]"], GYRO[:, 1])
    np.testing.assert_allclose(recording.streams["air"].time, 0.005 * np.arange(20))
    assert recording.parameters == {"mass": 2.5}
    assert [d.kind for d in recording.defects] == ["skipped"]
    assert str(recording.defects[0]).startswith(f"{name}: {'ins.cell' if name == 'old.mat' else 'outside'}: ")
    some = read(files[name], topics=frozenset({"air"}))
    assert set(some.streams) == {"air"}
    assert some.unread == {"ins": ()}


@pytest.mark.parametrize("name", ["old.nc", "new.nc"])
def test_netcdf_of_others(files: dict[str, Path], name: str) -> None:
    recording = parse("foreign-netcdf", files[name])
    stream, packed = recording.streams["data"], 0.5 * np.arange(N) + 10.0
    np.testing.assert_array_equal(stream.time, TIME)
    np.testing.assert_array_equal(stream.columns["h"], np.where(np.arange(N) == 3, np.nan, packed))
    assert recording.units["data"]["q"] == "rad/s"


def test_parquet(files: dict[str, Path]) -> None:
    recording = parse("parquet", files["a.parquet"])
    stream = recording.streams["data"]
    np.testing.assert_allclose(stream.time, TIME, rtol=1e-12)
    np.testing.assert_array_equal(stream.columns["gyro[1]"], GYRO[:, 1])
    np.testing.assert_array_equal(stream.columns["ins.x"], GYRO[:, 0])
    assert np.isnan(stream.columns["n"][0])
    assert [str(d) for d in recording.defects] == ["name: holds no numbers"]


def test_the_child_hands_back_the_same(files: dict[str, Path]) -> None:
    (files["old.mat"].parent / "old.nc.toml").touch()  # without one it is taken for a flight of stoop
    for name in ("old.mat", "old.nc", "a.parquet"):
        mine, theirs = parse(WRITERS[name][1], files[name]), read(files[name])
        for kind in ("format", "defects", "units", "info"):
            assert getattr(mine, kind) == getattr(theirs, kind)
        assert set(mine.streams) == set(theirs.streams)
        for key, stream in mine.streams.items():
            np.testing.assert_array_equal(stream.time, theirs.streams[key].time)
            for column, values in stream.columns.items():
                np.testing.assert_array_equal(values, theirs.streams[key].columns[column])


def test_clocks() -> None:
    ms = np.arange(0, 400, 10)
    arrays = [
        Array(("a", "Time"), TIME[:, None]), Array(("a", "b", "x"), GYRO[:, 0]), Array(("SysTime",), ms),
        Array(("c", "v"), np.ones(N)), Array(("d", "w"), np.ones(7)),
        Array(("t",), np.zeros(9)), Array(("t_us",), np.arange(N - 1)),
    ]  # fmt: skip
    recording = assemble(Path("a"), "mat", arrays)
    assert set(recording.streams) == {"a", "data", "d", "data[9]", "t_us"}
    assert list(recording.streams["a"].columns) == ["Time", "b.x"]
    np.testing.assert_allclose(recording.streams["data"].time, 1e-3 * ms)
    assert recording.info["clock of data"] == "SysTime in units of 0.001 s, which is guessed"
    np.testing.assert_array_equal(recording.streams["d"].time, np.arange(7.0))
    assert [d.place for d in recording.defects] == ["d", "data[9]"]


def test_damage_to_one_array_costs_no_other(files: dict[str, Path], tmp_path: Path) -> None:
    content = bytearray(files["old.mat"].read_bytes())
    content[160:170] = bytes(10)
    (tmp_path / "a.mat").write_bytes(content)
    recording = parse("matlab", tmp_path / "a.mat")
    assert "air" in recording.streams
    assert recording.defects[0].place == "a.mat byte 128"
    content = bytearray(files["a.parquet"].read_bytes())
    content[4:40] = bytes(36)  # the head of the first page
    (tmp_path / "a.parquet").write_bytes(content)
    recording = parse("parquet", tmp_path / "a.parquet")
    assert "gyro[1]" in recording.streams["data"].columns
    assert recording.defects[0].place == "time"
    path = tmp_path / "flight.mat"
    with h5py.File(path, "w", libver="latest") as file:
        file["t"], file["good"] = np.arange(100) / 10.0, np.sin(np.arange(100.0))
        file["bad"] = np.arange(77.0)
    content = bytearray(path.read_bytes())
    heads = [place for place in range(len(content)) if content.startswith(b"OHDR", place)]
    content[heads[3]] ^= 1  # after those of the file, t and good
    path.write_bytes(content)
    recording = parse("matlab", path)
    assert [str(defect)[:4] for defect in recording.defects if defect.kind == "corrupt"] == ["bad:"]
    assert recording.streams["data"].columns["good"][50] == np.sin(50.0)


def test_zeros_that_pack_a_thousand_to_one_are_refused(tmp_path: Path) -> None:
    savemat(tmp_path / "a.mat", {"t": TIME, "x": np.zeros(7_000_000)}, do_compression=True)
    with h5py.File(tmp_path / "bomb.nc", "w") as file:
        file.create_dataset("time", (10**9,), "f8", chunks=(10**6,), compression="gzip")
    with pytest.raises(LogError, match="for a file that short"):
        parse("matlab", tmp_path / "a.mat")
    with pytest.raises(LogError, match="numbers; save only the flight"):
        parse("foreign-netcdf", tmp_path / "bomb.nc")


def test_groups_in_circles_are_entered_once(tmp_path: Path) -> None:
    """Two circles double the ways with every step: sixteen steps would be 65,536 groups."""
    path = tmp_path / "a.nc"
    with h5py.File(path, "w") as file:
        file["motion/time"] = np.arange(50) / 10.0
        file["motion/q"] = np.sin(np.arange(50.0))
        for name in ("one", "two", "three"):
            file["motion"][name] = file["motion"]
            file[name] = file
    recording = parse("foreign-netcdf", path)
    assert list(recording.streams) == ["motion"]
    assert sorted(recording.streams["motion"].columns) == ["q", "time"]
