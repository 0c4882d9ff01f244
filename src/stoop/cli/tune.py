"""`stoop tune`: margins of the gains that flew, around an identified model."""

from __future__ import annotations

import argparse
from itertools import groupby

from stoop.base.text import show
from stoop.cli.page import numbers, page, to_json, words
from stoop.cli.progress import LiveLine
from stoop.cli.propagate import airspeeds_of


def run(arguments: argparse.Namespace) -> int:
    """Judge and print."""
    from stoop.workflow.tuning import tune

    airspeed = airspeeds_of(arguments.airspeed)
    with LiveLine("judging the loops"):
        found = tune(
            arguments.result,
            arguments.parameters,
            airspeed,
            arguments.draws,
            arguments.seed,
            arguments.source,
        )
    if arguments.json:
        show(to_json(found.document()))
        return 0
    out = page()
    out.line(
        f"{found.firmware}: loops at each actuator, the others closed; {found.count} draws from the {found.source}"
    )
    for (axis, speed), same in groupby(found.axes, lambda one: (one.axis, one.airspeed)):
        own = next(same)
        figures = own.figures()
        out.heading(f"{axis}, {speed:.4g} m/s" if speed else f"{axis}, hover")
        columns = [
            numbers(head, [spread[key] for _, spread in figures.values()])
            for head, key in (("estimate", "estimate"), ("5 %", "p5"), ("median", "p50"), ("95 %", "p95"))
        ]
        out.table(words("", list(figures)), *columns, words("", [unit for unit, _ in figures.values()]))
        if own.stable < 1.0:
            out.line(f"unstable in {100.0 * (1.0 - own.stable):.2g} % of the draws")
    out.bullets(found.notices, "What they rest on")
    return 0
