"""The page of a model structure: chosen terms, the steps to them, and the coefficients over time."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop.base.numbers import NOTHING
from stoop.estimate.regression.least_squares import TimeDomain
from stoop.estimate.regression.structure import ChosenTerms, Structure
from stoop.report.plots import Series, plot
from stoop.report.sheet import Bullets, Code, Figure, Prose, Section, Sheet, Table
from stoop.vehicle import Vehicle

LEAD: Final = """\
Nondimensional coefficients were computed sample by sample from measured accelerations and rates, with the mass \
properties and the thrust of the vehicle file; terms were then chosen among candidates. A constant is always there. \
The estimates are those of a regression: a start for stoop identify, not its result."""


def structure_sheet(
    structure: Structure,
    vehicle: Vehicle,
    names: Mapping[str, Mapping[str, str]],
    estimates: Mapping[str, tuple[float, float]],
    command: str,
) -> Sheet:
    """Return the page.

    Parameters
    ----------
    structure : Structure
        Terms by coefficient, with the steps in which they were chosen.
    vehicle : Vehicle
        With the chosen terms.
    names : mapping
        Coefficient -> term -> parameter.
    estimates : mapping of str to (float, float)
        Estimate and standard error by parameter.
    command : str
    """
    sections = []
    for coefficient, chosen in structure.chosen.items():
        constants = [("1", n) for n, t in vehicle.terms[coefficient].items() if t.strip() == "1"]
        rows = [
            (term, name, *_estimate(estimates.get(name)))
            for term, name in (*constants, *names[coefficient].items())
        ]
        table = Table("Chosen terms", ("term", "parameter", "estimate", "std. error"), tuple(rows))
        share = 100.0 * chosen.selection.model.r2
        summary = f"{len(chosen.terms)} of {len(chosen.candidates)} candidates; they explain {share:.1f} % of the variation."
        parts = (Prose(summary), table, _figure(structure, vehicle, coefficient), _steps(chosen))
        sections.append(Section(coefficient, parts))
    notes = [str(n) for chosen in structure.chosen.values() for n in chosen.notices]
    notes += map(str, structure.notices)
    first = [Section("Notes", (Bullets(notes),))] if notes else []
    made = Section("Made by", (Code(command),))
    return Sheet(f"Model structure of {vehicle.name}", LEAD, (*first, *sections, made))


def _estimate(found: tuple[float, float] | None) -> tuple[str, str]:
    if found is None or not np.isfinite(found[0]):
        return NOTHING, NOTHING
    value, std = (f"{v:.4g}".replace("-", "−") for v in found)
    return value, std


def _steps(chosen: ChosenTerms) -> Table:
    rows = tuple(
        (
            str(i), s.action, chosen.candidates[s.column], f"{s.f:.1f}", f"{s.threshold:.3g}", str(s.terms),
            f"{s.r2:.4f}", f"{s.press:.3e}", f"{s.pse:.3e}",
        )
        for i, s in enumerate(chosen.selection.steps, 1)
    )  # fmt: skip
    head = ("step", "action", "term", "partial F", "threshold", "terms", "R²", "PRESS", "PSE")
    return Table("Steps; F of the term, R², PRESS and PSE of the model after the step", head, rows)


def _figure(structure: Structure, vehicle: Vehicle, coefficient: str) -> Figure:
    """Draw the measured coefficient, smoothed, and the chosen terms."""
    smooth, curves = TimeDomain(), list[Series]()
    for history in structure.histories:
        terms = vehicle.terms[coefficient].items()
        modeled = sum(
            (vehicle.value(n) * history.regressor(t) for n, t in terms), np.zeros(len(history.time))
        )
        rows = np.column_stack([history.coefficients[coefficient], modeled, history.time])
        measured, modeled, time = smooth.rows(rows, history.dt).T
        if len(time):
            curves += [Series("measured", time, measured), Series("chosen terms", time, modeled)]
    caption = f"{coefficient} as it was flown, smoothed over {smooth.span:g} s, and the chosen terms"
    return Figure(caption, plot(curves, "time, s", coefficient, caption))
