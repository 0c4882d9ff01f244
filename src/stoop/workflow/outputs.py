"""The output folder, written whole or not at all."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from stoop.errors import OutputError
from stoop.flight import save

if TYPE_CHECKING:
    from stoop.workflow.identification import Job

RESULT = "result.json"  #: moved into place last: where it is, the others are
ATTACHED = ("posterior.nc",)  #: files that some results have


def output_names(flights: Sequence[str]) -> tuple[str, ...]:
    """Return the names of all files that are written for flights of these names, in the order of moving."""
    return ("vehicle.toml", *(flight_file(name, len(flights)) for name in flights), "report.html", RESULT)


def flight_file(name: str, count: int) -> str:
    """Return the name of a flight's file, one of so many."""
    return "flight.nc" if count == 1 else f"flight-{name}.nc"


def check_folder(
    folder: Path,
    flights: Sequence[str],
    overwrite: bool = False,
    inputs: Sequence[Path] = (),
    more: Sequence[str] = (),
) -> None:
    """Refuse a folder that cannot take the outputs, before any work is done; make it if it is not there.

    Parameters
    ----------
    folder : Path
    flights : sequence of str
        Names of the flights.
    overwrite : bool
        Whether earlier outputs may be replaced.
    inputs : sequence of Path
        What was read: never written over.
    more : sequence of str
        Names of further files that will be written.

    Raises
    ------
    OutputError
        It holds an input or an earlier output of the same name, is no folder, or cannot be made.
    """
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder}: is a file; name a folder with -o")
    targets = [folder / name for name in (*more, *output_names(flights))]
    _check_inputs(targets, inputs)
    if not overwrite:
        _check_free(targets)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=".stoop-", dir=folder):
            pass
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}); name another folder with -o"
        ) from None


def _check_inputs(targets: Sequence[Path], inputs: Sequence[Path]) -> None:
    for target in targets:
        for path in inputs:
            if target.exists() and path.exists() and target.samefile(path):
                raise OutputError(
                    f"{target}: is read by this run and would be replaced; name another folder with -o"
                )


def _check_free(targets: Sequence[Path]) -> None:
    there = next((target for target in reversed(targets) if target.exists()), None)
    if there is not None:
        what = "a result" if there.name == RESULT else there.name
        raise OutputError(f"{there.parent}: holds {what} already; add --overwrite or name another folder")


def write_outputs(job: Job, folder: Path, overwrite: bool = False) -> Path:
    """Check the folder, then write result, identified vehicle, flights and report.

    Raises
    ------
    OutputError
        See :func:`check_folder` and :func:`place_outputs`.
    """
    names = [flight.name for flight in job.flights]
    check_folder(folder, names, overwrite, job.files, tuple(job.attachments))
    return place_outputs(job, folder, overwrite)


def place_outputs(job: Job, folder: Path, overwrite: bool = False) -> Path:
    """Write into a folder that was checked, maybe hours ago; all is made first, then moved into place.

    Raises
    ------
    OutputError
        The folder cannot be written; or another run has written there since, and this one's lies beside it.
    """
    names = (*job.attachments, *output_names([flight.name for flight in job.flights]))
    working = folder
    try:
        folder.mkdir(parents=True, exist_ok=True)
        working = Path(tempfile.mkdtemp(prefix=".stoop-", dir=folder))
        _make(job, working)
        if not overwrite:
            _step_aside(working, [folder / name for name in names])
        _move(working, folder, names)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}); free some space or name another folder"
        ) from None
    finally:
        if working != folder:
            shutil.rmtree(working, ignore_errors=True)
    return folder


def _make(job: Job, working: Path) -> None:
    from stoop.report import write_report
    from stoop.workflow.toml import identified_text

    (working / "vehicle.toml").write_text(identified_text(job), encoding="utf-8")
    for flight in job.flights:
        save(flight, working / flight_file(flight.name, len(job.flights)))
    for name, content in job.attachments.items():
        (working / name).write_bytes(content)
    write_report(job.identification, working / "report.html")
    job.identification.result.save(working / RESULT)


def _step_aside(working: Path, targets: Sequence[Path]) -> None:
    """Leave what another run has written meanwhile, and put this run's beside it: hours may lie in either."""
    try:
        _check_free(targets)
    except OutputError:
        aside = working.with_name(working.name.removeprefix("."))
        working.replace(aside)
        raise OutputError(
            f"{aside.parent}: another run has written there meanwhile; this one's result is in {aside}"
        ) from None


def _move(working: Path, folder: Path, names: Sequence[str]) -> None:
    if (folder / RESULT).exists():
        (folder / RESULT).unlink()  # an old mark must not stand beside new files
        for name in set(ATTACHED) - set(names):
            (folder / name).unlink(missing_ok=True)  # nor an old posterior beside a new result
    for name in names:
        (working / name).replace(folder / name)
