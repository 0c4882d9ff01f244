"""`stoop export`: the files of a simulator or a tool, and how they fly."""

from __future__ import annotations

import argparse

from stoop.extend.verbs import LiveLine, options, page


def run(arguments: argparse.Namespace) -> int:
    """Export, and print what was written and how it flies."""
    from stoop_export.export import export

    with LiveLine(options.COMPILING):
        found = export(
            arguments.subject,
            arguments.target,
            arguments.output,
            arguments.airspeed,
            arguments.altitude,
            arguments.climb_angle,
            arguments.overwrite,
            arguments.draws,
            arguments.seed,
        )
    out = page()
    for place in found.files:
        out.line(f"wrote {arguments.output / place}")
    out.bullets(found.notes)
    return 0
