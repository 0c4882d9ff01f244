"""Texts and paths of odd forms through the commands that read or write them."""

from __future__ import annotations

from pathlib import Path

import pytest
from crossed import crossed
from studies.robustness import limited
from studies.robustness.campaign import check
from studies.robustness.limited import MEMORY, Run
from studies.robustness.odd_texts import FORMS, PATHS, READ_BY, WAYS, sound_text
from studies.robustness.small_runs import inputs
from studies.robustness.trials import READ, lay_out

UTF_16 = ("UTF-16", "UTF-16 of the other order", "UTF-32")


def tried(words: tuple[str, ...], folder: Path, files: dict[str, bytes]) -> Run:
    folder.mkdir()
    before = {**inputs(), **files}
    lay_out(folder, before)
    run = limited.run(words, folder)
    assert run.memory < MEMORY
    assert all((folder / name).read_bytes() == content for name, content in before.items()), "lost"
    return run


@pytest.mark.parametrize(("name", "form"), crossed(READ_BY, FORMS))
def test_an_odd_text_is_read_or_refused_in_one_line(name: str, form: str, tmp_path: Path) -> None:
    run = tried(READ_BY[name], tmp_path / "here", {name: FORMS[form](name, sound_text(name))})
    check("odd texts", name, run.ended)
    if not name.startswith("a."):  # which is no log in any form
        assert run.ended.outcome == READ or form not in ("the text itself", "UTF-8 with a mark")
        assert "UTF-8" in run.ended.message or form not in UTF_16


@pytest.mark.parametrize(("way", "kind"), crossed(WAYS, PATHS))
def test_an_odd_path_is_taken_or_refused_in_one_line(way: str, kind: str, tmp_path: Path) -> None:
    words = tuple(PATHS[kind] if word == "PATH" else word for word in WAYS[way])
    check("odd paths", way, tried(words, tmp_path / "here", {}).ended)
