"""The one door: formats told by name, heavy libraries left alone until they are needed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from stoop.errors import LogError
from stoop.logs import read


def test_import_is_light() -> None:
    heavy = {"pandas", "xarray", "pyulog", "scipy", "numba", "sympy"}
    code = f"import sys, stoop.logs; print(*({heavy} & set(sys.modules)))"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.strip() == ""


@pytest.mark.parametrize("name", ["a.bin", "a.bag", "a", "a.txt"])
def test_unknown_format(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"x")
    with pytest.raises(LogError, match=rf"{name}: unknown format; stoop reads"):
        read(tmp_path / name)


@pytest.mark.parametrize("name", ["a.ulg", "a.csv", "a.nc", "a"])
def test_missing_file(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogError, match="no such file"):
        read(tmp_path / name)


@pytest.mark.parametrize("name", ["x" * 5000 + ".ulg", "a\0b.ulg"])
def test_impossible_names(tmp_path: Path, name: str) -> None:
    with pytest.raises(LogError, match=r"cannot be read|no such file"):
        read(tmp_path / name)


@pytest.mark.parametrize("name", ["a.ulg", "a.nc"])
def test_a_mapping_for_other_logs_does_no_harm(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"something else entirely")
    with pytest.raises(LogError, match=r"not a (ULog|netCDF-3) file"):
        read(tmp_path / name, tmp_path / "m.toml")


@pytest.mark.parametrize("name", ["a.ulg", "a.nc"])
def test_empty_file(tmp_path: Path, name: str) -> None:
    (tmp_path / name).touch()
    with pytest.raises(LogError, match="empty"):
        read(tmp_path / name)


@pytest.mark.parametrize("name", ["a.ulg", "a.nc"])
def test_wrong_content(tmp_path: Path, name: str) -> None:
    (tmp_path / name).write_bytes(b"something else entirely")
    with pytest.raises(LogError, match="not a"):
        read(tmp_path / name)
