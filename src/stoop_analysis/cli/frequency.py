"""`stoop frequency`: frequency responses of flights beside those of a model."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from stoop.extend.files import to_json
from stoop.extend.verbs import LiveLine, column, options, page

if TYPE_CHECKING:
    from stoop_analysis.frequency import FrequencyAnalysis


def run(arguments: argparse.Namespace) -> int:
    """Estimate, write the page where asked to, and print."""
    from stoop.extend.flights import load_several
    from stoop_analysis.workflow.frequency import frequency_responses

    target = arguments.output
    with LiveLine("reading the log"):
        flights = load_several(arguments.flight, arguments.mapping)
    with LiveLine("estimating frequency responses"):
        found = frequency_responses(
            flights, arguments.maneuver, arguments.vehicle, arguments.input, arguments.channel, arguments.band
        )
    if target is not None:
        from stoop.extend.reports import sheet
        from stoop_analysis.report.frequency import frequency_sheet

        with LiveLine("drawing"):
            sheet.write_sheet(frequency_sheet(found, options.command_line()), target)
    if arguments.json:
        page().text(to_json(found.to_dict()))
        return 0
    _print(found)
    if target is not None:
        page().line(f"page: {target}")
    return 0


def _print(found: FrequencyAnalysis) -> None:
    from stoop_analysis.frequency import known
    from stoop_analysis.report.frequency import UNITS, condition_text, estimates, interval

    out = page()
    out.line(f"windows: {', '.join(map(str, found.windows))}")
    if found.condition:
        out.line(f"model at {condition_text(found)}")
    rows = [(r, known(r)) for r in found.responses if known(r).any()]
    out.heading("Responses of the flight (coherence 0.6 and more)")
    out.table(
        column("output", [r.output for r, _ in rows]),
        column("input", [r.input for r, _ in rows]),
        column("frequencies", [int(good.sum()) for _, good in rows], 0),
        column("from rad/s", [float(r.frequency[good][0]) for r, good in rows]),
        column("to rad/s", [float(r.frequency[good][-1]) for r, good in rows]),
        column("mean coherence", [float(r.coherence[good].mean()) for r, good in rows], 2),
        column(
            "median error %", [100.0 * sorted(r.bound[good])[int(good.sum()) // 2] for r, good in rows], 0
        ),
    )
    bands = [
        (one, one.bandwidth) for one in found.figures if one.bandwidth is not None and one.bandwidth.reached
    ]
    if bands:
        out.heading("Bandwidth (rad/s) and phase delay (s) of the attitude, 95 % intervals")
        out.table(
            column("rate", [f"{one.output}/{one.input}" for one, _ in bands]),
            column("of", [one.source for one, _ in bands]),
            column("phase bandwidth", [interval(b.phase_bandwidth) for _, b in bands]),
            column("gain bandwidth", [interval(b.gain_bandwidth) for _, b in bands]),
            column("180 deg lag", [interval(b.crossover) for _, b in bands]),
            column("phase delay", [interval(b.phase_delay) for _, b in bands]),
        )
    systems = [
        (one, one.system, name, value)
        for one in found.figures
        if one.system is not None
        for name, value in estimates(one.system).items()
    ]
    if systems:
        out.heading("Low-order equivalent systems, 95 % intervals")
        out.table(
            column("system", [f"{system.name}, {one.output}/{one.input}" for one, system, _, _ in systems]),
            column("of", [one.source for one, _, _, _ in systems]),
            column("parameter", [f"{name} {UNITS.get(name, '')}".strip() for _, _, name, _ in systems]),
            column("estimate", [value for _, _, _, value in systems]),
            column("cost", [system.cost for _, system, _, _ in systems], 1),
        )
    out.bullets(found.notices, "notes")
