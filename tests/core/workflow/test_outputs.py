"""The output folder: nothing of the user's is lost, neither files that lie there nor results; what was read is named."""

import hashlib
import json
import os
import shutil
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

import stoop
from stoop.errors import OutputError, StoopError
from stoop.flight import Flight
from stoop.results.result import read_result
from stoop.vehicle import Vehicle, load_vehicle
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.load import parse_vehicle
from stoop.workflow import FittedModel, outputs
from stoop.workflow.load import load, model_or_vehicle
from stoop.workflow.outputs import ARCHIVES, check_folder, file_hashes, place_outputs, with_values

NAMES = ("vehicle.toml", "flight.nc", "estimate.npz", "traces.npz", "report.html", "result.json")


pytestmark = pytest.mark.usefixtures("blank_page")


def names(folder: Path) -> list[str]:
    return sorted(p.name for p in folder.iterdir())


def test_all_is_written_and_read_back_and_nothing_replaced_unasked(job: FittedModel, tmp_path: Path) -> None:
    folder = job.save(tmp_path / "out")
    assert names(folder) == sorted(NAMES)
    assert read_result(folder / "result.json").parameters.keys() == job.result.parameters.keys()
    again, estimates = load_vehicle(folder / "vehicle.toml"), job.estimate.estimates
    assert {name: again.value(name) for name in estimates} == pytest.approx(estimates, rel=1e-9)
    assert stoop.load_flight(folder / "flight.nc").time.size == job.flights[0].time.size
    before = (folder / "result.json").read_bytes()
    with pytest.raises(OutputError, match="--overwrite"):
        job.save(folder)
    assert (folder / "result.json").read_bytes() == before
    job.save(folder, overwrite=True)


def test_full_disk_leaves_nothing(job: FittedModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def full(path: Path, content: bytes) -> None:
        path.write_bytes(content[:100])
        if path.name == "5":
            raise OSError(28, "No space left on device")

    monkeypatch.setattr("stoop.base.files._write_through", full)
    with pytest.raises(OutputError, match="No space left"):
        job.save(tmp_path)
    assert names(tmp_path) == []


def test_the_mark_of_a_whole_result_comes_last() -> None:
    first, _, *rest = NAMES
    assert outputs.output_names(["sim"]) == NAMES
    assert outputs.output_names(["a", "b"]) == (first, "flight-a.nc", "flight-b.nc", *rest)
    with pytest.raises(OutputError, match="cannot name a file"):
        outputs.flight_file("a/../../x", 2)


def test_a_folder_is_checked_before_the_work(tmp_path: Path) -> None:
    (file := tmp_path / "file").write_text("")
    for wrong, inputs, match in (
        (file, [], "is a file"), (Path("/proc/nowhere"), [], "cannot be written"),
        (tmp_path, [tmp_path / "."], "is the log that this run reads; name another folder"),
    ):  # fmt: skip
        with pytest.raises(OutputError, match=match):
            check_folder(wrong, ["sim"], inputs=inputs)
    for name in NAMES:
        (folder := tmp_path / f"of {name}").mkdir()
        mine = folder / name
        mine.write_text("mine")
        with pytest.raises(OutputError, match="add --overwrite"):
            check_folder(folder, ["sim"])
        check_folder(folder, ["sim"], overwrite=True)
        (elsewhere := folder / "elsewhere").mkdir()
        os.link(mine, elsewhere / name)
        for place in (folder, elsewhere):
            with pytest.raises(OutputError, match="is read by this run and would be replaced; name another"):
                check_folder(place, ["sim"], overwrite=True, inputs=[mine])
    (folder := tmp_path / "several").mkdir()
    (folder / "flight-b.nc").write_text("mine")
    check_folder(folder, ["b"])
    with pytest.raises(OutputError, match=r"flight-b\.nc: exists already"):
        check_folder(folder, ["a", "b"])


def test_a_job_knows_what_it_has_read(job: FittedModel, tmp_path: Path) -> None:
    (mine := tmp_path / "vehicle.toml").write_text("mine")
    with pytest.raises(OutputError, match="is read by this run"):
        replace(job, files=(mine,)).save(tmp_path, overwrite=True)
    assert mine.read_text() == "mine"


def test_a_result_that_came_meanwhile_stays_and_ours_lies_beside_it(job: FittedModel, tmp_path: Path) -> None:
    """Two runs were started into one new folder; this is the later one. A folder that was removed is made again."""
    check_folder(tmp_path, ["sim"])
    (tmp_path / "result.json").write_text("of the other run")
    with pytest.raises(OutputError, match="another run has written there meanwhile; this one's result is in"):
        place_outputs(job, tmp_path)
    assert (tmp_path / "result.json").read_text() == "of the other run"
    (aside,) = (p for p in tmp_path.iterdir() if p.is_dir())
    assert names(aside) == sorted(NAMES)
    assert not aside.name.startswith(".")
    shutil.rmtree(aside)
    place_outputs(job, aside)
    assert names(aside) == sorted(NAMES)


def test_an_old_mark_goes_first(job: FittedModel, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    job.save(tmp_path)
    move, moved = Path.replace, []

    def stopped(self: Path, target: Path) -> Path:
        moved.append(target.name)
        if target.name == "report.html":
            raise KeyboardInterrupt
        return move(self, target)

    monkeypatch.setattr(Path, "replace", stopped)
    with pytest.raises(KeyboardInterrupt):
        job.save(tmp_path, overwrite=True)
    assert not (tmp_path / "result.json").exists()
    assert "result.json" not in moved, "it is written last"


def test_flights_of_an_earlier_run_go(job: FittedModel, tmp_path: Path) -> None:
    (flight,) = job.flights
    older = replace(job, flights=(flight, replace(flight, name="unused", data=flight.data)))
    folder = older.save(tmp_path / "result")
    assert [one.name for one in load(folder).flights] == [flight.name, "unused"]
    (mine := folder / "flight-mine.nc").write_text("mine")
    replace(job, files=(mine,)).save(folder, overwrite=True)
    assert mine.read_text() == "mine", "an input"
    assert names(folder) == sorted([*NAMES, mine.name])
    assert [one.name for one in load(folder).flights] == [flight.name]
    older.save(folder, overwrite=True)
    assert not (folder / "flight.nc").exists()


@settings(max_examples=30, deadline=None)
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


def test_a_written_estimate_stays_within_its_bounds() -> None:
    lower = -49.99999999996
    vehicle = builtin_vehicle("twin-boom")
    text = vehicle.text.replace("Cmq = -47.6", f"Cmq = {{ value = -40.0, bounds = [{lower}, 0.0] }}")
    written = parse_vehicle(with_values(parse_vehicle(text, "v"), {"Cmq": lower}), "again")
    assert written.value("Cmq") == lower


def test_every_file_that_was_read(tmp_path: Path, aircraft: Vehicle, flight: Flight) -> None:
    def digest(content: bytes) -> str:
        return hashlib.sha256(content).hexdigest()

    files = ("log.csv", "log.csv.toml", "noise.csv")
    for name in files:
        (tmp_path / name).write_text(name)
    read = replace(flight, path=tmp_path / "log.csv")
    hashes = outputs.input_hashes(aircraft, {"log": read}, [tmp_path / "noise.csv"])
    own = {aircraft.where: digest(aircraft.text.encode())}
    assert hashes == own | {name: digest(name.encode()) for name in files}
    paths = [tmp_path / folder / "m.toml" for folder in ("a", "b")]  # of one name
    for path in paths:
        path.parent.mkdir()
        path.write_text(path.parent.name)
    assert file_hashes(paths) == {"m.toml": digest(b"a"), str(paths[1]): digest(b"b")}


def test_a_folder_is_what_is_read_of_it(tmp_path: Path, flight: Flight) -> None:
    (tmp_path / "topic.csv").write_text("1")
    before = file_hashes(outputs.flight_files([replace(flight, path=tmp_path)]))
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "search.npz").write_text("a result among the tables")
    (tmp_path / "search.npz").write_text("another")
    assert file_hashes([tmp_path]) == before
    for name in ("topic.csv", "other.csv.gz", "mapping.toml"):
        (tmp_path / name).write_text("2")
        assert file_hashes([tmp_path]) != before, name
        before = file_hashes([tmp_path])


#: place in result.json -> what is written there, what the complaint says
EDITS: list[tuple[tuple[str | int, ...], Any, str]] = [
    (("noise_covariance", "matrix", 0, 0), -1.0, "noise covariance that is not positive definite"),
    (("parameters", "CLalpha", "estimate"), 1e200, "numbers out of range"),
    *((("parameters", "CLalpha", "std_error"), x, "std_error of CLalpha is not that of the covariance") for x in (1e-300, 1e9)),
    (("covariance", "matrix", 0, 1), None, "not symmetric, has holes or negative variances"),
    (("parameters", "CLalpha", "estimate"), None, "has no estimate of CLalpha"),
    (("covariance", "names", 0), "Nonsense", "covariance of other parameters"),
    (("covariance", "names"), ["CLalpha"], "rows for"),
    (("noise_covariance", "matrix"), [[1.0]], "has a covariance of 1 rows"),
    (("components", "variances", "noise", "CLalpha"), 7.0, "components of CLalpha do not add up to its variance"),
    (("components", "variances", "noise", "CLalpha"), None, "components of CLalpha do not add up to its variance"),
    (("components", "variances", "noise"), {}, "do not add up to its variance"),
    (("components", "variances", "<b>weather"), {}, "no component is named '<b>weather'"),
    (("maneuvers",), [], "no maneuver that was fitted"),
    (("biases",), [{"maneuver": 9, "values": {}}], "maneuver that it does not name"),
    *(
        (("process_noise",), {"gain": "steady", "states": ["u"], "intensities": values, "share": share},
         "process noise without positive intensities")
        for values, share in (([], 0.0), ([-1.0], 0.0), ([None], 0.0), ([1.0], 2.0))
    ),
]  # fmt: skip


def test_an_edited_result_is_one_line(folder: Path, tmp_path: Path) -> None:
    copy = Path(shutil.copytree(folder, tmp_path / "r"))
    for (*place, last), value, says in EDITS:
        result: Any = json.loads((folder / "result.json").read_text())
        inner = result
        for key in place:
            inner = inner[key]
        inner[last] = value
        (copy / "result.json").write_text(json.dumps(result))
        for read in (load, model_or_vehicle):
            with pytest.raises(StoopError, match=says) as caught:
                read(copy)
            assert "\n" not in str(caught.value)


def test_damaged_and_missing_files_are_one_line(job: FittedModel, folder: Path, tmp_path: Path) -> None:
    with np.load(folder / "traces.npz") as file:
        curves = dict(file)
    for name, damage in (("flat", {"0.time": curves["0.time"][:, None]}),
                         ("single", {k: x.astype(np.int8) for k, x in curves.items() if k.startswith("0.input")})):  # fmt: skip
        np.savez(tmp_path / f"{name}.npz", **curves | damage)
    flat, single = ((tmp_path / f"{name}.npz").read_bytes() for name in ("flat", "single"))
    text, copy = (folder / "result.json").read_text(), tmp_path / "r"
    for name, content, says in (
        *((name, content, name) for name in ARCHIVES for content in (b"", b"PK\x03\x04 damaged")),
        ("traces.npz", flat, "is no curve"), ("traces.npz", single, "is no curve"),
        ("result.json", None, "holds no result.json"), ("vehicle.toml", None, "holds no vehicle.toml"),
        ("result.json", text.replace('"CLalpha"', '"CLnonsense"').encode(), "no number is called 'CLnonsense'"),
    ):  # fmt: skip
        shutil.copytree(folder, copy, dirs_exist_ok=True)
        if content is None:
            (copy / name).unlink()
        else:
            (copy / name).write_bytes(content)
        with pytest.raises(StoopError, match=says) as said:
            _ = load(copy).estimate
        assert "\n" not in str(said.value)
    parameters = {n: replace(p, estimate=1.01 * p.estimate) for n, p in job.parameters.items()}
    mixed = replace(load(folder), result=replace(job.result, parameters=parameters))
    with pytest.raises(StoopError, match=r"holds another fit than result\.json beside it"):
        _ = mixed.estimate
