"""The output folder, written whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.errors import OutputError
from stoop.flight import save

if TYPE_CHECKING:
    from stoop.job.run import Job

FILES = ("result.json", "vehicle.toml", "report.html")


def check_folder(folder: Path, overwrite: bool) -> None:
    """Refuse a folder that cannot take the outputs, before any work is done.

    Raises
    ------
    OutputError
        It holds a result already, is no folder, or cannot be made.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file; name a folder with -o")
    if (folder / "result.json").exists() and not overwrite:
        raise OutputError(f"{folder}: holds a result already; add --overwrite or name another folder")
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".stoop-", dir=folder):
            pass
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}); name another folder with -o"
        ) from None


def write_outputs(job: Job, folder: Path, overwrite: bool = False) -> Path:
    """Write result, identified vehicle, flights and report; all are made first, then moved into place."""
    from stoop.job.toml import identified_text
    from stoop.report import write_report

    check_folder(folder, overwrite)
    working = Path(tempfile.mkdtemp(prefix=".stoop-", dir=folder))
    try:
        job.identification.result.save(working / "result.json")
        (working / "vehicle.toml").write_text(identified_text(job), encoding="utf-8")
        for flight in job.flights:
            name = "flight.nc" if len(job.flights) == 1 else f"flight-{flight.name}.nc"
            save(flight, working / name)
        write_report(job.identification, working / "report.html")
        for made in sorted(working.iterdir()):
            made.replace(folder / made.name)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}); free some space or name another folder"
        ) from None
    finally:
        shutil.rmtree(working, ignore_errors=True)
    return folder
