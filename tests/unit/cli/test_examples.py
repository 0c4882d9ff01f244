"""Every command in examples/README.md runs as it stands."""

from __future__ import annotations

import re
import shlex
import shutil
from pathlib import Path

import pytest

from stoop.cli.main import main


def test_commands_of_the_readme(examples: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (examples / "README.md").read_text()
    commands = [shlex.split(line) for line in re.findall(r"^\$ stoop (.*)$", text, re.MULTILINE)]
    assert {words[0] for words in commands} >= {"trim", "linearize", "simulate", "info"}
    shutil.copytree(examples, tmp_path, dirs_exist_ok=True)
    monkeypatch.chdir(tmp_path)
    for words in commands:
        assert main(words) == 0, words
