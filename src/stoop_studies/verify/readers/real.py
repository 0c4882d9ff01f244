"""Beginnings of real logs, out of the folder of published data."""

from __future__ import annotations

import gzip
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final

from stoop.errors import StoopError
from stoop_studies.verify.readers.forms import ULOG_HEAD, ulog_messages
from stoop_studies.verify.readers.sample import Sample, single

LINES: Final = 12  #: of a table


def real(reader: str, data: Path) -> list[Sample]:
    """Return logs of a reader, cut small; none for kinds of which there is no published sample.

    Raises
    ------
    StoopError
        The folder does not hold them.
    """
    try:
        return [_REAL[reader](data)] if reader in _REAL else []
    except OSError as error:
        raise StoopError(
            f"verify readers: {data}: {error.strerror}: {error.filename}; name the folder of the published data"
        ) from None


def _ulog(data: Path) -> Sample:
    """Leave out parameters and hardware, which are half of the beginning."""
    whole = _begin(data / "px4-ulog-reader-samples" / "sample_log_small.ulg", 70_000)
    kept = (whole[a:b] for a, b in ulog_messages(whole) if whole[a + 2 : a + 3] not in (b"P", b"M"))
    return single("a.ulg", whole[:ULOG_HEAD] + b"".join(kept), "ulog")


def _dataflash(data: Path) -> Sample:
    return single("a.bin", _begin(data / "ardupilot-dataflash-sample" / "test.BIN", 20_000), "dataflash")


def _crazyflie(data: Path) -> Sample:
    path = data / "crazypad-propeller-damage" / "normal_flight__E8_log00.usd"
    return single("a.usd", _begin(path, 8_000), "crazyflie")


def _px4_csv(data: Path) -> Sample:
    files = sorted((data / "mit-solar-surfer-px4csv").glob("*.csv.gz"))[:5]
    return Sample({file.name.removesuffix(".gz"): _first_lines(file) for file in files}, "lines")


def _csv(data: Path) -> Sample:
    path = data / "a430-micro-fixedwing-mocap" / "short_straight_4_20230215_133852.csv"
    content = b"".join(path.read_bytes().splitlines(keepends=True)[:LINES])
    mapping = b"[time]\ncolumn = 'Systime'\nunit = 's'\n[variables]\np = { column = 'p', unit = 'deg/s' }\n"
    return single("a.csv", content, "lines", mapping)


def _begin(path: Path, size: int) -> bytes:
    with path.open("rb") as file:
        return file.read(size)


def _first_lines(path: Path) -> bytes:
    with gzip.open(path) as file:
        return b"".join(file.readline() for _ in range(LINES))


_REAL: Final[Mapping[str, Callable[[Path], Sample]]] = {
    "ulog": _ulog,
    "dataflash": _dataflash,
    "crazyflie": _crazyflie,
    "px4-csv": _px4_csv,
    "csv": _csv,
}
