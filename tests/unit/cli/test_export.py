"""`stoop export`: what it writes, and what it says where a package is missing; each target has tests of its own."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest


def test_without_the_package_the_files_are_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: Callable[..., str]
) -> None:
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    said = done(f"export twin-boom --to jsbsim -o {tmp_path}")
    assert "pip install '.[jsbsim]'" in said
    channels = ", ".join(f"stoop/channel/{name} (rad)" for name in ("elevator", "aileron", "rudder"))
    assert f"To be set in flight: {channels}, stoop/thrust-N (N)." in said
    written = [p for p in tmp_path.rglob("*") if p.is_file()]
    assert said.count("wrote ") == len(written) > 0
    assert all(str(path) in said for path in written)
    assert list(tmp_path.glob("aircraft/*/*.xml"))
    assert not (tmp_path / "export.html").exists()
