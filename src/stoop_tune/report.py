"""The page of an autopilot's loops: margins flown and proposed, Nichols plots with the cloud of draws, margins over airspeed."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.extend.arrays import ComplexArray, FloatArray
from stoop.extend.reports import plots, response_panels, sheet
from stoop.extend.text import number
from stoop_analysis.frequency import MAX_ERROR, MIN_COHERENCE, FrequencyAnalysis
from stoop_analysis.report.frequency import LEGEND as RESPONSES
from stoop_analysis.report.frequency import shown_pairs
from stoop_tune.gain_search import Design, Specification
from stoop_tune.judgment import AxisMargins, LoopMargins, worst
from stoop_tune.physical_parameters import PhysicalParameters
from stoop_tune.proposal import SHOWN, Proposal

CLOUD: Final = 40  #: draws of a Nichols plot
REACH: Final = (-360.0, 0.0)  #: deg, of it
LEVELS: Final = (-30.0, 40.0)  #: dB
FIGURES: Final = (*SHOWN, "bandwidth", "phase delay", "noise")
FANS: Final = SHOWN[:3]  #: the margins
BANDS: Final = (2.5, 25.0, 50.0, 75.0, 97.5)
READ: Final = """\
Each loop is opened at its actuator, the others closed. Thin curves are draws of the model, thick ones the estimates; the disk \
margin keeps the shaded zone free, gain and phase margin the bars of the cross. Numbers are the 5th percentile of the draws (of \
phase delay and noise the 95th) at the worst airspeed."""
CLOSED: Final = f"""\
The rate over its setpoint as the log shows it, and as model and law say with the gains that flew. Drawn is what has a \
coherence of {MIN_COHERENCE:g} and more and an error below {100.0 * MAX_ERROR:.0f} %, that by gusts included."""
LEGEND: Final = (("swatch fan-estimate", "proposed"), ("swatch fan-median", "flown"))


def tuning_page(
    flown: LoopMargins, design: Design, better: Proposal | None = None, command: str = "",
    closed: FrequencyAnalysis | None = None, physics: PhysicalParameters | None = None,
) -> sheet.Page:  # fmt: skip
    """Return the page of gains that flew, with those that are proposed if there are any, and the closed loops of a log."""
    lead = f"{flown.firmware}: {flown.count} draws from the {flown.source}. " + (
        "Gains that flew, and better ones." if better else "Gains that flew."
    )
    sections = []
    cautions = [*flown.notices, *(better.against if better else ())]
    if cautions:
        sections.append(
            sheet.Section("Cautions", (sheet.Bullets(list(dict.fromkeys(map(str, cautions))), "warnings"),))
        )
    parts: list[sheet.Part] = [sheet.Prose(READ, muted=True), _margins(flown.axes, better)]
    if better:
        rows = tuple((n, number(old), number(new)) for n, (old, new) in better.changes.items())
        parts.append(sheet.Table("Gains", ("parameter", "flown", "proposed"), rows))
    sections.append(sheet.Section("Margins", parts))
    sections.append(
        sheet.Section(
            "Nichols plots",
            (sheet.Legend(LEGEND[0 if better else 1 :]), sheet.Panels(_nichols(design, better))),
        )
    )
    if closed:
        drawn = sheet.Panels(response_panels(shown_pairs(closed), MAX_ERROR, MIN_COHERENCE), "large")
        sections.append(
            sheet.Section(
                "Closed loops in flight", (sheet.Prose(CLOSED, muted=True), sheet.Legend(RESPONSES), drawn)
            )
        )
    shown = better.after if better else flown.axes
    if len(design.conditions) > 1:
        title = "Over the airspeed, " + ("proposed" if better else "flown")
        sections.append(sheet.Section(title, (sheet.Panels(_fans(shown)),)))
    if better:
        sections.append(
            sheet.Section(
                "Trial flights",
                (_trials(better), *([sheet.Bullets(better.limited)] if better.limited else [])),
            )
        )
    if physics and (physics.found or physics.absent):
        left_out = [sheet.Bullets([str(one) for one in physics.notices])] if physics.notices else []
        sections.append(sheet.Section("Parameters that are physics", (*_physics(physics), *left_out)))
    if command:
        sections.append(sheet.Section("Made by", (sheet.Code(command),)))
    return sheet.Page(sheet.Sheet("Gains and their margins", lead, tuple(sections)))


def _margins(flown: Sequence[AxisMargins], better: Proposal | None) -> sheet.Table:
    """Return the worst 5 % of each figure by axis: flown, and proposed."""
    sets = [("flown", flown), *([("proposed", better.after)] if better else [])]
    units = {n: u for one in flown for n, (u, _) in one.figures().items()}
    rows = []
    for axis in dict.fromkeys(one.axis for one in flown):
        for title, axes in sets:
            found = [worst(axes, axis, name) for name in FIGURES]
            rows.append((axis, title, *("–" if math.isnan(x) else number(x) for x in found)))
    head = ("axis", "gains", *(f"{n}, {units[n]}" if n in units else n for n in FIGURES))
    return sheet.Table("Worst airspeed", head, tuple(rows))


def _nichols(design: Design, better: Proposal | None) -> list[sheet.Panel]:
    """Return a Nichols plot of each axis at the middle airspeed."""
    middle = len(design.conditions) // 2
    sets = [("lag", design.flown)]
    if better:
        sets.append(("fit", {**design.flown, **{n: new for n, (_, new) in better.changes.items()}}))
    opened = [(color, design.opened(values, middle, CLOUD)) for color, values in sets]
    return [
        sheet.Panel(
            axis,
            _nichols_plot(axis, {color: loops[i] for color, loops in opened}, design.specification),
            "dB",
        )
        for i, axis in enumerate(design.axes)
    ]


def _nichols_plot(axis: str, loops: Mapping[str, ComplexArray], kept: Specification) -> Markup:
    """Return log magnitude over phase of loops (k, m) by color, the estimates first, with the zone that is kept free."""
    with plots.canvas(plots.NARROW, [220.0]) as (figure, (axes,)):
        level, phase = _disk(kept.disk)
        axes.fill(phase, level, color=plots.light("fault"), linewidth=0.0, zorder=0.1)
        cross = (
            ([-180.0 - kept.phase, -180.0 + kept.phase], [0.0, 0.0]),
            ([-180.0, -180.0], [-kept.gain, kept.gain]),
        )
        for x, y in cross:
            axes.plot(x, y, color=plots.light("fault-edge"), linewidth=2.4, zorder=0.2)
        for color, curves in loops.items():
            for i, one in reversed(list(enumerate(curves))):
                level, phase = (
                    20.0 * np.log10(np.maximum(np.abs(one), 1e-9)),
                    np.degrees(np.unwrap(np.angle(one))),
                )
                inside = (level > LEVELS[0]) & (level < LEVELS[1])
                turns = 360.0 * np.round((np.median(phase[inside]) + 180.0) / 360.0) if inside.any() else 0.0
                axes.plot(
                    np.where(inside, phase - turns, np.nan), level, color=plots.light(color),
                    linewidth=1.8 if i == 0 else 0.4, alpha=1.0 if i == 0 else 0.5,
                )  # fmt: skip
        axes.set_xlim(*REACH)
        axes.set_ylim(*LEVELS)
        axes.set_xticks([-360.0, -270.0, -180.0, -90.0, 0.0])
        axes.set_xlabel("phase, deg", size=12.0)
        return plots.svg(figure, f"Nichols plot of the {axis} loop, opened at its actuator.")


def _disk(decibels: float) -> tuple[FloatArray, FloatArray]:
    """Return magnitude (n,), dB, and phase, deg, of the loops whose disk margin is a gain of so many decibels."""
    gain = 10.0 ** (0.05 * decibels)
    radius = (gain + 1.0) / (2.0 * (gain - 1.0))  # 1 / alpha
    sensitivity = 0.5 + radius * np.exp(1j * np.linspace(0.0, 2.0 * np.pi, 181))
    loop = 1.0 / sensitivity - 1.0
    return 20.0 * np.log10(np.abs(loop)), np.degrees(np.angle(-loop)) - 180.0


def _fans(axes: Sequence[AxisMargins]) -> list[sheet.Panel]:
    """Return margins over the airspeed by axis, where all draws have one."""
    out = []
    for axis in dict.fromkeys(one.axis for one in axes):
        own = [one for one in axes if one.axis == axis]
        x = np.array([one.airspeed for one in own])
        for name in FANS:
            unit = own[0].values()[name][0]
            values: list[FloatArray] = [one.values()[name][1] for one in own]
            if np.isfinite(np.array(values)).all():
                bands = np.array([np.percentile(v[1:], BANDS) for v in values]).T
                estimate = np.array([v[0] for v in values])
                drawing = plots.fan_panel(x, estimate, bands, "airspeed, m/s", f"{axis}, {name}")
                out.append(sheet.Panel(f"{axis}, {name}", drawing, unit))
    return out


def _physics(physics: PhysicalParameters) -> list[sheet.Part]:
    """Return values that flew beside new ones with their standard errors."""
    rows = tuple(
        (
            one.name,
            number(one.flown),
            f"{number(one.value)} ± {number(one.figure.std_error)}",
            one.figure.unit,
        )
        for one in physics.found
    )
    return (
        [sheet.Table("Of the identified vehicle", ("parameter", "flown", "new", "unit"), rows)]
        if rows
        else []
    )


def _trials(better: Proposal) -> sheet.Table:
    rows = [
        (
            f"{row['share']:.0f} %",
            row["axis"],
            *(number(row[n]) for n in (*SHOWN, "watch")),
        )
        for row in better.trials()
    ]
    head = ("way", "axis", "gain, dB", "phase, deg", "disk, dB", "rejection, rad/s", "watch near, rad/s")
    return sheet.Table("Files of parameters, in this order", head, tuple(rows))
