"""A reader in a child: what it may take is limited, and how it ends is one line."""

from __future__ import annotations

import json
import os
import subprocess
from pathlib import Path

import numpy as np
import pytest
from scipy.io import savemat

from stoop.errors import LogError
from stoop.logs.guard import Limits, _taken, guarded, need

READER = "stoop.logs.matlab:load"


@pytest.fixture
def log(tmp_path: Path) -> Path:
    savemat(tmp_path / "a.mat", {"t": np.arange(10.0), "p": np.ones(10)})
    return tmp_path / "a.mat"


def test_too_little_memory(log: Path) -> None:
    with pytest.raises(LogError, match="memory") as caught:
        guarded(READER, log, limits=Limits(memory=2**26))
    assert "\n" not in str(caught.value)


def test_a_crash(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    ended = subprocess.CompletedProcess([], -11)
    monkeypatch.setattr(subprocess, "run", lambda *_, **__: ended)
    with pytest.raises(LogError, match=r"its reader died \(signal 11\): damaged, or too large for 4 GiB"):
        guarded(READER, log)


def test_too_long_a_wait(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe.mat")
    with pytest.raises(LogError, match="took more than 2 s and was ended"):
        guarded(READER, tmp_path / "pipe.mat", limits=Limits(wall=2))


def test_errors_come_back_with_the_name_that_was_given(log: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    log.write_bytes(log.read_bytes()[:200])
    monkeypatch.chdir(log.parent)
    with pytest.raises(LogError, match=r"^a\.mat: "):
        guarded(READER, Path("a.mat"))


def test_only_readers_are_called(log: Path) -> None:
    with pytest.raises(LogError, match="os:remove is no reader"):
        guarded("os:remove", log)
    assert log.exists()


def test_a_package_that_is_missing() -> None:
    with pytest.raises(
        LogError,
        match=r"^a: bags need the package nowhere_to_be_found; install it with pip install 'stoop\[x\]'$",
    ):
        need(Path("a"), "nowhere_to_be_found", "x", "bags")


@pytest.mark.parametrize("time", [[0.0, 1.0], [1.0, 0.0, 2.0]])
def test_nonsense_is_not_believed(tmp_path: Path, time: list[float]) -> None:
    told = {"error": "", "format": "mat", "streams": [["data", ["p"]]], "defects": []}
    told |= {key: {} for key in ("attributes", "parameters", "info", "units", "unread")}
    (tmp_path / "result.json").write_text(json.dumps(told))
    np.save(tmp_path / "0.npy", np.array([time] if len(time) == 2 else [time, time]))
    with pytest.raises(LogError, match="its reader left nonsense"):
        _taken(Path("a.mat"), tmp_path)


def test_pickled_arrays_are_refused(tmp_path: Path) -> None:
    told = {"error": "", "format": "mat", "streams": [["data", ["p"]]], "defects": []}
    (tmp_path / "result.json").write_text(json.dumps(told))
    np.save(tmp_path / "0.npy", np.array([{}, {}], dtype=object))
    with pytest.raises(LogError, match="its reader left nonsense"):
        _taken(Path("a.mat"), tmp_path)
