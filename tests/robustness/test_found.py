"""The cases that failed in campaigns, once more: what was mended stays so.

`found.csv` names them by surface, seed and number of the campaign that found them, with the words of the command, or the names
of log and mapping and what was asked; ``found`` holds the very files. A command ends with code 0 and outputs that are whole, or
with code 2 and one line of ours; never with a traceback, a warning of a library, or characters that steer a terminal.
"""

import csv
import json
import zipfile
from collections.abc import Mapping
from contextlib import closing
from pathlib import Path

import numpy as np
from robustness import documents, other_readers, readers
from robustness.small_runs import command
from robustness.trials import BAD, READ, Bounds, Child, lay_out, promise

from stoop.base.variables import RATES
from stoop.flight import load_flight
from stoop_plan.flight_logs import save_flight_as

HERE = Path(__file__).parent


def once_more(folder: Path, surface: str, words: list[str], files: Mapping[str, bytes]) -> str:
    lay_out(folder, files)
    form, _, kind = surface.rpartition(" ")
    if surface.startswith("stoop "):
        command(folder, words)
    elif surface == "result":
        documents.ask_result(folder / words[0], 0)
    elif kind == "back":
        there_and_back(folder / words[0], surface.split()[1])
    else:
        log, mapping = folder / words[0], folder / words[1] if words[1] else None
        if kind == "twice":
            return other_readers.compare(form, log, mapping)
        with readers.in_this_process():
            readers.ask(log, mapping, words[2])
    return READ


def there_and_back(path: Path, ending: str) -> None:
    """Write a flight as a log, and read it: body rates are the same to 32 bits and a microsecond of the clock."""
    flight = load_flight(path)
    save_flight_as(flight, path.with_name(f"a{ending}"))
    back = load_flight(path.with_name(f"a{ending}"), rate=flight.rate)
    at = np.searchsorted(flight.time, back.time - 1e-6).clip(0, flight.time.size - 1)
    for name in (n for n in RATES if n in flight.names and n in back.names):
        known, found = flight.column(name)[at], back.column(name)
        here = (np.abs(flight.time[at] - back.time) < 2e-6) & np.isfinite(known) & np.isfinite(found)
        most = (2.0**-22 + 4e-6 * flight.rate) * np.abs(known[here]).max(initial=0.0)
        promise((np.abs(found - known)[here] <= most).all(), f"{name} differs")


def test_what_failed_ends_well() -> None:
    readers.prepare()
    with (HERE / "found.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(list((HERE / "found").iterdir())) == 29
    ended = {}
    bounds = Bounds(seconds=60, memory=2**29)  # equations may have to be compiled
    with closing(Child(once_more, bounds)) as child:
        for row in rows:
            words = row["surface"].removeprefix("stoop ").replace(" .", " ").split()
            name = "-".join([*words, row["seed"], row["number"]])
            with zipfile.ZipFile(HERE / "found" / f"{name}.zip") as archive:
                files = {place: archive.read(place) for place in archive.namelist()}
            ended[name] = child(row["surface"], json.loads(row["words"]), files)
    assert {case: one for case, one in ended.items() if one.outcome in BAD} == {}
