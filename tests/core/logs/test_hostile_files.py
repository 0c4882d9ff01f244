"""Files that end early or are none: a longer part holds no less, and what cannot be read is said in one line.

Damage anywhere is tried by tests/studies/robustness.
"""

from contextlib import suppress
from pathlib import Path

import pytest

from stoop.errors import LogError
from stoop.logs import read
from stoop.logs.ulog import MAGIC
from stoop_plan.log_bytes import crazyflie_bytes

from . import test_crazyflie as crazyflie
from . import test_ulog as ulog
from .dataflash_case import as_text, small_log, tables

#: a file of each reader, its ending, and the samples that it has
READERS: dict[str, tuple[bytes, str, int]] = {
    "dataflash": (small_log(12), "bin", 74), "dataflash text": (as_text(tables(12)), "log", 62),
    "ulog": (ulog.small(), "ulg", 70), "crazyflie": (crazyflie_bytes(crazyflie.events()), "usd", 207),
}  # fmt: skip


@pytest.mark.parametrize("name", READERS)
def test_a_longer_part_of_a_file_holds_no_less(tmp_path: Path, name: str) -> None:
    whole, ending, samples = READERS[name]
    path, found = tmp_path / f"a.{ending}", []
    for end in (*range(1, len(whole), 37), len(whole) - 1, len(whole)):
        path.write_bytes(whole[:end])
        found.append(0)
        with suppress(LogError):
            found[-1] = sum(stream.time.size for stream in read(path).streams.values())
    assert found == sorted(found)
    assert found[-2] >= found[-1] - 1 == samples - 1
    assert 0 < found[4 * len(found) // 5] < samples


def test_what_cannot_be_read_is_said_in_one_line(tmp_path: Path) -> None:
    for name, content, words in (
        ("a.bin", b"x", "a.bin: unknown format; stoop reads"),
        ("a", b"x", "a: unknown format; stoop reads"),
        ("a.txt", b"x", "a.txt: unknown format; stoop reads"),
        ("a.ulg", b"", "empty"),
        ("a.nc", b"", "empty"),
        ("a.ulg", b"something else entirely", "not a ULog file"),
        ("a.nc", b"something else entirely", "not a netCDF-3 file"),
        ("a.ulg", MAGIC, "a.ulg"),
        ("b.bin", b"", "b.bin"),
        ("a.log", b"", "a.log"),
        ("b.bin", b"\xa3\x95\x80", "b.bin"),
        ("a.log", b"FMT,", "a.log"),
    ):
        path = tmp_path / name
        path.write_bytes(content)
        for mapping in (None, tmp_path / "m.toml") if "else" in words else (None,):
            with pytest.raises(LogError, match=words) as caught:
                read(path, mapping)
            assert "\n" not in str(caught.value)
    for name in ("none.ulg", "none.csv", "none", "x" * 5000 + ".ulg", "a\0b.ulg"):
        words = "no such file" if "none" in name else "cannot be read|no such file"
        with pytest.raises(LogError, match=words):
            read(tmp_path / name)
