import gc
from dataclasses import replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from robustness.corpus import Case, cases
from robustness.other_readers import READERS, SAME, Samples, compare, compare_samples
from robustness.readers import in_this_process
from robustness.trials import BAD, LISTED, BrokenPromiseError, try_case
from scipy.io import savemat

from stoop import logs
from stoop.errors import LogError, OutputError
from stoop.flight import Flight, from_columns, load_flight
from stoop.logs.csv_tables import read_table
from stoop.logs.recording import Defect
from stoop_plan.flight_logs import save_flight_as
from stoop_plan.log_bytes import ulog, ulog_text

pytestmark = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
FMT = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 130, 25, IMU, Qff, TimeUS,GyrX,GyrY\n"
TIME = np.arange(4.0)


@pytest.mark.parametrize("form", READERS)
def test_an_independent_reader_finds_the_same_numbers(form: str, tmp_path: Path) -> None:
    def twice(folder: Path, case: Case) -> str:
        return compare(form, *case.write(folder))

    read = 0
    for case in cases(form):
        ended = try_case(twice, tmp_path, case)
        assert ended.outcome not in BAD, f"{case.case}: {ended.message}"
        both = ended.outcome in (SAME, LISTED)
        assert both or not case.case.startswith("sound") or not case.entry, case.case
        read += both
    gc.collect()  # files that pyulog leaves open
    assert read > 3


def test_a_difference_is_seen() -> None:
    wandering = np.array([0.0, 5.0, 1.0, 2.0])
    dropped = [Defect("time order", "a", "1 of 4 samples dropped: time stands still or runs back")]
    for time, x, other, about, what in (
        (TIME, TIME, Samples(TIME, {"x": TIME + 1e-15}), [], "is not"),
        (TIME, TIME, Samples(TIME, {"x": TIME, "y": TIME}), [], "lost the columns"),
        (TIME[1:], TIME[1:], Samples(TIME, {"x": TIME}), [], "lost samples"),
        (TIME[:2], TIME[:2], Samples(wandering, {"x": wandering}), dropped, "2 samples of 4, not 3"),
        (TIME, -0.0 * TIME, Samples(TIME, {"x": 0.0 * TIME}), [], "is not"),
    ):
        with pytest.raises(BrokenPromiseError, match=what):
            compare_samples("a", time, {"x": x}, other, about)


def test_cut_lines_names_of_text_logs_and_a_log_without_rows(tmp_path: Path) -> None:
    rows = "IMU, 1000, 1, 2\nIMU, 2000, 1, 2\nIMU, 3000, 1, 2"
    (tmp_path / "a.log").write_text(FMT.replace("GyrX", "é") + rows, encoding="utf-8")
    found = logs.read(tmp_path / "a.log")
    assert found.streams["IMU"].time.tolist() == [0.001, 0.002]
    assert [d.kind for d in found.defects] == ["truncated"]
    assert set(found.streams["IMU"].columns) == {"é", "GyrY"}
    for content, listed in (
        ("t,x,\n0,1,\n1,2,\n", False), ("t,x\n0,1,\n1,2,\n", False), ("t,x\n0,1,5\n1,2,6\n", True), ("t,x,y\n0,1\n1,2\n", True),
    ):  # fmt: skip
        (tmp_path / "a.csv").write_text(content)
        columns, defects = read_table(tmp_path / "a.csv")
        assert (columns["x"].tolist(), bool(defects)) == ([1.0, 2.0], listed), content
    (tmp_path / "a.ulg").write_bytes(ulog([]) + ulog_text(1.0, "INFO", "x")[:-1] + b"\xff" * 40)
    with pytest.raises(LogError, match=r"no topic holds data \(a.ulg, byte"):
        logs.read(tmp_path / "a.ulg")


@in_this_process()
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
        file["time"], file["x"], file["none"], file["empty"] = TIME, TIME, h5py.Empty("f8"), np.zeros((4, 0))
    found = logs.read(tmp_path / "a.h5")
    assert set(found.streams["data"].columns) == {"time", "x"}
    assert ["none" in d.message for d in found.defects] == [True]


def flight(start: float, values: np.ndarray[Any, Any], **parameters: float) -> Flight:
    columns = {"q": values, "motor_1": values, "phi": values}
    return replace(from_columns("a", start + 0.01 * np.arange(values.size), columns), parameters=parameters)


@in_this_process()
@pytest.mark.filterwarnings("error")
def test_impossible_values_are_missing_in_a_flight_and_in_what_is_written(tmp_path: Path) -> None:
    values = np.where(np.arange(50) == 7, np.inf, np.where(np.arange(50) == 9, 1e300, 0.25))
    made = flight(2.0, values, P=1e300, **{"N" * 300: 1.0})
    assert [n.code for n in made.notices] == ["impossible-values"] * 3
    for ending in (".nc", ".csv", ".mat", ".parquet", ".ulg", ".bin", ".usd"):
        save_flight_as(made, tmp_path / f"a{ending}")
        q = load_flight(tmp_path / f"a{ending}").column("q")
        assert np.nanmax(np.abs(q - 0.25)) < 1e-6, ending
        assert np.isfinite(q).sum() >= 40, ending


def test_clocks_from_1970_and_those_that_no_autopilot_has(tmp_path: Path) -> None:
    made = flight(1.7e9, np.zeros(50))
    save_flight_as(made, tmp_path / "a.csv")
    np.testing.assert_allclose(load_flight(tmp_path / "a.csv").time, made.time, rtol=1e-15)
    for start in (-5.0, 1e13):
        moved = replace(made, data=made.data.assign_coords(time=made.time - 1.7e9 + start))
        for ending in (".ulg", ".bin", ".usd"):
            with pytest.raises(OutputError, match="end the name in"):
                save_flight_as(moved, tmp_path / f"a{ending}")
        save_flight_as(moved, tmp_path / "a.nc")
