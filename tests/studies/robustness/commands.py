"""Complete commands on hostile inputs, in this process.

A command ends with code 0 and outputs that are whole and keep their promises, or with code 2 and one line of ours that says
what is wrong; never with a traceback, a warning of a library, or characters that steer a terminal.
"""

from __future__ import annotations

import contextlib
import io
from collections.abc import Mapping
from pathlib import Path

from studies.robustness.trials import READ, Bounds, lay_out, promise
from studies.robustness.verb_outputs import check_outputs, strict_json

from stoop.cli.main import USER_ERROR, main
from stoop.errors import StoopError
from stoop.workflow.outputs import ARCHIVES

BOUNDS = Bounds(seconds=60, memory=2**29)  #: equations may have to be compiled
ERROR = "stoop: error: "
WRITTEN = {
    "maneuvers": ("out/windows.toml", "out/windows.html"),
    "identify": tuple(
        f"out/{n}" for n in ("result.json", "report.html", "vehicle.toml", "flight.nc", *ARCHIVES)
    ),
    "validate": ("out/validation.html", "out/validation.json"),
    "polar": ("out/polar.html", "out/polar.json"),
    "structure": ("out/structure.html", "out/structure.csv", "out/vehicle.toml"),
    "vehicle": ("v.toml",),
}  #: verb -> files that it must write (patterns)


def try_command(folder: Path, words: list[str], files: Mapping[str, bytes]) -> str:
    """Run a command line in a folder of files, and look at what it promises; an error of ours is raised as one."""
    lay_out(folder, files)
    streams = io.StringIO(), io.StringIO()
    with (
        contextlib.chdir(folder),
        contextlib.redirect_stdout(streams[0]),
        contextlib.redirect_stderr(streams[1]),
    ):
        code = main(words)
    out, errors = (stream.getvalue() for stream in streams)
    complaints = [line for line in errors.splitlines() if line.startswith(ERROR)]
    odd = next((c for c in out + errors if not (c.isprintable() or c in "\n\t")), "")
    promise(not odd, f"prints {odd!r}")
    promise("Traceback" not in errors, errors[-600:])
    if code == USER_ERROR and len(complaints) == 1:
        raise StoopError(complaints[0].removeprefix(ERROR))
    promise(not code and not complaints, f"ends with {code}, and prints {errors[-200:]!r}")
    if words[-1] == "--json":
        strict_json(out, "what was printed")
    check_outputs(WRITTEN.get(words[0], ()), folder)
    return READ
