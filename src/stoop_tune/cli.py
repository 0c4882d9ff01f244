"""`stoop tune`: margins of the gains that flew, around an identified model, and better gains."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from itertools import groupby
from typing import TYPE_CHECKING, Final

from stoop.extend.errors import StoopError
from stoop.extend.files import check_targets, to_json
from stoop.extend.verbs import LiveLine, Page, column, options, page

if TYPE_CHECKING:
    from stoop_tune.judgment import AxisMargins
    from stoop_tune.physical_parameters import PhysicalParameters
    from stoop_tune.proposal import Proposal


PAGE: Final = "tuning.html"  #: in the folder of the proposal


def run(arguments: argparse.Namespace) -> int:
    """Judge, propose where asked to, and print."""
    from stoop_tune.gain_search import Specification
    from stoop_tune.proposal import check_proposal
    from stoop_tune.tuning import tune

    wanted = Specification(
        arguments.gain_margin, arguments.phase_margin, arguments.disk_margin, arguments.noise
    )
    replaced = arguments.overwrite and arguments.page is None
    if arguments.output is None and (arguments.anyway or replaced or wanted != Specification()):
        raise StoopError(
            "tune: margins, --anyway and --overwrite are for a proposal: name a folder for it with -o"
        )
    with LiveLine("judging the loops"):
        found = tune(
            arguments.result,
            arguments.parameters,
            arguments.airspeed,
            arguments.draws,
            arguments.seed,
            arguments.source,
        )
    if arguments.page is not None:
        found.page(command=options.command_line()).save(arguments.page)
    better = None
    if arguments.output is not None:
        asked = (arguments.overwrite, arguments.anyway)
        check_targets(arguments.output, [PAGE], arguments.overwrite)
        check_proposal(arguments.output, found.design.firmware, found.against, *asked)
        with LiveLine("searching gains"):
            better = found.propose(wanted)
        files = better.save(arguments.output, *asked)
        found.page(better, options.command_line()).save(arguments.output / PAGE)
    if arguments.json:
        proposed = {"proposal": better.document()} if better else {}
        page().text(to_json({**found.document(), **proposed}))
        return 0
    out = page()
    out.line(
        f"{found.firmware}: loops at each actuator, the others closed; {found.count} draws from the {found.source}"
    )
    _margins(out, found.axes)
    out.bullets(found.notices, "What they rest on")
    _physics(out, found.physics)
    if arguments.page is not None:
        out.line(f"page: {arguments.page}")
    if better:
        _proposal(out, better)
        out.line()
        for path in files:
            out.line(f"parameters: {path}")
        out.line(f"page: {arguments.output / PAGE}")
    return 0


def _margins(out: Page, axes: Sequence[AxisMargins]) -> None:
    for (axis, speed), same in groupby(axes, lambda one: (one.axis, one.airspeed)):
        own = next(same)
        figures = own.figures()
        out.heading(f"{axis}, {speed:.4g} m/s" if speed else f"{axis}, hover")
        columns = [
            column(head, [spread[key] for _, spread in figures.values()])
            for head, key in (("estimate", "estimate"), ("5 %", "p5"), ("median", "p50"), ("95 %", "p95"))
        ]
        out.table(column("", list(figures)), *columns, column("", [unit for unit, _ in figures.values()]))
        if own.stable < 1.0:
            out.line(f"unstable in {100.0 * (1.0 - own.stable):.2g} % of the draws")


def _physics(out: Page, physics: PhysicalParameters) -> None:
    """Print the parameters that are physics, and what is left out."""
    if not (physics.found or physics.absent):
        return
    out.heading("Parameters that are physics")
    if found := physics.found:
        out.table(
            column("parameter", [one.name for one in found]),
            column("flown", [one.flown for one in found]),
            column("new", [one.value for one in found]),
            column("std error", [one.figure.std_error for one in found]),
            column("", [one.figure.unit for one in found]),
        )
    out.bullets(physics.notices)


def _proposal(out: Page, better: Proposal) -> None:
    """Print old and new values, and what trial flights on the way there must show."""
    from stoop_tune.proposal import SHOWN

    out.heading("Proposed gains")
    columns = [
        column(head, [x[i] for x in better.changes.values()]) for i, head in enumerate(("flown", "proposed"))
    ]
    out.table(column("parameter", list(better.changes)), *columns)
    out.heading("Trial flights")
    rows = better.trials()
    out.table(
        column("% of the way", [row["share"] for row in rows], 0),
        column("axis", [row["axis"] for row in rows]),
        *(column(head, [row[head] for row in rows]) for head in SHOWN),
        column("watch near", [row["watch"] for row in rows]),
        column("", ["rad/s"] * len(rows)),
    )
    out.line(
        "Margins (dB, deg, dB) are the 5 % of the draws at the worst airspeed. Fly each file in calm air at height, with a step "
        "about each axis; go on when it settles as predicted. Stop, and fly the file before, where a rate swings on near the "
        "frequency to watch, or motors and servos grow warm."
    )
    out.bullets(better.limited)
    out.bullets(better.against, "Written all the same")
