"""Readers against independent readers, writers against readers, and what they found, once each."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat
from studies.robustness import differential
from studies.robustness.corpus import Case, cases, sound
from studies.robustness.differential import SAME, compare_samples, longest_run
from studies.robustness.other_readers import READERS, Samples
from studies.robustness.readers import in_this_process
from studies.robustness.trials import BAD, LISTED, BrokenPromiseError, try_case

from stoop import logs
from stoop.errors import LogError, OutputError
from stoop.exporters.flight_logs import save_flight_as
from stoop.exporters.log_bytes import Table, Topic, dataflash_bytes, ulog, ulog_text
from stoop.flight import Flight, from_columns, load
from stoop.logs.recording import Defect, increasing

#: pyulog leaves files open
pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
FMT = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 130, 25, IMU, Qff, TimeUS,GyrX,GyrY\n"
TIME = np.arange(4.0)
WANDERING = np.array([0.0, 5.0, 1.0, 2.0])
DROPPED = Defect("time order", "a", "1 of 4 samples dropped: time stands still or runs back")


def read_twice(form: str, found: Iterable[Case], folder: Path) -> int:
    """Compare logs, and return how many both read; what is left out is listed."""

    def compare(folder: Path, case: Case) -> str:
        return differential.compare(form, *case.write(folder))

    read = 0
    for case in found:
        ended = try_case(compare, folder, case)
        assert ended.outcome not in BAD, f"{case.case}: {ended.message}"
        read += ended.outcome in (SAME, LISTED)
    return read


@pytest.mark.parametrize("form", ["ulog", "dataflash", "dataflash-text", "csv", "netcdf-3"])
def test_an_independent_reader_finds_the_same_numbers(form: str, tmp_path: Path) -> None:
    logs_of_form = [case for case in sound(form) if case.entry]
    assert read_twice(form.removesuffix("-3"), logs_of_form, tmp_path) == len(logs_of_form) > 0


INTEGERS = {"b": "i1", "B": "u1", "h": "<i2", "H": "<u2", "i": "<i4", "I": "<u4", "q": "<i8", "Q": "<u8"}
SCALED = {"c": "<i2", "C": "<u2", "e": "<i4", "E": "<u4", "L": "<i4"}  #: letters of DataFlash


def extremes(kind: str) -> np.ndarray[Any, Any]:
    """Return the smallest and the largest numbers of a type, and some between."""
    if np.dtype(kind).kind == "f":
        return np.array([-1.5, 0.0, 2.0**-20, 1e4], kind)
    least, most = np.iinfo(kind).min, np.iinfo(kind).max
    return np.array([least, least // 3, most // 5, most], kind)


def test_every_type_of_number_is_that_of_an_independent_reader(tmp_path: Path) -> None:
    """Written by stoop with its extremes, read by stoop and by pymavlink or pyulog."""
    stamps = np.array([1000, 2000, 3000, 5000], "<u8")
    tables = [
        Table(
            name, f"TimeUS,{','.join(f'c{letter}' for letter in kinds)}", f"Q{''.join(kinds)}", "s" + "-" * len(kinds),
            "F" + "-" * len(kinds), {"TimeUS": stamps, **{f"c{letter}": extremes(kind) for letter, kind in kinds.items()}},
        )
        for name, kinds in (("INT", INTEGERS), ("SCA", SCALED | {"f": "<f4", "d": "<f8", "g": "<f2"}))
    ]  # fmt: skip
    (tmp_path / "a.bin").write_bytes(dataflash_bytes(tables, {}, []))
    columns = {f"x{k}": extremes(kind) for k, kind in enumerate((*INTEGERS.values(), "<f4", "<f8"))}
    (tmp_path / "a.ulg").write_bytes(ulog([Topic("all", 1e-6 * stamps, columns)]))
    for form, name in (("dataflash", "a.bin"), ("ulog", "a.ulg")):
        assert differential.compare(form, tmp_path / name, None) == SAME
    found = logs.read(tmp_path / "a.bin").streams["INT"].columns
    for letter, kind in INTEGERS.items():
        assert found[f"c{letter}"] == pytest.approx(extremes(kind).astype(float), rel=1e-12), letter


@pytest.mark.parametrize("form", READERS)
def test_an_independent_reader_finds_the_same_numbers_in_hostile_logs(form: str, tmp_path: Path) -> None:
    assert read_twice(form, (*cases(form), *(cases("netcdf-3") if form == "netcdf" else ())), tmp_path) > 3


def test_a_difference_is_seen() -> None:
    for time, columns, other, about, what in (
        (TIME, {"x": TIME}, Samples(TIME, {"x": TIME + 1e-15}), [], "is not"),
        (TIME, {"x": TIME}, Samples(TIME, {"x": TIME, "y": TIME}), [], "lost the columns"),
        (TIME[1:], {"x": TIME[1:]}, Samples(TIME, {"x": TIME}), [], "lost samples"),
        (TIME[:2], {"x": TIME[:2]}, Samples(WANDERING, {"x": WANDERING}), [DROPPED], "2 samples of 4, not 3"),
        (TIME, {"x": -0.0 * TIME}, Samples(TIME, {"x": 0.0 * TIME}), [], "is not"),
    ):
        with pytest.raises(BrokenPromiseError, match=what):
            compare_samples("a", time, columns, other, about)
    kept, gone = WANDERING[[0, 2, 3]], np.array([np.nan, 1.0, 2.0, 3.0])
    compare_samples("a", kept, {"x": kept}, Samples(WANDERING, {"x": WANDERING}), [DROPPED])
    compare_samples("a", TIME, {"x": gone, "more": TIME}, Samples(TIME, {"x": gone}), [])


def test_the_longest_run_is_that_of_the_readers() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        time = rng.choice([*rng.normal(size=8), np.nan, np.inf], size=12)
        assert longest_run(time) == increasing(time).size


def text_log(folder: Path, lines: str, head: str = FMT) -> logs.Recording:
    (folder / "a.log").write_text(head + lines, encoding="utf-8")
    return logs.read(folder / "a.log")


def test_cells_cut_lines_and_names_of_text_logs(tmp_path: Path) -> None:
    """A cell is the same number in a short and in a long log; the last line may be cut; names are UTF-8."""
    for lines in (2, 60):
        rows = [f"IMU, {1000 * i}, 1.5, 2" for i in range(1, lines + 1)]
        found = text_log(tmp_path, "\n".join([*rows, "IMU, 900000, 1_0, 2", ""]))
        assert np.isnan(found.streams["IMU"].columns["GyrX"][-1])
        assert [d.kind for d in found.defects] == ["text"]
    found = text_log(tmp_path, "IMU, 1000, 1, 2\nIMU, 2000, 1, 2\nIMU, 3000, 1, 2")
    assert found.streams["IMU"].time.tolist() == [0.001, 0.002]
    assert [d.kind for d in found.defects] == ["truncated"]
    found = text_log(tmp_path, "IMU, 1000, 1, 2\n", FMT.replace("GyrX", "é"))
    assert set(found.streams["IMU"].columns) == {"é", "GyrY"}


def test_lines_that_do_not_fit_their_header(tmp_path: Path) -> None:
    (tmp_path / "a.csv.toml").write_text("[time]\ncolumn = 't'\nunit = 's'\n", encoding="utf-8")
    for content, listed in {
        "t,x,\n0,1,\n1,2,\n": False,
        "t,x\n0,1,\n1,2,\n": False,
        "t,x\n0,1,5\n1,2,6\n": True,
        "t,x,y\n0,1\n1,2\n": True,
    }.items():
        (tmp_path / "a.csv").write_text(content, encoding="utf-8")
        found = logs.read(tmp_path / "a.csv")
        assert found.streams["a.csv"].columns["x"].tolist() == [1.0, 2.0], content
        assert bool(found.defects) == listed, content


@pytest.fixture
def _without_child() -> Iterator[None]:
    with in_this_process():
        yield


@pytest.mark.usefixtures("_without_child")
def test_arrays_of_odd_shapes_and_names(tmp_path: Path) -> None:
    """Simulink saves a vector as 3 x 1 x n. Three real dimensions, second columns of a name and no numbers are listed."""
    rows = np.arange(150.0).reshape(3, 1, 50)
    savemat(tmp_path / "a.mat", {"time": np.arange(50.0), "w": rows, "cube": np.zeros((2, 2, 50))})
    found = logs.read(tmp_path / "a.mat")
    assert [found.streams["data"].columns[f"w[{i}]"].tolist() for i in range(3)] == rows[:, 0].tolist()
    assert [(d.kind, "cube" in d.message) for d in found.defects] == [("skipped", True)]
    gyro = pa.StructArray.from_arrays([pa.array(TIME + 5.0)], ["x"])
    wide = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(4 * 70)), 70)
    pq.write_table(pa.table({"time": TIME, "gyro.x": TIME, "gyro": gyro, "w": wide}), tmp_path / "a.parquet")
    found = logs.read(tmp_path / "a.parquet")
    assert found.streams["data"].columns["gyro.x"].tolist() == TIME.tolist()
    assert ["gyro.x, w: of another's name" in d.message for d in found.defects] == [True]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["x"], file["none"] = TIME, TIME, h5py.Empty("f8")
        file["empty"] = np.zeros((4, 0))
    found = logs.read(tmp_path / "a.h5")
    assert set(found.streams["data"].columns) == {"time", "x"}
    assert ["none" in d.message for d in found.defects] == [True]


def test_a_log_without_rows_says_what_is_wrong_with_it(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(ulog([]) + ulog_text(1.0, "INFO", "x")[:-1] + b"\xff" * 40)
    with pytest.raises(LogError, match=r"no topic holds data \(a.ulg, byte"):
        logs.read(tmp_path / "a.ulg")


def flight(start: float, values: np.ndarray[Any, Any], **parameters: float) -> Flight:
    columns = {"q": values, "motor_1": values, "phi": values}
    made = from_columns("a", start + 0.01 * np.arange(values.size), columns)
    return Flight(**{**vars(made), "parameters": parameters})


@pytest.mark.usefixtures("_without_child")
@pytest.mark.filterwarnings("error")
def test_impossible_values_are_missing_in_a_flight_and_in_what_is_written(tmp_path: Path) -> None:
    values = np.where(np.arange(50) == 7, np.inf, np.where(np.arange(50) == 9, 1e300, 0.25))
    made = flight(2.0, values, P=1e300, **{"N" * 300: 1.0})
    assert [n.code for n in made.notices] == ["impossible-values"] * 3
    for ending in (".nc", ".csv", ".mat", ".parquet", ".ulg", ".bin", ".usd"):
        save_flight_as(made, tmp_path / f"a{ending}")
        q = load(tmp_path / f"a{ending}").column("q")
        assert np.nanmax(np.abs(q - 0.25)) < 1e-6, ending
        assert np.isfinite(q).sum() >= 40, ending


def test_clocks_from_1970_and_those_that_no_autopilot_has(tmp_path: Path) -> None:
    made = flight(1.7e9, np.zeros(50))
    save_flight_as(made, tmp_path / "a.csv")
    np.testing.assert_allclose(load(tmp_path / "a.csv").time, made.time, rtol=1e-15)
    made = flight(0.0, np.zeros(50))
    for start in (-5.0, 1e13):
        moved = Flight(**{**vars(made), "data": made.data.assign_coords(time=made.time + start)})
        for ending in (".ulg", ".bin", ".usd"):
            with pytest.raises(OutputError, match="end the name in"):
                save_flight_as(moved, tmp_path / f"a{ending}")
        save_flight_as(moved, tmp_path / "a.nc")
