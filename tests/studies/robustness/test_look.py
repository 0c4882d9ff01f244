"""Hostile flights through `stoop look`, which the published campaign did not know: a whole page, or one line."""

from __future__ import annotations

import warnings
from pathlib import Path
from random import Random

import pytest

from stoop.cli.main import main
from stoop_studies.robustness.trials import lay_out
from stoop_studies.robustness.verbs import SHORT, Choices


@pytest.mark.parametrize("seed", range(12))
def test_a_hostile_flight_has_a_page_or_one_line(
    seed: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    files: dict[str, bytes] = {}
    _, path = Choices(Random(f"look {seed}"), files).flight(*SHORT)  # noqa: S311
    lay_out(tmp_path, files)
    monkeypatch.chdir(tmp_path)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        code = main(["look", path])
    said = capsys.readouterr()
    assert code in (0, 2), said.err
    assert (tmp_path / "look.html").exists() == (code == 0)
    assert code == 0 or said.err.count("\n") == 1
