"""The cases that failed in campaigns, once more: what was mended stays so.

`found.csv` names them by surface, seed and number of the campaign that found them, with the words of the command, or the names
of log and mapping and what was asked; ``found`` holds the very files.
"""

from __future__ import annotations

import csv
import json
import zipfile
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from docs.pages import DOCS
from studies.robustness import commands, differential, documents, readers, round_trips
from studies.robustness.trials import BAD, Child, lay_out

from stoop.flight import load

HERE = Path(__file__).parent
COLD = replace(commands.BOUNDS, seconds=60)  #: equations may have to be compiled


def rows(table: Path) -> dict[tuple[str, ...], str]:
    with table.open(newline="", encoding="utf-8") as file:
        found = [row for row in csv.DictReader(file) if row.get("outcome", "fault") in BAD]
    return {(row["surface"], row["seed"], row["number"]): row.get("words", "") for row in found}


FOUND = rows(HERE / "found.csv")


def files_of(surface: str, seed: str, number: str) -> dict[str, bytes]:
    words = surface.removeprefix("stoop ").replace(" .", " ").split()
    with zipfile.ZipFile(HERE / "found" / f"{'-'.join([*words, seed, number])}.zip") as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def once_more(folder: Path, surface: str, words: list[str], files: dict[str, bytes]) -> str:
    """Try a case in a child."""
    form, _, kind = surface.rpartition(" ")
    if surface.startswith("stoop "):
        return commands.try_command(
            folder, words, files, commands.VERBS[surface.removeprefix("stoop ")].written
        )
    lay_out(folder, files)
    if surface == "result":
        documents.ask_result(folder / words[0], 0)
        return ""
    if kind == "back":
        flight = load(folder / words[0])
        return round_trips.there_and_back(folder, surface.split()[1], flight)
    log, mapping = folder / words[0], folder / words[1] if words[1] else None
    if kind == "twice":
        return differential.compare(form, log, mapping)
    with readers.in_this_process():
        readers.ask(log, mapping, words[2])
    return ""


@pytest.mark.parametrize("case", FOUND, ids=" ".join)
def test_what_failed_ends_well(case: tuple[str, str, str]) -> None:
    readers.prepare()
    child = Child(partial(once_more), COLD if case[0].startswith("stoop ") else None)
    ended = child(case[0], json.loads(FOUND[case]), files_of(*case))
    child.close()
    assert ended.outcome not in BAD, ended.message


def test_what_failed_in_the_published_campaign_is_among_them() -> None:
    assert set(rows(DOCS / "verify" / "robustness-found.csv")) <= set(FOUND)


def test_each_case_has_its_files() -> None:
    assert all(files_of(*case) for case in FOUND)
    assert len(FOUND) == len(list((HERE / "found").iterdir())) == 29
