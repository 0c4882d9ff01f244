"""The page of two identifications side by side: estimates with intervals, goodness of fit, and the curves of both."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.fits import ChannelTrace, Interval, ManeuverResult, ManeuverTrace, ParameterEstimate, Result
from stoop.extend.reports import interval_rows, response_strip, sheet
from stoop.extend.text import compact, count, factor_and_unit, number, rounded_to_error
from stoop.extend.variables import VARIABLES

ROLES: Final = ("hue0", "hue1")  #: colors of the two, in curves and intervals
ESTIMATES_LEAD: Final = (
    "Each with its standard error; intervals hold 95 %, each row on a scale of its own, and a hollow dot has none. Apart: the "
    "difference of the estimates over its standard error, were the two independent. "
    "Fixed: the vehicle has the number, and the run did not estimate it. Absent: the vehicle has no such number."
)
GOODNESS_LEAD: Final = (
    "Theil's inequality coefficient: 0 is perfect, 1 useless. A dash: the run has no such window or channel."
)
CURVES_LEAD: Final = "Windows and channels that both runs hold."
DIVERGED: Final = 1e15  #: a simulation that has left for infinity is not drawn beyond
NO_CURVES: Final = "One of the runs was made before curves were kept: run it again to see them here."


@dataclass(frozen=True, eq=False)
class Compared:
    """One of two identifications."""

    name: str
    result: Result
    values: Mapping[str, float]  #: numbers of its vehicle, SI
    traces: Sequence[ManeuverTrace]  #: of its maneuvers, in their order; none where they were not kept

    def cell(self, name: str) -> str:
        """Return an estimate with its standard error, or why there is none."""
        one = self.result.parameters.get(name)
        if one is None:
            return f"fixed at {compact(self.values[name], 4)}" if name in self.values else "absent"
        value, error = rounded_to_error(one.estimate, one.std_error)
        return f"{value} ± {error}" if one.identifiable else f"{value} (not identifiable)"

    @property
    def windows(self) -> dict[str, tuple[ManeuverResult, ManeuverTrace | None]]:
        """Maneuvers with their curves, by title."""
        maneuvers = self.result.maneuvers
        kept = self.traces if len(self.traces) == len(maneuvers) else [None] * len(maneuvers)
        return {m.title: (m, trace) for m, trace in zip(maneuvers, kept, strict=True)}


def comparison_sheet(a: Compared, b: Compared) -> sheet.Sheet:
    """Return the page."""
    runs = {"A": a, "B": b}
    lead = "\n\n".join(
        f"{letter}: {run.name}, {count(len(run.result.parameters), 'parameter')} by {run.result.method}: "
        f"{str(run.result.verdict.headline).removesuffix('.')}."
        for letter, run in runs.items()
    )
    sections = (
        _estimates(runs),
        sheet.Section(
            "Fit and prediction",
            (sheet.Prose(_nearer(a, b)), sheet.Prose(GOODNESS_LEAD, muted=True), _goodness(runs)),
            "Fit",
        ),
        sheet.Section("Measured and simulated", _curves(a, b), "Curves"),
    )
    return sheet.Sheet(f"{a.name} and {b.name}", lead, sections, "comparison")


def _estimates(runs: Mapping[str, Compared]) -> sheet.Section:
    rows = []
    for name in dict.fromkeys(name for run in runs.values() for name in run.result.parameters):
        both = [run.result.parameters.get(name) for run in runs.values()]
        known = [one for one in both if one is not None]
        apart, unit = "–", known[0].unit
        if len(known) == 2 and all(one.identifiable for one in known):
            error = math.hypot(*(one.std_error for one in known))
            apart = number(abs(known[0].estimate - known[1].estimate) / error, 2) if error > 0.0 else "–"
        cells = [run.cell(name) for run in runs.values()]
        drawn = interval_rows(
            [_interval(f"run-{letter.lower()}", one) for letter, one in zip(runs, both, strict=True)],
            f"{name}: A {cells[0]}, B {cells[1]}",
        )
        rows.append((name, *cells, apart, "" if unit == "1" else unit, drawn))
    head = ("Parameter", *runs, "Apart, σ", "Unit", "95 % intervals, drawn")
    table = sheet.Table("", head, tuple(rows), ("", "n", "n", "n", "", "methods"), label="Estimates")
    keys = sheet.Legend(
        [(f"swatch run-{letter.lower()}key", f"{letter}: {run.name}") for letter, run in runs.items()]
    )
    return sheet.Section("Estimates", (sheet.Prose(ESTIMATES_LEAD, muted=True), keys, table))


def _interval(kind: str, one: ParameterEstimate | None) -> tuple[str, float, Interval | None]:
    if one is None:
        return kind, math.nan, None
    return kind, one.estimate, Interval(one.std_error, one.ci95_lower, one.ci95_upper)


def _nearer(a: Compared, b: Compared) -> str:
    """Return which of the two predicts better, by the channels of held-back windows."""
    others, pairs = b.windows, []
    for title, (maneuver, _) in a.windows.items():
        if maneuver.role == "validation" and title in others:
            same = others[title][0].channels
            pairs += [(one.theil, same[c].theil) for c, one in maneuver.channels.items() if c in same]
    known = [(x, y) for x, y in pairs if math.isfinite(x) and math.isfinite(y)]
    if not known:
        return "No window is predicted by both: nothing shows which of them predicts better."
    nearer = sum(y < x for x, y in known)
    return (
        f"Of {count(len(known), 'channel')} that both predict, B is nearer to the flight in {nearer}, "
        f"A in {sum(x < y for x, y in known)}."
    )


def _goodness(runs: Mapping[str, Compared]) -> sheet.Table:
    windows = {letter: run.windows for letter, run in runs.items()}
    channels = tuple(
        dict.fromkeys(c for own in windows.values() for m, _ in own.values() for c in m.channels)
    )
    rows = []
    for title in dict.fromkeys(title for own in windows.values() for title in own):
        for letter, own in windows.items():
            if title in own:
                m = own[title][0]
                theil = (m.channels[c].theil if c in m.channels else math.nan for c in channels)
                cells = (f"{value:.3f}" if math.isfinite(value) else "–" for value in theil)
                rows.append((title, "fitted" if m.role == "fit" else "predicted", letter, *cells))
    kinds = ("", "", "", *("n" for _ in channels))
    return sheet.Table(
        "", ("Maneuver", "", "Run", *channels), tuple(rows), kinds, label="Theil's coefficients"
    )


def _curves(a: Compared, b: Compared) -> list[sheet.Part]:
    if not (a.traces and b.traces):
        return [sheet.Prose(NO_CURVES, muted=True)]
    out: list[sheet.Part] = [sheet.Prose(CURVES_LEAD, muted=True)]
    others = b.windows
    for title, (maneuver, trace) in a.windows.items():
        other = others[title][1] if title in others else None
        if trace is not None and other is not None:
            names = [name for name in trace.channels if name in other.channels]
            panels = [_panel(name, [(t.time, t.channels[name]) for t in (trace, other)]) for name in names]
            out += [sheet.Heading(title, maneuver.role), sheet.TimeHistory(panels, "--maneuver ")]
    return out


def _finite(values: FloatArray) -> FloatArray:
    return np.where(np.abs(values) < DIVERGED, values, np.nan)


def _panel(name: str, both: Sequence[tuple[FloatArray, ChannelTrace]]) -> sheet.HistoryPanel:
    """Return a channel as measured, and as both simulate it."""
    known = VARIABLES.get(name)
    factor, unit = factor_and_unit(known.unit if known else "")
    time, one = both[0]
    curves = [sheet.Series("measured", time, _finite(factor * one.measured), role="measured", width=2.8)]
    for letter, role, (at, found) in zip("AB", ROLES, both, strict=True):
        curves.append(sheet.Series(letter, at, _finite(factor * found.simulated), role=role))
    strip = response_strip(curves)
    meaning = known.meaning if known else ""
    text = f"{name}, {meaning}: measured, and simulated by both."
    return sheet.HistoryPanel(name, (strip,), unit, meaning, name=name, description=text)
