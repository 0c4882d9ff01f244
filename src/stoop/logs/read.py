"""One entry point for all formats: the first bytes of a file, else its name, select the reader."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from stoop.base.files import note_input
from stoop.errors import LogError
from stoop.logs.formats import DECODED, FORMATS, HDF5, HEAD, PULSE
from stoop.logs.guard import read_guarded
from stoop.logs.recording import Recording, log_content, unreadable


def read(path: Path, mapping: Path | None = None, topics: frozenset[str] | None = None) -> Recording:
    """Read a log.

    Parameters
    ----------
    path : a PX4 .ulg file, a folder of PX4 topic CSVs (plain or .gz), an ArduPilot .bin or .log file, a Crazyflie
        .usd file, a blackbox log of Betaflight or INAV (.bbl, .bfl, .txt, or its .csv), a .mat, .parquet or netCDF
        file, a ROS bag, a .csv (or .csv.gz) file, or a folder of such files, with a mapping
    mapping : TOML file that names the columns of time of CSV files, see `stoop.flight.mapping`; None looks
        beside the log
    topics : names of the streams wanted, without instance; None means all. A reader may return more.

    Returns
    -------
    Recording : streams on the log's own clock, columns in the log's own units, and the defects of the log

    Raises
    ------
    LogError
        When the file is missing, empty, of unknown format or so damaged that nothing can be read.
    """
    from stoop.logs.csv_tables import mapping_beside, names_clock, read_csv, read_px4_folder

    try:
        exists, folder = path.exists(), path.is_dir()
    except (OSError, ValueError) as error:
        why = getattr(error, "strerror", None) or error
        raise LogError(f"{path}: cannot be read ({why}); check the name and its permissions") from None
    if not exists:
        raise LogError(f"{path}: no such file or folder; check the name")
    if not folder and not path.is_file():
        raise LogError(f"{path}: no regular file; copy the log into one")
    for file in path.iterdir() if is_bag_folder(path) else [path]:
        note_input(file)
    mapped = mapping is not None or mapping_beside(path).is_file()
    if folder:
        if is_bag_folder(path):
            return read_as("rosbag", path, topics)
        return read_csv(path, mapping, topics) if mapped else read_px4_folder(path)
    known = kind(path)
    if known == "foreign-netcdf" and not mapped and not _head(path).startswith(HDF5):
        known = "netcdf"  # whose reader reports what is wrong with a flight of stoop that lost its attributes
    if known == "blackbox-csv" and mapped and names_clock(mapping or mapping_beside(path)):
        known = ""  # a table like any other, as its mapping says
    if known:
        return read_as(known, path, topics)
    if path.name.lower().endswith((".csv", ".csv.gz")) or mapping is not None:
        return read_csv(path, mapping, topics)
    raise LogError(
        f"{path}: unknown format; stoop reads .ulg, .nc, .csv, .bin, .log, .usd, .bbl, .bfl, .mat, .parquet, .bag, "
        ".mcap, .db3 and folders of PX4 topic CSVs"
    )


def is_bag_folder(path: Path) -> bool:
    """Return whether a folder is a ROS 2 bag: its description lies beside files of its two kinds of storage."""
    kinds = {".db3", ".mcap"}
    return (path / "metadata.yaml").is_file() and any(file.suffix in kinds for file in path.iterdir())


def read_as(known: str, path: Path, topics: frozenset[str] | None = None) -> Recording:
    """Read a file of a known format, a key of `FORMATS`; see `read`."""
    form = FORMATS[known]
    if form.name:
        return read_guarded(known, path, topics)
    content = (log_content(path, form.most, form.remedy),) if form.most else ()
    return form.function()(path, *content, topics)


def read_unmapped(path: Path) -> Recording:
    """Read a log of any kind, or a folder of CSV files, without a mapping; see `read`."""
    from stoop.logs.csv_tables import read_px4_folder, read_raw_csv

    known = kind(path) if path.exists() else ""
    if known:
        return read_px4_folder(path) if known == "px4-csv" else read_as(known, path)
    table = path.is_dir() or (path.is_file() and path.name.lower().endswith((".csv", ".csv.gz", ".txt")))
    return read_raw_csv(path) if table else read(path)


def kind(path: Path) -> str:
    """Return the format of a file or folder; empty where it is a table of text, several of them, or unknown."""
    if path.is_dir():
        from stoop.logs.csv_tables import topic_files

        with suppress(LogError):
            return "rosbag" if is_bag_folder(path) else "px4-csv" if topic_files(path) else ""
        return ""
    head, name = _head(path), path.name.lower()
    if head.startswith((b"CDF\x01", b"CDF\x02")):
        return "netcdf" if b"stoop_format" in head else "foreign-netcdf"
    if head.startswith(HDF5):
        return "matlab" if path.suffix.lower() == ".mat" else "foreign-netcdf"
    for known, form in FORMATS.items():
        if head.startswith(form.magic):
            return known
    if name.endswith((".csv", ".csv.gz")) and DECODED.search(head):
        return "blackbox-csv"
    # a .bin or .log file can be anything, and must hold ArduPilot's marks somewhere
    if name.endswith(".bin") and PULSE in head:
        return "dataflash"
    if name.endswith(".log") and b"FMT," in head:
        return "dataflash-text"
    return next((known for known, form in FORMATS.items() if name.endswith(form.endings)), "")


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(HEAD)
    except OSError as error:
        raise unreadable(path, error) from None
