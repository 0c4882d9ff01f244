"""`stoop export`: what it writes, and what it says where a package is missing."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from stoop.exporters.targets import TARGETS

QUADROTORS = {"rotorpy", "pyflyt", "gym-pybullet-drones", "crazyflow", "isaac"}
CHANNELS = "stoop/channel/elevator (rad), stoop/channel/aileron (rad), stoop/channel/rudder (rad)"


@pytest.mark.parametrize("target", sorted(set(TARGETS) - QUADROTORS))
def test_each_target(target: str, tmp_path: Path, done: Callable[..., str]) -> None:
    said = done(f"export twin-boom --to {target} -o {tmp_path}")
    written = [p for p in tmp_path.rglob("*") if p.is_file()]
    assert said.count("wrote ") == len(written) > 0
    assert all(str(path) in said for path in written)
    assert ("JSBSim within" in said) == ("jsbsim" in target)
    assert (f"To be set in flight: {CHANNELS}, stoop/thrust-N (N)." in said) == (target == "jsbsim")


def test_without_the_package_the_files_are_written_all_the_same(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, done: Callable[..., str]
) -> None:
    monkeypatch.setitem(sys.modules, "jsbsim", None)
    assert "pip install '.[jsbsim]'" in done(f"export twin-boom --to jsbsim -o {tmp_path}")
    assert list(tmp_path.glob("aircraft/*/*.xml"))
    assert not (tmp_path / "export.html").exists()
