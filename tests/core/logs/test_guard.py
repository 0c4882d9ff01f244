"""A reader in a child: what it may take is limited, and how it ends is one line."""

import importlib.util
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from stoop.errors import LogError
from stoop.logs import guard
from stoop.logs.formats import FORMATS
from stoop.logs.guard import Limits, read_guarded, read_in_child, read_result

READER = "matlab"
#: a matrix of doubles whose list of dimensions is empty: SciPy 1.17 reads beyond it and the process dies
DEADLY = b"MATLAB 5.0 MAT-file".ljust(124) + bytes.fromhex(
    f"0001494d0e00000038{'00' * 11}0600000000000000050000000000000001000000010000000000000000000000{'00' * 8}"
)
MAPPING = '[variables]\np = { column = "p", unit = "rad/s" }\n'
CALLS = """
import sys
from pathlib import Path
import stoop, stoop.logs
from stoop_draft.mapping_draft import draft
path = Path("a.mat")
calls = (
    stoop.logs.read, draft, stoop.load_flight, stoop.check, stoop.reconstruct, stoop.new_vehicle,
    lambda log: stoop.fit("twin-boom", log, ["0:5"]), stoop.look,
)
for call in calls:
    try:
        call(path)
    except stoop.errors.StoopError as error:
        print(error)
"""


@pytest.fixture
def log(tmp_path: Path) -> Path:
    savemat(tmp_path / "a.mat", {"t": np.arange(10.0), "p": np.ones(10)})
    return tmp_path / "a.mat"


def test_how_a_child_ends_is_one_line(log: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    os.mkfifo(tmp_path / "pipe.mat")
    with pytest.raises(LogError, match="took more than 1 s and was stopped"):
        read_in_child(READER, tmp_path / "pipe.mat", limits=Limits(wall=1))
    ended = subprocess.CompletedProcess([], -11)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: ended)
    with pytest.raises(LogError, match=r"the reading process died \(signal 11\): .* needs more than 4 GiB"):
        read_in_child(READER, log)


def test_errors_come_back_with_the_name_that_was_given(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(LogError, match="os:remove is no format"):  # only readers are called
        read_in_child("os:remove", log)
    with monkeypatch.context() as patch:
        patch.setattr(importlib.util, "find_spec", lambda _: None)
        assert read_guarded("matlab", log).streams  # of version 5: SciPy reads it
        with pytest.raises(LogError, match=r"needs the package rosbags; pip install '\.\[ros\]' in a clone"):
            read_guarded("rosbag", log)
    log.write_bytes(log.read_bytes()[:200])
    monkeypatch.chdir(log.parent)
    with pytest.raises(LogError, match=r"^a\.mat: "):
        read_in_child(READER, Path("a.mat"))


def test_pickled_arrays_are_refused(tmp_path: Path) -> None:
    """So is any other nonsense that a child may hand back."""
    result = {"error": "", "format": "mat", "streams": [["data", ["p"]]], "defects": []}
    result |= {key: {} for key in ("attributes", "parameters", "info", "units", "unread")}
    (tmp_path / "result.json").write_text(json.dumps(result))
    for array in (np.array([{}, {}], dtype=object), np.array([[0.0, 1.0]]), np.array([[1.0, 0.0, 2.0]] * 2)):
        np.save(tmp_path / "0.npy", array)
        with pytest.raises(LogError, match="returned an invalid result"):
            read_result(Path("a.mat"), tmp_path)
    np.save(tmp_path / "0.npy", np.array([[0.0, 1.0, 2.0]] * 2))
    assert read_result(Path("a.mat"), tmp_path).streams["data"].time.tolist() == [0.0, 1.0, 2.0]


def test_a_file_that_ends_the_process_does_not_end_that_of_the_api(tmp_path: Path) -> None:
    (tmp_path / "a.mat").write_bytes(DEADLY)
    (tmp_path / "a.mat.toml").write_text(MAPPING)
    plain = "import io, scipy.io; scipy.io.loadmat('a.mat')"
    if subprocess.run([sys.executable, "-c", plain], cwd=tmp_path, check=False).returncode >= 0:
        pytest.skip("this SciPy reads it")
    calls = [sys.executable, "-c", CALLS]
    done = subprocess.run(calls, cwd=tmp_path, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    lines = done.stdout.splitlines()
    assert len(lines) == 8
    assert all("a.mat: the reading process died (signal" in line for line in lines)


def test_readers_that_end_in_a_library_are_called_by_the_child_only() -> None:
    """They are named in the table of formats, and by nothing else in the package."""
    modules, functions = zip(*(f.reader.split(":") for f in FORMATS.values() if f.name), strict=True)
    assert {*modules} == {"matlab", "parquet", "netcdf", "rosbag"}
    used = re.compile(
        rf"(?<!def )(?<!:)\b({'|'.join(functions)})\b(?!\")"
    )  # neither defined nor in the table
    for path in Path(guard.__file__).parents[2].glob("stoop*/**/*.py"):
        assert not used.search(path.read_text()), path
