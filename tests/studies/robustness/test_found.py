"""The cases that failed in campaigns, once more: what was mended stays so.

`found.csv` names them by surface, seed and number of the campaign that found them, with the words of the command, or the names
of log and mapping and what was asked; ``found`` holds the very files.
"""

from __future__ import annotations

import csv
import json
import zipfile
from contextlib import closing
from pathlib import Path

import numpy as np
from studies.robustness import commands, differential, documents, readers
from studies.robustness.trials import BAD, READ, Child, lay_out, promise

from stoop.base.variables import RATES
from stoop.exporters.flight_logs import save_flight_as
from stoop.flight import load

HERE = Path(__file__).parent
Row = dict[str, str]


def files_of(row: Row) -> dict[str, bytes]:
    words = row["surface"].removeprefix("stoop ").replace(" .", " ").split()
    with zipfile.ZipFile(HERE / "found" / f"{'-'.join([*words, row['seed'], row['number']])}.zip") as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def once_more(folder: Path, surface: str, words: list[str], files: dict[str, bytes]) -> str:
    """Try a case."""
    if surface.startswith("stoop "):
        return commands.try_command(folder, words, files)
    lay_out(folder, files)
    form, _, kind = surface.rpartition(" ")
    if surface == "result":
        documents.ask_result(folder / words[0], 0)
    elif kind == "back":
        there_and_back(folder / words[0], surface.split()[1])
    else:
        log, mapping = folder / words[0], folder / words[1] if words[1] else None
        if kind == "twice":
            return differential.compare(form, log, mapping)
        with readers.in_this_process():
            readers.ask(log, mapping, words[2])
    return READ


def there_and_back(path: Path, ending: str) -> None:
    """Write a flight as a log, and read it: body rates are the same to 32 bits and a microsecond of the clock."""
    flight = load(path)
    save_flight_as(flight, path.with_name(f"a{ending}"))
    back = load(path.with_name(f"a{ending}"), rate=flight.rate)
    at = np.searchsorted(flight.time, back.time - 1e-6).clip(0, flight.time.size - 1)
    for name in (n for n in RATES if n in flight.names and n in back.names):
        known, found = flight.column(name)[at], back.column(name)
        here = (np.abs(flight.time[at] - back.time) < 2e-6) & np.isfinite(known) & np.isfinite(found)
        size = np.abs(known[here]).max(initial=0.0)
        promise(
            (np.abs(found - known)[here] <= (2.0**-22 + 4e-6 * flight.rate) * size).all(), f"{name} differs"
        )


def test_what_failed_ends_well() -> None:
    readers.prepare()
    with (HERE / "found.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(list((HERE / "found").iterdir())) == 29
    with closing(Child(once_more, commands.BOUNDS)) as child:
        ended = {
            " ".join([row["surface"], row["seed"], row["number"]]): child(
                row["surface"], json.loads(row["words"]), files_of(row)
            )
            for row in rows
        }
    assert {case: one for case, one in ended.items() if one.outcome in BAD} == {}
