"""The page of proposed windows: the flight with the windows shaded, their information, and the expected errors."""

from __future__ import annotations

import math
import shlex
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np

from stoop.base.numbers import NOTHING, factor_and_unit, number
from stoop.base.variables import RATES, VARIABLES
from stoop.flight import Flight
from stoop.flight.maneuvers import commands
from stoop.input_design.windows import Found, Proposed
from stoop.problem.windows import NAME
from stoop.report.plots import Series, Shade, Strip, stacked_plots
from stoop.report.sheet import Bullets, Code, Figure, Prose, Section, Sheet, Table

LEAD: Final = """\
Stretches of the flight that are worth fitting, found by how the controls were moved and chosen by {criterion}. Each was \
taken because it adds most for its length to those before it; the choice ends when another adds less than 5 % to the error \
bars. One is held out: what a model predicts there shows what it is worth. The windows avoid gaps, the ground, stuck sensors \
and saturated motors. Edit {name} beside this page to accept, move or decline, then run the command at the end."""
BY_VEHICLE: Final = (
    "their information about the free numbers of {vehicle} (Fisher's information, D-optimality)"
)
BY_COMMAND: Final = "how strongly, and how independently of each other, commands and rates move in them"
KEY: Final = """\
Blue: to be fitted. Orange: to be predicted. Grey with dashed edges: a maneuver that is not proposed, behind those that are. \
Information is the mean logarithm by which a window alone shrinks the error bars (0.69 halves them); gain, likewise, beside \
the windows chosen before it."""
EXPECTED: Final = """\
Standard errors that the windows to be fitted will give, as far as the vehicle file is right in kind: the Cramer-Rao bound \
with initial states and biases unknown, for the residuals that a first linear step leaves in this flight. A dash: not \
identifiable from the windows. {guess}"""
FIRST_GUESS: Final = """\
The first guess is where the errors were worked out: the file's value, or a rough first step. It is no estimate; the fit \
replaces it."""
COMBINED_UNITS: Final = {
    "heave": "m/s2"
}  #: of commands that combine several channels, by axis; others rad/s2


def windows_sheet(
    found: Found, flights: Mapping[str, Flight], vehicle: str, command: str, following: Sequence[str]
) -> Sheet:
    """Return the page.

    Parameters
    ----------
    found : Found
    flights : mapping
        By name.
    vehicle : str
        Its name, or empty.
    command : str
        By which the windows were made.
    following : sequence of str
        Words of the command that takes the file.
    """
    criterion = BY_VEHICLE.format(vehicle=vehicle) if vehicle else BY_COMMAND
    sections = [
        Section(f"The flight {name}" if len(flights) > 1 else "The flight", (_figure(found, flight),))
        for name, flight in flights.items()
    ]
    sections.append(Section("Windows", (Prose(KEY), _windows(found))))
    if found.expected:
        guess = Prose(EXPECTED.format(guess=FIRST_GUESS))
        sections.append(Section("Expected standard errors", (guess, _expected(found))))
    if found.notices:
        sections.append(Section("Notes", (Bullets([*map(str, found.notices)]),)))
    sections.append(Section("Next", (Code(shlex.join(following)), Prose("Made by"), Code(command))))
    return Sheet("Windows worth fitting", LEAD.format(criterion=criterion, name=NAME), tuple(sections))


def numbered(found: Found) -> list[tuple[int, Proposed]]:
    """Return the windows with their numbers, from one on, in order."""
    return list(enumerate(found.windows, 1))


def use_of(window: Proposed) -> str:
    """Return the proposed use of a window."""
    if not window.accept:
        return "not used"
    return "fit" if window.use == "fit" else "predict"


def span_of(window: Proposed, found: Found) -> str:
    """Return start and stop of a window, s, and its flight where there are several."""
    several = len({w.flight for w in found.windows}) > 1
    return f"{window.flight}@" * several + f"{window.start:.1f}:{window.stop:.1f}"


def percent(share: float) -> str:
    """Return a share in percent."""
    if not math.isfinite(share):
        return NOTHING
    return f"{100.0 * share:.1f} %" if share < 10.0 else "> 1000 %"


def _figure(found: Found, flight: Flight) -> Figure:
    own = [(i, w) for i, w in numbered(found) if w.flight == flight.name]
    proposed = ", ".join(f"{w.start:g} to {w.stop:g} s" for _, w in own if w.accept)
    kinds = {"not used": "declined", "fit": "fitted", "predict": "predicted"}
    shades = [Shade(w.start, w.stop, str(i), kinds[use_of(w)]) for i, w in own]  # type: ignore[arg-type]
    description = f"Commands, rates and speed of the whole flight; proposed windows: {proposed}"
    drawing = stacked_plots(
        [*_strips(flight), information_strip(own)], "time, s of the log's clock", description, shades
    )
    return Figure("Commands and motion over the whole flight, windows shaded and numbered", drawing)


def _strips(flight: Flight) -> Iterator[Strip]:
    for command in commands(flight):
        known = VARIABLES.get(command.variable)
        factor, unit = factor_and_unit(known.unit if known else COMBINED_UNITS.get(command.axis, "rad/s2"))
        label = f"{command.axis} command ({command.variable})" + (f", {unit}" if unit else "")
        yield Strip(label, (Series("command", flight.time, factor * command.u),))
    rates = [name for name in RATES if name in flight.data]
    if rates:
        series = (Series(n, flight.time, np.degrees(flight.column(n))) for n in rates)
        yield Strip("rates, deg/s", tuple(series))
    velocity = ("vn", "ve", "vd")
    if set(velocity) <= set(flight.data):
        speed = np.linalg.norm([flight.column(name) for name in velocity], axis=0)
        yield Strip("speed over ground, m/s", (Series("speed", flight.time, speed),))


def information_strip(windows: Sequence[tuple[int, Proposed]]) -> Strip:
    """Return the information of each window as a level over its stretch, and nothing between them."""
    x = np.array([v for _, w in windows for v in (w.start, w.stop, np.nan)])
    y = np.array([v for _, w in windows for v in (w.information, w.information, np.nan)])
    return Strip("information", (Series("information", x, y),), zero=True)


def _windows(found: Found) -> Table:
    rows = [
        (
            str(i), span_of(w, found), use_of(w), w.axis, f"{w.information:.2f}", f"{w.gain:.2f}" if w.gain else NOTHING,
            str(w.why),
        )
        for i, w in numbered(found)
    ]  # fmt: skip
    return Table("", ("number", "window s", "use", "axis", "information", "gain", "why"), tuple(rows))


def _expected(found: Found) -> Table:
    rows = [
        (
            e.name,
            number(e.value, 4),
            number(e.std_error, 3) if math.isfinite(e.std_error) else NOTHING,
            percent(e.relative),
        )
        for e in found.expected
    ]
    return Table("", ("parameter", "first guess", "standard error", "of its size"), tuple(rows))
