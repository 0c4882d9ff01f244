"""Text tables: speed and memory of reading folders of PX4 topics as ulog2csv writes them, beside pandas alone; one file.

Each is the first that its process reads, so that what is imported for it counts.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.table import Row
from benchmarks.ulog import MIX, PERIOD

PART = "tables"
SIZE = 300 * 10**6  #: bytes of the large folder
SHORT = 20 * 10**6  #: of that of a flight of minutes
REPEATS = 3
_CHILD = """
import json, resource, sys, time
from pathlib import Path
import numpy as np
from stoop.logs import csv_tables
if sys.argv[2] == "pandas":
    csv_tables.plain_numbers = lambda text, count: None
begun = time.process_time()
path = Path(sys.argv[1])
read = csv_tables.read_px4_folder(path) if path.is_dir() else csv_tables.read_csv(path)
used = time.process_time() - begun
kept = sum(s.time.nbytes + s.time.nbytes * len(s.columns) for s in read.streams.values())
peak = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
print(json.dumps({"used": used, "kept": kept, "peak": peak, "defects": len(read.defects)}))
"""


def run() -> list[Row]:
    """Measure folders of two sizes and one file, each in processes of their own."""
    with tempfile.TemporaryDirectory(prefix="stoop-tables-") as folder:
        return list(_rows(Path(folder)))


def _rows(scratch: Path) -> Iterator[Row]:
    for name, asked in (("large", SIZE), ("short", SHORT)):
        size = make(scratch / name, asked) / 1e6
        ours = [_child(scratch / name, "stoop") for _ in range(REPEATS)]
        theirs = [_child(scratch / name, "pandas") for _ in range(REPEATS)]
        used, other = (min(run["used"] for run in runs) for runs in (ours, theirs))
        note = f"{size:.0f} MB, {len(MIX)} topics, {used:.2g} s, least of {REPEATS}; by pandas alone {size / other:.0f} MB/s"
        figure = f"{name} folder of ulog2csv read per second of processor"
        yield Row(PART, figure, size / used, "MB/s", at_least=100.0, note=note)
        memory = max(run["peak"] for run in ours) / ours[0]["kept"]
        other_memory = max(run["peak"] for run in theirs) / theirs[0]["kept"]
        note = f"whole process; pandas alone {other_memory:.2f}"
        yield Row(PART, f"{name} folder: largest memory over the numbers read", memory, note=note)
    topic = next((scratch / "large").glob("*sensor_combined_0.csv"))
    topic.with_name(topic.name + ".toml").write_text(
        '[time]\ncolumn = "timestamp"\nunit = "us"\n[variables]\np = "x0"\n'
    )
    size, used = topic.stat().st_size / 1e6, min(_child(topic, "stoop")["used"] for _ in range(REPEATS))
    yield Row(PART, "one file read per second of processor", size / used, "MB/s", at_least=100.0,
              note=f"{size:.0f} MB")  # fmt: skip


def make(folder: Path, size: int) -> int:
    """Write a folder of about so many bytes: one stretch of flight again and again, with new times."""
    folder.mkdir()
    rng, stretch = np.random.default_rng(5), dict[str, tuple[str, list[bytes], list[int]]]()
    for topic, (rate, types) in MIX.items():
        stamps = (1e6 * (1.0 + np.arange(round(PERIOD * rate)) / rate)).astype(int)
        columns = [_texts(rng, code, stamps.size) for code in types]
        header = ",".join(["timestamp", *(f"x{i}" for i in range(len(types)))]) + "\n"
        rows = ["," + ",".join(cells) + "\n" for cells in zip(*columns, strict=True)]
        stretch[topic] = header, [row.encode() for row in rows], stamps.tolist()
    length = sum(8 * len(rows) + sum(map(len, rows)) for _, rows, _ in stretch.values())
    for topic, (header, rows, stamps) in stretch.items():
        with (folder / f"log_{topic}_0.csv").open("wb") as file:
            file.write(header.encode())
            for later in range(0, round(max(1, size // length) * PERIOD * 1e6), round(PERIOD * 1e6)):
                file.write(
                    b"".join([b"%d%b" % (s + later, row) for s, row in zip(stamps, rows, strict=True)])
                )
    return sum(file.stat().st_size for file in folder.iterdir())


def _texts(rng: np.random.Generator, code: str, size: int) -> list[str]:
    """Return the cells of a column as ulog2csv writes them: shortest texts of numbers of single or double precision."""
    if code not in "fd":
        return [str(x) for x in rng.integers(0, 100, size)]
    return [str(x) for x in rng.normal(0.0, 10.0, size).astype("f4" if code == "f" else "f8")]


def _child(path: Path, reader: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-c", _CHILD, str(path), reader], capture_output=True, text=True, check=True
    )
    told: dict[str, Any] = json.loads(done.stdout)
    if told["defects"]:
        raise RuntimeError(f"{path}: {told['defects']} defects in a sound table")
    return told
