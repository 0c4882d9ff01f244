"""Proposed windows as a file to edit and a page to look at."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.files import write_text_atomic
from stoop.base.numbers import number
from stoop.base.variables import RATES
from stoop.design.windows import Found, Proposed
from stoop.flight import VARIABLES, Flight
from stoop.flight.maneuvers import commands
from stoop.problem.windows_file import NAME, Entry, written
from stoop.report.plots import Series, Shade, Strip, stacked_plots
from stoop.report.sheet import Code, Figure, Prose, Section, Sheet, Table, write_sheet

FILES: Final = (NAME, "windows.html")
LEAD: Final = """\
Stretches of the flight that are worth fitting, found by how the controls were moved and chosen by {judge}. Each was taken \
because it adds most for its length to those before it; the choice ends when another adds less than 5 % to the error bars. \
One is held out: what a model predicts there shows what it is worth. The windows avoid gaps, the ground, stuck sensors and \
saturated motors. Edit {name} beside this page to accept, move or turn down, then run the command at the end."""
BY_VEHICLE: Final = "what they tell of the free numbers of {vehicle} (Fisher's information, D-optimality)"
BY_COMMAND: Final = "how strongly, and how independently of each other, commands and rates move in them"
KEY: Final = """\
Blue: to be fitted. Orange: to be predicted. Grey with dashed edges: a maneuver that is not proposed, behind those that are. \
Information is the mean logarithm by which a window alone shrinks the error bars (0.69 halves them); gain, likewise, beside \
the windows chosen before it."""
EXPECTED: Final = """\
Standard errors that the windows to be fitted will give, as far as the vehicle file is right in kind: the Cramer-Rao bound \
with initial states and biases unknown, for the residuals that a first linear step leaves in this flight. A dash: the \
windows do not tell. {guess}"""
FIRST_GUESS: Final = """\
The first guess is where the errors were worked out: the file's value, or a rough first step. It is no estimate; the fit \
replaces it."""


def write_windows(
    found: Found,
    flights: Mapping[str, Flight],
    vehicle: str,
    folder: Path,
    command: str,
    following: Sequence[str],
) -> None:
    """Write `windows.toml` and `windows.html` into a folder; each whole or not at all.

    Parameters
    ----------
    vehicle : name of the vehicle, or empty
    command : by which they were made
    following : words of the command that takes the file
    """
    folder.mkdir(parents=True, exist_ok=True)
    entries = [
        Entry(
            flight=w.flight, start=w.start, stop=w.stop, accept=w.accept, use=w.use, axis=w.axis, why=w.why,
            information=round(w.information, 3), gain=round(w.gain, 3),
        )
        for w in found.windows
    ]  # fmt: skip
    write_text_atomic(folder / NAME, written(entries, shlex.join(following), found.notes))
    write_sheet(windows_sheet(found, flights, vehicle, command, following), folder / "windows.html")


def windows_sheet(
    found: Found, flights: Mapping[str, Flight], vehicle: str, command: str, following: Sequence[str]
) -> Sheet:
    """Return the page."""
    judge = BY_VEHICLE.format(vehicle=vehicle) if vehicle else BY_COMMAND
    sections = [
        Section(f"The flight {name}" if len(flights) > 1 else "The flight", tuple(_flight(found, flight)))
        for name, flight in flights.items()
    ]
    sections.append(Section("Windows", (Prose(KEY), _table(found))))
    if found.expected:
        sections.append(
            Section("What they will tell", (Prose(EXPECTED.format(guess=FIRST_GUESS)), _expected(found)))
        )
    if found.notes:
        sections.append(Section("What to mind", (Prose("\n".join(f"- {note}" for note in found.notes)),)))
    sections.append(Section("Next", (Code(shlex.join(following)), Prose("Made by"), Code(command))))
    return Sheet("Windows worth fitting", LEAD.format(judge=judge, name=NAME), tuple(sections))


def numbered(found: Found) -> list[tuple[int, Proposed]]:
    """Return the windows with their numbers, from one on, in order."""
    return list(enumerate(found.windows, 1))


def kind_of(window: Proposed) -> str:
    """Return in a word what is proposed to do with a window."""
    if not window.accept:
        return "not used"
    return "fit" if window.use == "fit" else "predict"


def span_of(window: Proposed, found: Found) -> str:
    """Return start and stop of a window, s, and its flight where there are several."""
    several = len({w.flight for w in found.windows}) > 1
    return f"{window.flight}@" * several + f"{window.start:.1f}:{window.stop:.1f}"


def _flight(found: Found, flight: Flight) -> Iterator[Figure]:
    own = [(i, w) for i, w in numbered(found) if w.flight == flight.name]
    told = ", ".join(f"{w.start:g} to {w.stop:g} s" for _, w in own if w.accept)
    shades = [_shade(i, w) for i, w in own]
    words = f"Commands, rates and speed of the whole flight; proposed windows: {told}"
    drawing = stacked_plots([*_strips(flight), _worth(own)], "time, s of the log's clock", words, shades)
    yield Figure("Commands and motion over the whole flight, windows shaded and numbered", drawing)


def _shade(i: int, window: Proposed) -> Shade:
    if not window.accept:
        return Shade(window.start, window.stop, str(i), "declined")
    return Shade(window.start, window.stop, str(i), "fitted" if window.use == "fit" else "predicted")


def _strips(flight: Flight) -> Iterator[Strip]:
    for command in commands(flight):
        known = VARIABLES.get(command.variable)
        factor, unit = _shown(known.unit if known is not None else _combined(command.axis))
        label = (
            f"{command.axis} command ({command.variable}), {unit}"
            if unit
            else f"{command.axis} command ({command.variable})"
        )
        yield Strip(label, (Series("command", flight.time, factor * command.u),))
    rates = [name for name in RATES if name in flight.data]
    if rates:
        yield Strip(
            "rates, deg/s", tuple(Series(n, flight.time, np.degrees(flight.column(n))) for n in rates)
        )
    if {"vn", "ve", "vd"} <= set(flight.data):
        speed = np.sqrt(sum((flight.column(n) ** 2 for n in ("vn", "ve", "vd")), np.zeros(flight.time.size)))
        yield Strip("speed over ground, m/s", (Series("speed", flight.time, speed),))


def _combined(axis: str) -> str:
    return "m/s2" if axis == "heave" else "rad/s2"


def _shown(unit: str) -> tuple[float, str]:
    return (
        (math.degrees(1.0), unit.replace("rad", "deg"))
        if "rad" in unit
        else (1.0, "" if unit == "1" else unit)
    )


def _worth(own: Sequence[tuple[int, Proposed]]) -> Strip:
    """Return the information of each window as a level over its stretch, and nothing between them."""
    x = np.array([v for _, w in own for v in (w.start, w.stop, np.nan)])
    y = np.array([v for _, w in own for v in (w.information, w.information, np.nan)])
    return Strip("information", (Series("information", x, y),), zero=True)


def _table(found: Found) -> Table:
    rows = [
        (
            str(i), span_of(w, found), kind_of(w), w.axis, f"{w.information:.2f}", f"{w.gain:.2f}" if w.gain else "–", w.why,
        )
        for i, w in numbered(found)
    ]  # fmt: skip
    return Table("", ("number", "window s", "use", "axis", "information", "gain", "why"), tuple(rows))


def _expected(found: Found) -> Table:
    rows = [
        (
            e.name,
            number(e.value, 4),
            number(e.std_error, 3) if math.isfinite(e.std_error) else "–",
            percent(e.relative),
        )
        for e in found.expected
    ]
    return Table("", ("parameter", "first guess", "standard error", "of its size"), tuple(rows))


def percent(share: float) -> str:
    """Return a share in percent; what is beyond its own size is not told at all."""
    if not math.isfinite(share):
        return "–"
    return f"{100.0 * share:.1f} %" if share < 10.0 else "> 1000 %"
