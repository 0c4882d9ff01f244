"""Page of a model structure that was determined."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop import Vehicle
from stoop.extend.fits import TimeDomain
from stoop.extend.reports import sheet, with_residual
from stoop_analysis.structure import Structure

STRUCTURE_LEAD: Final = """\
Nondimensional coefficients were computed sample by sample from measured accelerations and rates, with the mass \
properties and the thrust of the vehicle file; terms were then chosen among candidates. A constant is always there. \
The estimates are those of a regression: a start for stoop identify, not its result."""


def structure_sheet(
    structure: Structure,
    vehicle: Vehicle,
    names: Mapping[str, Mapping[str, str]],
    estimates: Mapping[str, tuple[float, float]],
    command: str,
) -> sheet.Sheet:
    """Return the page: chosen terms, the steps to them, and the coefficients over time.

    `names` are parameters by coefficient and term; `estimates` are estimate and standard error by parameter.
    """
    steps_head = ("step", "action", "term", "partial F", "threshold", "terms", "R²", "PRESS", "PSE")
    sections = []
    for coefficient, chosen in structure.chosen.items():
        constants = [("1", n) for n, t in vehicle.terms[coefficient].items() if t.strip() == "1"]
        rows = []
        for term, name in (*constants, *names[coefficient].items()):
            value, std = estimates.get(name, (np.nan, np.nan))
            shown = [f"{v:.4g}".replace("-", "−") if np.isfinite(value) else "–" for v in (value, std)]
            rows.append((term, name, *shown))
        table = sheet.Table("Chosen terms", ("term", "parameter", "estimate", "std. error"), tuple(rows))
        share = 100.0 * chosen.selection.model.r2
        summary = f"{len(chosen.terms)} of {len(chosen.candidates)} candidates; they explain {share:.1f} % of the variation."
        steps = tuple(
            (
                str(i), s.action, chosen.candidates[s.column], f"{s.f:.1f}", f"{s.threshold:.3g}", str(len(s.model.columns)),
                f"{s.model.r2:.4f}", f"{s.model.press:.3e}", f"{s.model.pse:.3e}",
            )
            for i, s in enumerate(chosen.selection.steps, 1)
        )  # fmt: skip
        caption = "Steps; F of the term, R², PRESS and PSE of the model after the step"
        smooth, panels = TimeDomain(), []
        for number, history in enumerate(structure.histories, 1):
            terms, nothing = vehicle.terms[coefficient].items(), np.zeros(len(history.time))
            modeled = sum((vehicle.value(n) * history.regressor(t) for n, t in terms), nothing)
            columns = np.column_stack([history.coefficients[coefficient], modeled, history.time])
            measured, modeled, time = smooth.rows(columns, history.dt).T
            if len(time):
                curves = (
                    sheet.Series("measured", time, measured, role="measured", width=2.8),
                    sheet.Series("chosen terms", time, modeled, role="fit"),
                )
                strips = with_residual(curves, "measured − chosen terms", measured - modeled)
                panels.append(sheet.HistoryPanel(coefficient, strips, meaning=f"stretch {number}"))
        title = f"{coefficient} as it was flown, smoothed over {smooth.span:g} s, and the chosen terms, against time in s."
        drawn = [sheet.TimeHistory([panel]) for panel in panels]
        parts: list[sheet.Part] = [
            sheet.Prose(summary),
            table,
            sheet.Prose(title),
            *drawn,
            sheet.Table(caption, steps_head, steps),
        ]
        sections.append(sheet.Section(coefficient, parts))
    notes = [n for chosen in structure.chosen.values() for n in chosen.notices] + list(structure.notices)
    first = [sheet.Section("Notes", (sheet.Bullets(notes),))] if notes else []
    made = sheet.Section("Made by", (sheet.Code(command),))
    return sheet.Sheet(f"Model structure of {vehicle.name}", STRUCTURE_LEAD, (*first, *sections, made))
