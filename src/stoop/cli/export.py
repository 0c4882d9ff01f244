"""`stoop export`: a vehicle, as identified or as written, for another tool."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Final

from stoop.cli.page import busy, page
from stoop.cli.point import BUILT_IN_HELP, COMPILING, airspeed, altitude, climb_angle

TARGETS: Final = ("jsbsim", "state-space", "simulink")
SUBJECT_HELP: Final = (
    f"folder (or result.json) of stoop identify, or a vehicle file (TOML), or {BUILT_IN_HELP}"
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add = parser.add_argument
    add("subject", metavar="MODEL", help=SUBJECT_HELP)
    add("--to", dest="target", choices=TARGETS, required=True, help="which tool")
    add("-o", "--output", metavar="DIR", type=Path, required=True, help="folder for the files")
    add(
        "--airspeed",
        metavar="V",
        type=airspeed,
        help="of the steady flight, m/s (default: the vehicle's reference; a vehicle with rotors hovers)",
    )
    add("--altitude", metavar="H", type=altitude, help="m above sea level (default: the flight's, else 200)")
    add("--climb-angle", metavar="DEG", type=climb_angle, default=0.0, help="degrees (default: 0)")
    add("--overwrite", action="store_true", help="replace files in DIR")


def run(arguments: argparse.Namespace) -> int:
    """Export, and say what was written and how it flies."""
    from stoop.workflow.export import Condition, export, write
    from stoop.workflow.export_subject import read_subject

    folder: Path = arguments.output
    subject = read_subject(arguments.subject)
    condition = Condition(arguments.airspeed, arguments.altitude, arguments.climb_angle)
    with busy(COMPILING):
        exported = export(subject, arguments.target, condition)
    write(exported, folder, arguments.overwrite)
    out = page()
    for place in exported.files:
        out.line(f"wrote {folder / place}")
    out.bullets(exported.notes)
    return 0
