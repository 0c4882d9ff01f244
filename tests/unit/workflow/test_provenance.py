"""From what a result was made: every file that was read."""

from __future__ import annotations

import hashlib
from dataclasses import replace
from pathlib import Path

import pytest

from stoop.flight import Flight
from stoop.vehicle import Vehicle
from stoop.workflow.outputs import file_hashes, flight_files, input_hashes


def digest(content: bytes) -> str:
    return hashlib.sha256(content).hexdigest()


def test_every_file_that_was_read(tmp_path: Path, aircraft: Vehicle, flight: Flight) -> None:
    for name in ("log.csv", "log.csv.toml", "noise.csv"):
        (tmp_path / name).write_text(name)
    read = replace(flight, path=tmp_path / "log.csv")
    hashes = input_hashes(aircraft, {"log": read}, [tmp_path / "noise.csv"])
    assert hashes == {
        aircraft.where: digest(aircraft.text.encode()),
        **{name: digest(name.encode()) for name in ("log.csv", "log.csv.toml", "noise.csv")},
    }


def test_two_files_of_one_name_are_both_told(tmp_path: Path) -> None:
    for folder in ("a", "b"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "m.toml").write_text(folder)
    paths = [tmp_path / folder / "m.toml" for folder in ("a", "b")]
    assert file_hashes(paths) == {"m.toml": digest(b"a"), str(paths[1]): digest(b"b")}


@pytest.mark.parametrize("name", ["topic.csv", "other.csv.gz", "mapping.toml"])
def test_a_folder_is_what_is_read_of_it(name: str, tmp_path: Path, flight: Flight) -> None:
    (tmp_path / "topic.csv").write_text("1")
    before = file_hashes(flight_files([replace(flight, path=tmp_path)]))
    (tmp_path / "result").mkdir()
    (tmp_path / "result" / "search.npz").write_text("a result among the tables")
    (tmp_path / "search.npz").write_text("another")
    assert file_hashes([tmp_path]) == before
    (tmp_path / name).write_text("2")
    assert file_hashes([tmp_path]) != before
