"""`stoop vehicle`: the packaged files as they stand, comments included, and never over another."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import stoop.data
from stoop.cli.main import main
from stoop.vehicle.builtin import BUILT_IN

DATA = Path(next(iter(stoop.data.__path__)))


def test_listed_printed_and_written_as_they_stand(tmp_path: Path, done: Callable[..., str]) -> None:
    _, *lines, own, example = done("vehicle").splitlines()
    assert "stoop vehicle new LOG" in own
    assert [line.split()[0] for line in lines] == list(BUILT_IN)
    assert all(len(line.split()) > 2 for line in lines)
    assert "stoop vehicle quad-x -o my.toml" in example
    for name, file in BUILT_IN.items():
        target = tmp_path / f"{name}.toml"
        assert f"stoop trim {target}" in done(f"vehicle {name} -o {target}")
        assert target.read_bytes() == (DATA / file).read_bytes()
        assert done(["vehicle", name]).encode() == target.read_bytes()
        assert target.read_text(encoding="utf-8").startswith("# ")
    target.write_text("mine", encoding="utf-8")
    assert main(["vehicle", "quad-x", "-o", str(target)]) == 2
    assert target.read_text(encoding="utf-8") == "mine"
    done(f"vehicle quad-x -o {target} --overwrite")
    assert target.read_bytes() == (DATA / "quad_x.toml").read_bytes()
    assert len([*tmp_path.iterdir()]) == len(BUILT_IN)
