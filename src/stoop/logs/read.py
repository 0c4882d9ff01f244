"""One door for all formats: the first bytes tell which reader is asked, and where they do not, the name."""

from __future__ import annotations

import importlib
from collections.abc import Callable
from pathlib import Path
from typing import Final, TypeAlias

from stoop.errors import LogError
from stoop.logs.recording import Recording, unreadable

Topics: TypeAlias = frozenset[str] | None
Reader: TypeAlias = Callable[[Path, Topics], Recording]

HEAD: Final = 2**16  #: bytes looked at; attributes of a netCDF file stand there
READERS: Final = {
    "ulog": ("stoop.logs.ulog", "read_ulog"),
    "dataflash": ("stoop.logs.dataflash", "read_dataflash"),
    "dataflash-text": ("stoop.logs.dataflash_text", "read_dataflash_text"),
    "crazyflie": ("stoop.logs.crazyflie", "read_crazyflie"),
    "matlab": ("stoop.logs.matlab", "read_matlab"),
    "parquet": ("stoop.logs.parquet", "read_parquet"),
    "netcdf": ("stoop.logs.netcdf", "read_netcdf"),
    "foreign-netcdf": ("stoop.logs.foreign_netcdf", "read_foreign_netcdf"),
    "rosbag": ("stoop.logs.rosbag", "read_rosbag"),
}  #: format -> module and function; imported only when it is needed
_MAGIC: Final = (
    (b"ULog\x01\x12\x35", "ulog"),
    (b"\xa3\x95", "dataflash"),
    (b"FMT,", "dataflash-text"),
    (b"\xbc\x01", "crazyflie"),
    (b"\xbc\x02", "crazyflie"),
    (b"MATLAB 5.0 MAT-file", "matlab"),
    (b"MATLAB 7.3 MAT-file", "matlab"),
    (b"PAR1", "parquet"),
    (b"#ROSBAG V", "rosbag"),
    (b"\x89MCAP", "rosbag"),
    (b"SQLite format 3\0", "rosbag"),
)
_NAMES: Final = (
    ((".ulg", ".ulog"), "ulog"),
    ((".usd",), "crazyflie"),
    ((".mat",), "matlab"),
    ((".parquet", ".pq"), "parquet"),
    ((".nc", ".cdf"), "netcdf"),
)
_HDF5: Final = b"\x89HDF\r\n\x1a\n"


def read(path: Path, mapping: Path | None = None, topics: Topics = None) -> Recording:
    """Read a log.

    Parameters
    ----------
    path : a PX4 .ulg file, a folder of PX4 topic CSVs (plain or .gz), an ArduPilot .bin or .log file, a Crazyflie
        .usd file, a .mat, .parquet or netCDF file, a ROS bag, a .csv (or .csv.gz) file, or a folder of such files,
        with a mapping
    mapping : TOML file that says which column is which variable, in which unit
    topics : names of the streams wanted, without instance; None means all. A reader may return more.

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
    return _read_folder(path, mapping, topics) if folder else _read_file(path, mapping, topics)


def _read_folder(path: Path, mapping: Path | None, topics: Topics) -> Recording:
    from stoop.logs.table import beside, read_csv

    if is_bag_folder(path):
        return _reader("rosbag")(path, topics)
    if mapping is not None or beside(path).is_file():
        return read_csv(path, mapping)
    from stoop.logs.px4csv import read_px4_folder

    return read_px4_folder(path)


def is_bag_folder(path: Path) -> bool:
    """Tell whether a folder is a ROS 2 bag: its description lies beside files of its two kinds of storage."""
    return (path / "metadata.yaml").is_file() and any(
        file.suffix in (".db3", ".mcap") for file in path.iterdir()
    )


def _read_file(path: Path, mapping: Path | None, topics: Topics) -> Recording:
    from stoop.logs.table import beside, read_csv

    known = kind(path)
    mapped = mapping is not None or beside(path).is_file()
    if known == "foreign-netcdf" and not mapped and not _is_hdf5(path):
        known = "netcdf"  # which says what is wrong with a flight of ours that lost its head
    if known:
        return _reader(known)(path, topics)
    if path.name.lower().endswith((".csv", ".csv.gz")) or mapping is not None:
        return read_csv(path, mapping)
    raise LogError(
        f"{path}: unknown format; stoop reads .ulg, .nc, .csv, .bin, .log, .usd, .mat, .parquet, .bag, .mcap, .db3 "
        "and folders of PX4 topic CSVs"
    )


def read_unmapped(path: Path) -> Recording:
    """Read a file of a known kind for which a mapping is still to be drafted, all of it as it stands there."""
    return _reader(kind(path))(path, None)


def _reader(known: str) -> Reader:
    module, function = READERS[known]
    reader: Reader = getattr(importlib.import_module(module), function)
    return reader


def kind(path: Path) -> str:
    """Return the format of a file, a key of `READERS`; empty where it is a table of text, or unknown."""
    head = _head(path)
    return _by_content(path, head) or _by_name(path, head)


def _is_hdf5(path: Path) -> bool:
    return _head(path).startswith(_HDF5)


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(HEAD)
    except OSError as error:
        raise unreadable(path, error) from None


def _by_content(path: Path, head: bytes) -> str:
    if head.startswith((b"CDF\x01", b"CDF\x02")):
        return "netcdf" if b"stoop_format" in head else "foreign-netcdf"
    if head.startswith(_HDF5):
        return "matlab" if path.suffix.lower() == ".mat" else "foreign-netcdf"
    return next((known for magic, known in _MAGIC if head.startswith(magic)), "")


def _by_name(path: Path, head: bytes) -> str:
    """Fall back on the name; a .bin or .log file can be anything, and must hold ArduPilot's marks somewhere."""
    name = path.name.lower()
    if name.endswith(".bin") and b"\xa3\x95" in head:
        return "dataflash"
    if name.endswith(".log") and b"FMT," in head:
        return "dataflash-text"
    return next((known for endings, known in _NAMES if name.endswith(endings)), "")
