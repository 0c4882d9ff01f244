"""The page of flights near hover that are compared with healthy ones: each rotor's loss, and what the flights looked like."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop import Flight
from stoop.extend.reports import channel_panels, plots, sheet
from stoop.extend.text import number
from stoop.extend.variables import FAMILIES
from stoop_analysis.performance.effectiveness import Assessment, judge

LEAD: Final = """\
Each flight near hover is compared with the healthy flights: what each rotor's thrust and torque per command would have to be \
lost, if it alone had changed, to explain lift and moments. The bars are one standard error; all rotors of a flight explain the \
same four numbers, so that several may seem to lose. A rotor is accused below a chance of {chance:g}."""
SHOWN: Final = (*FAMILIES["rates"], "ax", "ay", "az", "phi", "theta", "voltage", "current")


def rotors_sheet(
    healthy: Sequence[Assessment],
    found: Sequence[Assessment],
    flights: Mapping[str, Flight],
    notes: Mapping[str, Sequence[str]],
    chance: float,
    command: str,
) -> sheet.Sheet:
    """Return the page; `healthy` are the healthy flights against each other, `notes` lists by their titles."""
    sections = []
    for title, some in (("Flights in question", found), ("Healthy flights", healthy)):
        rows = tuple(
            (one.name, one.suspected.rotor, number(1.0 - one.suspected.size, 3), number(one.suspected.std, 2),
             number(one.chance, 3), str(judge(one, chance).notice))
            for one in some
        )  # fmt: skip
        head = ("flight", "most suspect", "factor", "std error", "chance", "verdict")
        parts: list[sheet.Part] = [sheet.Table("", head, rows, label=title)]
        parts += [sheet.Figure(f"{one.name}: factor of each rotor", _factors(one)) for one in some]
        sections += [sheet.Section(title, parts)] if some else []
    asked = {one.name for one in found}
    for name, flight in sorted(flights.items(), key=lambda pair: pair[0] not in asked):
        shown = [n for n in flight.channels if n in SHOWN or n.startswith(("motor_", "rotor_"))]
        history = sheet.TimeHistory(channel_panels(flight, shown), wide=True, each=True)
        sections.append(
            sheet.Section(
                f"Time histories of {name}", (sheet.Prose("Against time in s.", muted=True), history), name
            )
        )
    sections += [sheet.Section(title, (sheet.Bullets(items),)) for title, items in notes.items() if items]
    sections.append(sheet.Section("Made by", (sheet.Code(command),)))
    return sheet.Sheet("Rotors", LEAD.format(chance=chance), tuple(sections), "flights near hover")


def _factors(one: Assessment) -> Markup:
    """Draw what is left of each rotor's thrust, if it alone had changed."""
    known = [(i, s) for i, s in enumerate(one.weak) if np.isfinite(s.std)]
    with plots.canvas(plots.WIDTH, [0.4 * plots.HEIGHT], floor=False, titles=False) as (figure, (axes,)):
        axes.axhline(1.0, color=plots.light("zero"), linewidth=1.5)
        for i, s in known:
            role = "lag" if s is one.suspected else "fit"
            axes.errorbar(
                i, 1.0 - s.size, s.std, color=plots.light(role), marker="o", markersize=7.0, linewidth=2.4
            )
        axes.set_xticks(range(len(one.weak)), [s.rotor for s in one.weak])
        axes.set_xlim(-0.5, len(one.weak) - 0.5)
        axes.grid(visible=False, axis="x")
        return plots.svg(
            figure, f"{one.name}: thrust of each rotor against the healthy flights, with standard errors"
        )
