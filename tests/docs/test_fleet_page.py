"""The example of the page of fleets: its code makes the tables, its command prints what stands there."""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

import pytest

from docs.pages import DOCS
from stoop.cli.main import main

TEXT = (DOCS / "fleet.md").read_text("utf-8")
NUMBER = re.compile(r"[-+]?\d+\.\d+")


def blocks(language: str) -> list[str]:
    return re.findall(rf"^```{language}\n(.*?)^```", TEXT, re.MULTILINE | re.DOTALL)


def test_the_example(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    example, in_python = blocks("python")
    subprocess.run([sys.executable, "-c", example], check=True)
    install, command = blocks("text")[0].splitlines()
    assert install == "pip install '.[parquet]'"
    assert main(command.split()[1:]) == 3
    printed, shown = capsys.readouterr().out, blocks("text")[1]
    assert NUMBER.sub("#", printed) == NUMBER.sub("#", shown)
    assert [float(x) for x in NUMBER.findall(printed)] == pytest.approx(
        [float(x) for x in NUMBER.findall(shown)], rel=0.02
    )
    told = subprocess.run(
        [sys.executable, "-c", in_python], check=True, capture_output=True, text=True
    ).stdout
    assert told.startswith("drone-3 thrust -0.04")
