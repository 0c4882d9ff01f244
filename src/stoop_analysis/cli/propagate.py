"""`stoop propagate`: what the uncertainty of an identified model means for trims, modes, limits and expressions."""

from __future__ import annotations

import argparse
from itertools import groupby
from pathlib import Path

from stoop.extend.errors import StoopError
from stoop.extend.files import to_json
from stoop.extend.verbs import LiveLine, column, options, page


def expressions_of(texts: list[str]) -> dict[str, str]:
    """Return expressions by name; raises StoopError for a text of another form, or a name given twice."""
    out: dict[str, str] = {}
    for text in texts:
        name, sign, expression = text.partition("=")
        name, expression = name.strip(), expression.strip()
        if not (sign and name and expression):
            raise StoopError(f"--expression {text}: write NAME=EXPRESSION, for example 'ratio=CLalpha/CD0'")
        if name in out:
            raise StoopError(f"--expression {name}: given twice; give each its own name")
        out[name] = expression
    return out


def run(arguments: argparse.Namespace) -> int:
    """Propagate, write where asked to, and print."""
    from stoop_analysis.workflow.propagation import propagate

    target: Path | None = arguments.output
    expressions = expressions_of(arguments.expression)
    with LiveLine("carrying the draws"):
        found = propagate(
            arguments.result,
            expressions,
            arguments.airspeed,
            arguments.altitude,
            arguments.draws,
            arguments.seed,
            arguments.source,
        )
    if target is not None:
        found.page(options.command_line()).save(target)
    if arguments.json:
        page().text(to_json(found.document()))
        return 0
    from stoop_analysis.report.propagation import shown

    out, domain = page(), found.domain
    out.line(found.vehicle)
    at = f"at {domain.reference:g} m/s" if domain.reference else "in hover"
    out.line(f"{found.count} draws from the {found.source}, {at}, {domain.altitude:.0f} m")
    for group, some in groupby(found.figures, lambda one: one.group):
        rows = list(some)
        scales = [shown(one) for one in rows]
        columns = [
            column(head, [factor * getattr(one, key) for one, (factor, _) in zip(rows, scales, strict=True)])
            for head, key in (
                ("estimate", "estimate"), ("std error", "std_error"), ("95 % from", "ci95_lower"), ("to", "ci95_upper"),
            )
        ]  # fmt: skip
        units = column("", ["" if unit == "1" else unit for _, unit in scales])
        prior = column("", ["mostly priors" if one.rests_on_prior else "" for one in rows])
        out.heading(group)
        out.table(column("", [one.name for one in rows]), *columns, units, prior)
    out.bullets(found.notices, "What they rest on")
    if target is not None:
        out.line()
        out.line(f"page: {target}")
    return 0
