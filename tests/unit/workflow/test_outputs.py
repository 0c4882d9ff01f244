"""The output folder: nothing of the user's is lost, neither files that lie there nor results."""

from __future__ import annotations

import os
import shutil
import struct
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from stoop.errors import OutputError
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop.workflow import FittedModel
from stoop.workflow.load import load
from stoop.workflow.outputs import check_folder, flight_file, output_names, place_outputs, with_values

NAMES = ("vehicle.toml", "flight.nc", "estimate.npz", "traces.npz", "report.html", "result.json")


def test_an_existing_result_is_not_overwritten(job: FittedModel, tmp_path: Path) -> None:
    job.save(tmp_path)
    before = (tmp_path / "result.json").read_bytes()
    with pytest.raises(OutputError, match="--overwrite"):
        job.save(tmp_path)
    assert (tmp_path / "result.json").read_bytes() == before
    job.save(tmp_path, overwrite=True)


def test_a_disk_that_is_full_at_the_last_file_leaves_nothing_behind(
    job: FittedModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(path: Path, content: bytes) -> None:
        path.write_bytes(content[:100])
        if path.name == "5":
            raise OSError(28, "No space left on device")

    monkeypatch.setattr("stoop.base.files._write_through", full)
    with pytest.raises(OutputError, match="No space left"):
        job.save(tmp_path)
    assert list(tmp_path.iterdir()) == []


def test_folder_is_checked_before_the_work(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(OutputError, match="is a file"):
        check_folder(tmp_path / "file", ["sim"])
    with pytest.raises(OutputError, match="cannot be written"):
        check_folder(Path("/proc/nowhere"), ["sim"])


def test_the_mark_of_a_whole_result_comes_last() -> None:
    assert output_names(["sim"]) == NAMES
    assert output_names(["a", "b"]) == (
        "vehicle.toml",
        "flight-a.nc",
        "flight-b.nc",
        "estimate.npz",
        "traces.npz",
        "report.html",
        "result.json",
    )


@pytest.mark.parametrize("name", NAMES)
def test_any_file_that_would_be_replaced_is_refused(name: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text("mine")
    with pytest.raises(OutputError, match="add --overwrite"):
        check_folder(tmp_path, ["sim"])
    check_folder(tmp_path, ["sim"], overwrite=True)


def test_a_flight_of_several_is_refused_by_its_name(tmp_path: Path) -> None:
    (tmp_path / "flight-b.nc").write_text("mine")
    check_folder(tmp_path, ["b"])
    with pytest.raises(OutputError, match=r"flight-b\.nc: exists already"):
        check_folder(tmp_path, ["a", "b"])


@pytest.mark.parametrize("name", ["vehicle.toml", "flight.nc"])
def test_an_input_is_never_replaced(name: str, tmp_path: Path) -> None:
    mine = tmp_path / name
    mine.write_text("mine")
    with pytest.raises(OutputError, match=r"is read by this run and would be replaced; name another folder"):
        check_folder(tmp_path, ["sim"], overwrite=True, inputs=[mine])
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    os.link(mine, elsewhere / name)
    with pytest.raises(OutputError, match="is read by this run"):
        check_folder(elsewhere, ["sim"], overwrite=True, inputs=[mine])


def test_results_do_not_lie_among_the_tables_of_a_log(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="is the log that this run reads; name another folder"):
        check_folder(tmp_path, ["flight"], inputs=[tmp_path / "."])


def test_a_job_knows_what_it_has_read(job: FittedModel, tmp_path: Path) -> None:
    mine = tmp_path / "vehicle.toml"
    mine.write_text("mine")
    with pytest.raises(OutputError, match="is read by this run"):
        replace(job, files=(mine,)).save(tmp_path, overwrite=True)
    assert mine.read_text() == "mine"


def test_a_result_that_came_meanwhile_stays_and_ours_lies_beside_it(job: FittedModel, tmp_path: Path) -> None:
    """Two runs were started into one new folder; this is the later one."""
    check_folder(tmp_path, ["sim"])
    (tmp_path / "result.json").write_text("of the other run")
    with pytest.raises(OutputError, match="another run has written there meanwhile; this one's result is in"):
        place_outputs(job, tmp_path)
    assert (tmp_path / "result.json").read_text() == "of the other run"
    (aside,) = (p for p in tmp_path.iterdir() if p.is_dir())
    assert sorted(p.name for p in aside.iterdir()) == sorted(NAMES)
    assert not aside.name.startswith(".")


def test_a_folder_that_was_removed_meanwhile_is_made_again(job: FittedModel, tmp_path: Path) -> None:
    folder = tmp_path / "out"
    check_folder(folder, ["sim"])
    shutil.rmtree(folder)
    place_outputs(job, folder)
    assert sorted(p.name for p in folder.iterdir()) == sorted(NAMES)


def test_an_old_mark_does_not_stand_beside_new_files(
    job: FittedModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    job.save(tmp_path)
    move = Path.replace

    def stopped(self: Path, target: Path) -> Path:
        if target.name == "report.html":
            raise KeyboardInterrupt
        return move(self, target)

    monkeypatch.setattr(Path, "replace", stopped)
    with pytest.raises(KeyboardInterrupt):
        job.save(tmp_path, overwrite=True)
    assert not (tmp_path / "result.json").exists()


def test_flights_of_an_earlier_run_do_not_stand_beside_those_of_this_one(
    job: FittedModel, tmp_path: Path
) -> None:
    (flight,) = job.flights
    unused = replace(flight, name="unused", data=flight.data)
    older = replace(job, flights=(flight, unused))
    folder = older.save(tmp_path / "result")
    assert [one.name for one in load(folder).flights] == [flight.name, "unused"]
    job.save(folder, overwrite=True)
    assert sorted(p.name for p in folder.iterdir()) == sorted(NAMES)
    assert [one.name for one in load(folder).flights] == [flight.name]
    older.save(folder, overwrite=True)
    assert not (folder / "flight.nc").exists()


def test_an_input_of_the_name_of_a_flight_stays(job: FittedModel, tmp_path: Path) -> None:
    folder = job.save(tmp_path / "result")
    mine = folder / "flight-mine.nc"
    mine.write_text("mine")
    replace(job, files=(mine,)).save(folder, overwrite=True)
    assert mine.read_text() == "mine"


def test_the_name_of_a_flight_leads_to_no_other_folder() -> None:
    with pytest.raises(OutputError, match="cannot name a file"):
        flight_file("a/../../x", 2)


@settings(max_examples=60, deadline=None)
@given(st.floats(-1e30, 1e30), st.floats(-1e30, 1e30))
@example(1.0 / 3.0, 5e-324)
@example(1e30, -0.0)
@example(1.0000000000000002e9, -123456789012.34567)
def test_a_number_that_was_set_comes_back_with_the_same_bits(x: float, y: float) -> None:
    """Also beyond 1e9 and with seventeen digits; below 1e-30, where inverses leave the range, it is zero."""
    vehicle = builtin_vehicle("twin-boom").with_numbers({"Cmq": {"value": x}, "Cnbeta": {"value": y}})
    again = parse_vehicle(with_values(vehicle, {}), "again")
    for name, value in (("Cmq", x), ("Cnbeta", y)):
        kept = value if abs(value) >= 1e-30 else 0.0
        assert struct.pack("d", again.value(name)) == struct.pack("d", kept)
