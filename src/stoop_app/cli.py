"""`stoop app`: the local app in a browser."""

from __future__ import annotations

import argparse
import importlib
import sys
from contextlib import suppress
from pathlib import Path
from typing import Final

from stoop.extend.errors import StoopError
from stoop.extend.flights import flight_name
from stoop.extend.verbs import install, page

FOLDER: Final = "stoop-app"
NEEDED: Final = f"app: the package panel is not installed; {install('app')}"


def run(arguments: argparse.Namespace) -> int:
    """Open the folder, take a port, print the address, serve until Ctrl-C."""
    try:
        importlib.import_module("panel")
    except ModuleNotFoundError as error:
        if error.name not in ("panel", "bokeh", "param", "tornado"):
            raise
        raise StoopError(NEEDED) from None
    from stoop_app.folder import Project
    from stoop_app.page import page_of
    from stoop_app.server import Server, open_address

    log: Path | None = arguments.log
    name = FOLDER if log is None else f"{FOLDER}-{flight_name(log)}"
    if log is not None and not log.exists():
        raise StoopError(f"{log}: there is no such log; check the path")
    project = Project(arguments.folder or Path(name))
    server = Server(project.root, page_of(project), arguments.port, round(arguments.max_upload * 1e9))
    if log is not None:
        project.open(log.absolute())
    out = page()
    out.line(f"folder: {project.root}")
    out.text(f"open: {server.address}")
    if not arguments.no_browser and not open_address(server.address):
        out.line("no browser was found: copy the address above into one on this machine")
    out.line("Ctrl-C ends the app; runs go on, and the same command shows them again")
    with suppress(OSError):
        sys.stdout.flush()  # a pipe would keep the address until the app ends
    server.run()
    return 0
