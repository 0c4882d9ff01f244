"""A reader in a child: what it may take is limited, and how it ends is one line."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from stoop.errors import LogError
from stoop.logs.guard import Limits, read_guarded, read_in_child, read_result

READER = "matlab"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    savemat(tmp_path / "a.mat", {"t": np.arange(10.0), "p": np.ones(10)})
    return tmp_path / "a.mat"


def test_too_little_memory(log: Path) -> None:
    with pytest.raises(LogError, match="memory") as caught:
        read_in_child(READER, log, limits=Limits(memory=2**26))
    assert "\n" not in str(caught.value)


def test_a_crash(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = subprocess.CompletedProcess([], -11)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: ended)
    with pytest.raises(LogError, match=r"the reading process died \(signal 11\): .* needs more than 4 GiB"):
        read_in_child(READER, log)


def test_too_long_a_wait(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mat")
    with pytest.raises(LogError, match="took more than 2 s and was stopped"):
        read_in_child(READER, tmp_path / "pipe.mat", limits=Limits(wall=2))


def test_errors_come_back_with_the_name_that_was_given(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log.write_bytes(log.read_bytes()[:200])
    monkeypatch.chdir(log.parent)
    with pytest.raises(LogError, match=r"^a\.mat: "):
        read_in_child(READER, Path("a.mat"))


def test_only_readers_are_called(log: Path) -> None:
    with pytest.raises(LogError, match="os:remove is no format"):
        read_in_child("os:remove", log)
    assert log.exists()


def test_a_package_that_is_missing(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda _: None)
    assert read_guarded("matlab", log).streams  # of version 5: SciPy reads it
    with pytest.raises(
        LogError, match=r"needs the package rosbags; install it with pip install 'stoop\[ros\]'$"
    ):
        read_guarded("rosbag", log)


@pytest.mark.parametrize("time", [[0.0, 1.0], [1.0, 0.0, 2.0]])
def test_nonsense_is_not_believed(tmp_path: Path, time: list[float]) -> None:
    result = {"error": "", "format": "mat", "streams": [["data", ["p"]]], "defects": []}
    result |= {key: {} for key in ("attributes", "parameters", "info", "units", "unread")}
    (tmp_path / "result.json").write_text(json.dumps(result))
    np.save(tmp_path / "0.npy", np.array([time] if len(time) == 2 else [time, time]))
    with pytest.raises(LogError, match="returned an invalid result"):
        read_result(Path("a.mat"), tmp_path)


def test_pickled_arrays_are_refused(tmp_path: Path) -> None:
    result = {"error": "", "format": "mat", "streams": [["data", ["p"]]], "defects": []}
    (tmp_path / "result.json").write_text(json.dumps(result))
    np.save(tmp_path / "0.npy", np.array([{}, {}], dtype=object))
    with pytest.raises(LogError, match="returned an invalid result"):
        read_result(Path("a.mat"), tmp_path)
