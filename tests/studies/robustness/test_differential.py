"""Readers against independent readers, and writers against readers, in little; and what they found, once each."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from scipy.io import savemat
from studies.robustness import differential
from studies.robustness.differential import compare_samples, longest_run
from studies.robustness.other_readers import Samples, TooSlowError, limited
from studies.robustness.readers import in_this_process
from studies.robustness.trials import BrokenPromiseError

from stoop import logs
from stoop.checks.kinematics import Motion
from stoop.errors import LogError, OutputError
from stoop.exporters.flight_logs import save_flight_as
from stoop.exporters.log_bytes import ulog, ulog_text
from stoop.flight import Flight, from_columns, load
from stoop.logs import netcdf
from stoop.logs.recording import Defect, increasing

FMT = "FMT, 128, 89, FMT, BBnNZ, Type,Length,Name,Format,Columns\nFMT, 130, 25, IMU, Qff, TimeUS,GyrX,GyrY\n"


TIME = np.arange(4.0)
WANDERING = np.array([0.0, 5.0, 1.0, 2.0])
DROPPED = Defect("time order", "a", "1 of 4 samples dropped: time stands still or runs back")


@pytest.mark.parametrize(
    ("time", "columns", "other", "about", "what"),
    [
        (TIME, {"x": TIME}, Samples(TIME, {"x": TIME + 1e-15}), [], "is not"),
        (TIME, {"x": TIME}, Samples(TIME, {"x": TIME, "y": TIME}), [], "lost the columns"),
        (TIME[1:], {"x": TIME[1:]}, Samples(TIME, {"x": TIME}), [], "lost samples"),
        (TIME[:2], {"x": TIME[:2]}, Samples(WANDERING, {"x": WANDERING}), [DROPPED], "2 samples of 4, not 3"),
        (TIME, {"x": -0.0 * TIME}, Samples(TIME, {"x": 0.0 * TIME}), [], "is not"),
    ],
)
def test_a_difference_is_seen(
    time: Any, columns: Any, other: Samples, about: list[Defect], what: str
) -> None:
    with pytest.raises(BrokenPromiseError, match=what):
        compare_samples("a", time, columns, other, about)


def test_no_difference_is_none() -> None:
    kept = WANDERING[[0, 2, 3]]
    gone = np.array([np.nan, 1.0, 2.0, 3.0])
    compare_samples("a", kept, {"x": kept}, Samples(WANDERING, {"x": WANDERING}), [DROPPED])
    compare_samples("a", TIME, {"x": gone, "more": TIME}, Samples(TIME, {"x": gone}), [])


def test_the_longest_run_is_that_of_the_readers() -> None:
    rng = np.random.default_rng(1)
    for _ in range(100):
        time = rng.choice([*rng.normal(size=8), np.nan, np.inf], size=12)
        assert longest_run(time) == increasing(time).size


def test_another_reader_is_stopped() -> None:
    with limited(), pytest.raises(TooSlowError):
        run_on()


def run_on() -> None:
    while True:
        pass


def test_a_refusal_of_what_another_reads_is_seen(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any) -> None:
        raise LogError("no")

    (tmp_path / "a.log").write_text(FMT + "IMU, 1000, 1, 2\nIMU, 2000, 1, 2\n", encoding="utf-8")
    assert differential.compare("dataflash-text", tmp_path / "a.log", None) == "same"
    monkeypatch.setattr(differential.logs, "read", refuse)
    with pytest.raises(BrokenPromiseError, match="refused, and the other reads"):
        differential.compare("dataflash-text", tmp_path / "a.log", None)


def test_a_mistake_of_ours_is_no_damage_of_a_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A mistake is an exception of some kinds whose innermost frame is ours; a user would be told of damage."""
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["t"] = TIME
        file["x"] = TIME
    with in_this_process():
        assert logs.read(tmp_path / "a.h5").streams
    monkeypatch.setattr(netcdf, "_PACKING", None)
    with in_this_process(), pytest.raises(BrokenPromiseError, match=r"TypeError at netcdf\.py"):
        logs.read(tmp_path / "a.h5")


def text_log(folder: Path, lines: str) -> logs.Recording:
    (folder / "a.log").write_text(FMT + lines, encoding="utf-8")
    return logs.read(folder / "a.log")


@pytest.mark.parametrize("lines", [2, 60])
def test_a_cell_is_the_same_number_in_a_short_and_in_a_long_log(tmp_path: Path, lines: int) -> None:
    rows = [f"IMU, {1000 * i}, 1.5, 2" for i in range(1, lines + 1)]
    found = text_log(tmp_path, "\n".join([*rows, "IMU, 900000, 1_0, 2", ""]))
    assert np.isnan(found.streams["IMU"].columns["GyrX"][-1])
    assert [d.kind for d in found.defects] == ["text"]


def test_the_last_line_of_a_text_log_may_be_cut(tmp_path: Path) -> None:
    found = text_log(tmp_path, "IMU, 1000, 1, 2\nIMU, 2000, 1, 2\nIMU, 3000, 1, 2")
    assert found.streams["IMU"].time.tolist() == [0.001, 0.002]
    assert [d.kind for d in found.defects] == ["truncated"]


def test_names_in_text_logs_are_utf8(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text(FMT.replace("GyrX", "é") + "IMU, 1000, 1, 2\n", encoding="utf-8")
    assert set(logs.read(tmp_path / "a.log").streams["IMU"].columns) == {"é", "GyrY"}


@pytest.mark.parametrize(
    ("content", "listed"),
    [
        ("t,x,\n0,1,\n1,2,\n", False),
        ("t,x\n0,1,\n1,2,\n", False),
        ("t,x\n0,1,5\n1,2,6\n", True),
        ("t,x,y\n0,1\n1,2\n", True),
    ],
)
def test_lines_that_do_not_fit_their_header(tmp_path: Path, content: str, listed: bool) -> None:
    (tmp_path / "a.csv").write_text(content, encoding="utf-8")
    (tmp_path / "a.csv.toml").write_text("[time]\ncolumn = 't'\nunit = 's'\n", encoding="utf-8")
    found = logs.read(tmp_path / "a.csv")
    assert found.streams["a.csv"].columns["x"].tolist() == [1.0, 2.0]
    assert bool(found.defects) == listed


def test_arrays_of_three_dimensions(tmp_path: Path) -> None:
    """Simulink saves a vector as 3 x 1 x n; what has three real dimensions is listed."""
    rows = np.arange(150.0).reshape(3, 1, 50)
    savemat(tmp_path / "a.mat", {"time": np.arange(50.0), "w": rows, "cube": np.zeros((2, 2, 50))})
    found = logs.read(tmp_path / "a.mat")
    assert [found.streams["data"].columns[f"w[{i}]"].tolist() for i in range(3)] == rows[:, 0].tolist()
    assert [(d.kind, "cube" in d.message) for d in found.defects] == [("skipped", True)]


def test_two_columns_of_one_name_and_too_many(tmp_path: Path) -> None:
    gyro = pa.StructArray.from_arrays([pa.array(TIME + 5.0)], ["x"])
    wide = pa.FixedSizeListArray.from_arrays(pa.array(np.zeros(4 * 70)), 70)
    pq.write_table(pa.table({"time": TIME, "gyro.x": TIME, "gyro": gyro, "w": wide}), tmp_path / "a.parquet")
    found = logs.read(tmp_path / "a.parquet")
    assert found.streams["data"].columns["gyro.x"].tolist() == TIME.tolist()
    assert ["gyro.x, w: of another's name" in d.message for d in found.defects] == [True]


def test_a_place_without_numbers_costs_no_other(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["x"] = TIME, TIME
        file["none"] = h5py.Empty("f8")
    found = logs.read(tmp_path / "a.h5")
    assert set(found.streams["data"].columns) == {"time", "x"}
    assert ["none" in d.message for d in found.defects] == [True]


def test_a_log_without_rows_says_what_is_wrong_with_it(tmp_path: Path) -> None:
    (tmp_path / "a.ulg").write_bytes(ulog([]) + ulog_text(1.0, "INFO", "x")[:-1] + b"\xff" * 40)
    with pytest.raises(LogError, match=r"no topic holds data \(a.ulg, byte"):
        logs.read(tmp_path / "a.ulg")


def flight(start: float, values: np.ndarray[Any, Any], **parameters: float) -> Flight:
    made = from_columns(
        "a", start + 0.01 * np.arange(values.size), {"q": values, "motor_1": values, "phi": values}
    )
    return Flight(**{**vars(made), "parameters": parameters})


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("ending", [".nc", ".csv", ".mat", ".parquet", ".ulg", ".bin", ".usd"])
def test_impossible_values_are_missing_in_a_flight_and_in_what_is_written(
    ending: str, tmp_path: Path
) -> None:
    values = np.where(np.arange(50) == 7, np.inf, np.where(np.arange(50) == 9, 1e300, 0.25))
    made = flight(2.0, values, P=1e300, **{"N" * 300: 1.0})
    assert [n.code for n in made.notices] == ["impossible-values"] * 3
    save_flight_as(made, tmp_path / f"a{ending}")
    back = load(tmp_path / f"a{ending}")
    q = back.column("q")
    assert np.nanmax(np.abs(q - 0.25)) < 1e-6
    assert np.isfinite(q).sum() >= 40


def test_a_table_keeps_a_clock_that_counts_from_1970(tmp_path: Path) -> None:
    made = flight(1.7e9, np.zeros(50))
    save_flight_as(made, tmp_path / "a.csv")
    np.testing.assert_allclose(load(tmp_path / "a.csv").time, made.time, rtol=1e-15)


@pytest.mark.parametrize("start", [-5.0, 1e13])
def test_a_clock_that_no_autopilot_has(start: float, tmp_path: Path) -> None:
    made = flight(0.0, np.zeros(50))
    moved = Flight(**{**vars(made), "data": made.data.assign_coords(time=made.time + start)})
    for ending in (".ulg", ".bin", ".usd"):
        with pytest.raises(OutputError, match="end the name in"):
            save_flight_as(moved, tmp_path / f"a{ending}")
    save_flight_as(moved, tmp_path / "a.nc")


def test_a_matrix_without_numbers_is_no_vector(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["time"], file["x"], file["none"] = TIME, TIME, np.zeros((4, 0))
    assert set(logs.read(tmp_path / "a.h5").streams["data"].columns) == {"time", "x"}


@pytest.mark.parametrize("rate", [0.2, 1.0, 3.0])
def test_a_grid_so_slow_that_a_span_holds_no_two_steps(rate: float) -> None:
    time = np.arange(100) / rate
    columns = {"pn": 50.0 * np.sin(0.05 * time), "vn": 2.5 * np.cos(0.05 * time)}
    (found,) = Motion(columns, rate)({}, None).values()
    assert np.abs(found.left).max() < 0.05
