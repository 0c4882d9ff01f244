"""`stoop derivatives`: stability and control derivatives, with standard errors."""

from __future__ import annotations

import argparse
import math
from pathlib import Path

from stoop.extend.verbs import LiveLine, column, options, page


def run(arguments: argparse.Namespace) -> int:
    """Compute derivatives and print, or write."""
    from stoop_analysis.workflow.derivatives import check_ending, derivatives, save_derivatives

    target: Path | None = arguments.output
    if target is not None:
        check_ending(target)
    with LiveLine(options.COMPILING):
        found = derivatives(
            arguments.subject,
            arguments.airspeed,
            arguments.altitude,
            arguments.climb_angle,
            arguments.axes,
            arguments.dimensional,
        )
    model = found.model
    out, flight = page(), found.flight
    if target is not None:
        save_derivatives(found, target)
        out.line(f"wrote {target}: derivatives along {arguments.axes} axes (SI units, rad)")
        out.bullets(model.notes)
        return 0
    out.line(model.vehicle.name)
    out.line(
        f"derivatives along {arguments.axes} axes at {flight['airspeed']:g} m/s, {flight['altitude']:g} m, "
        f"alpha {math.degrees(flight['alpha']):.2f} deg"
    )
    for table in found.tables:
        # What is zero by symmetry fills no line.
        kept = [i for i, x in enumerate(table.values.tolist()) if x]
        columns = [
            column("", [table.names[i] for i in kept]),
            column("value", [float(table.values[i]) for i in kept]),
        ]
        if table.known.names:
            errors = table.std_errors
            columns.append(
                column("std error", [float(errors[i]) if table.identified[i] else math.nan for i in kept])
            )
            columns.append(column("", ["" if table.identified[i] else "not identified" for i in kept]))
        out.heading(table.form)
        units = ["" if table.units[i] == "1" else table.units[i] for i in kept]
        out.table(*columns[:2], column("", units), *columns[2:])
    out.bullets(model.notes)
    return 0
