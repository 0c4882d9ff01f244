"""One door for all formats: the name tells which reader is asked."""

from __future__ import annotations

from pathlib import Path

from stoop.errors import LogError
from stoop.logs.recording import Recording


def read(path: Path, mapping: Path | None = None) -> Recording:
    """Read a log.

    Parameters
    ----------
    path : a PX4 .ulg file, a folder of PX4 topic CSVs (plain or .gz), a .nc file written by stoop,
        a .csv (or .csv.gz) file, or a folder of such files, with a mapping
    mapping : TOML file that says which column is which variable, in which unit

    Returns
    -------
    Recording : streams on the log's own clock and the defects that were met

    Raises
    ------
    LogError
        When the file is missing, empty, of unknown format or so damaged that nothing can be read.
    """
    try:
        there, folder = path.exists(), path.is_dir()
    except (OSError, ValueError) as error:
        raise LogError(f"{path}: cannot be read ({error}); check the name and its permissions") from None
    if not there:
        raise LogError(f"{path}: no such file or folder; check the name")
    return _read_folder(path, mapping) if folder else _read_file(path, mapping)


def _read_folder(path: Path, mapping: Path | None) -> Recording:
    from stoop.logs.table import beside, read_csv

    if mapping is not None or beside(path).is_file():
        return read_csv(path, mapping)
    from stoop.logs.px4csv import read_px4_folder

    return read_px4_folder(path)


def _read_file(path: Path, mapping: Path | None) -> Recording:
    """Choose by the name; each reader is imported only when it is needed."""
    name = path.name.lower()
    if name.endswith((".ulg", ".ulog")):
        from stoop.logs.ulog import read_ulog

        return read_ulog(path)
    if name.endswith((".nc", ".cdf")):
        from stoop.logs.netcdf import read_netcdf

        return read_netcdf(path)
    if name.endswith((".csv", ".csv.gz")) or mapping is not None:
        from stoop.logs.table import read_csv

        return read_csv(path, mapping)
    raise LogError(f"{path}: unknown format; stoop reads .ulg, .nc, .csv and folders of PX4 topic CSVs")
