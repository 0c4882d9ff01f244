"""`stoop export`: a vehicle, as identified or as written, for another tool."""

from __future__ import annotations

import argparse
from typing import Final

from stoop.cli.arguments import BUILT_IN_HELP, COMPILING, add_folder, airspeed, altitude, climb_angle
from stoop.cli.page import busy, page

TARGETS: Final = ("jsbsim", "state-space", "simulink")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    subject = f"folder (or result.json) of stoop identify, or a vehicle file (TOML), or {BUILT_IN_HELP}"
    speed = "of the steady flight, m/s (default: the vehicle's reference; hover for a vehicle with rotors)"
    add("subject", metavar="MODEL", help=subject)
    add("--to", dest="target", choices=TARGETS, required=True, help="which tool")
    add_folder(parser, "the files", "files in DIR")
    add("--airspeed", metavar="V", type=airspeed, help=speed)
    add("--altitude", metavar="H", type=altitude, help="m above sea level (default: the flight's, else 200)")
    add("--climb-angle", metavar="DEG", type=climb_angle, default=0.0, help="degrees (default: 0)")


def run(arguments: argparse.Namespace) -> int:
    """Export, and print what was written and how it flies."""
    from stoop.workflow.export import Condition, export, write
    from stoop.workflow.export_subject import read_subject

    subject = read_subject(arguments.subject)
    condition = Condition(arguments.airspeed, arguments.altitude, arguments.climb_angle)
    with busy(COMPILING):
        exported = export(subject, arguments.target, condition)
    write(exported, arguments.output, arguments.overwrite)
    out = page()
    for place in exported.files:
        out.line(f"wrote {arguments.output / place}")
    out.bullets(exported.notes)
    return 0
