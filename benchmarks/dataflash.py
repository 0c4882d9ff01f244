"""Half a gigabyte of DataFlash: speed and memory of our reader, beside pymavlink's index of a small part."""

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
from stoop_plan.log_bytes import Table, dataflash_bytes

PART = "dataflash"
SIZE = 500 * 10**6  #: bytes
SMALL = 10 * 10**6  #: bytes that pymavlink is given
STRETCH = 120.0  #: s of flight that are written at once
REPEATS = 3
MIX: dict[str, tuple[float, int, str, str]] = {
    "IMU": (400, 2, "QBffffffIIfBBHH", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,EG,EA,T,GH,AH,GHz,AHz"),
    "RATE": (400, 1, "Qffffffffffff", "TimeUS,RDes,R,ROut,PDes,P,POut,YDes,Y,YOut,ADes,A,AOut"),
    "ATT": (50, 1, "QccccCCCC", "TimeUS,DesRoll,Roll,DesPitch,Pitch,DesYaw,Yaw,ErrRP,ErrYaw"),
    "RCOU": (50, 1, "QHHHHHHHHHHHHHH", "TimeUS,C1,C2,C3,C4,C5,C6,C7,C8,C9,C10,C11,C12,C13,C14"),
    "XKF1": (25, 2, "QBccCfffffffccce", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD,dPD,PN,PE,PD,GX,GY,GZ,OH"),
    "ESC": (20, 4, "QBeffcf", "TimeUS,I,RPM,Volt,Curr,Temp,Err"),
    "BARO": (10, 1, "QffcfIff", "TimeUS,Alt,Press,Temp,CRt,SMS,Offset,GndTemp"),
    "BAT": (10, 1, "Qffffcf", "TimeUS,Volt,VoltR,Curr,CurrTot,Temp,Res"),
}  #: message -> Hz, instances, types and columns, as a copter of ArduPilot 4 logs them
_HEAD = """
import json, sys, time
from pathlib import Path
def peak():
    lines = Path("/proc/self/status").read_text().splitlines()
    return 1024 * int(next(x for x in lines if x.startswith("VmHWM")).split()[1])
path = Path(sys.argv[1])
"""
_OURS = """
from stoop.logs.dataflash import read_dataflash
begun = time.process_time()
recording = read_dataflash(path)
used = time.process_time() - begun
rows = sum(s.time.size for s in recording.streams.values())
"""
_THEIRS = """
from pymavlink import DFReader
begun = time.process_time()
log = DFReader.DFReader_binary(str(path))
used = time.process_time() - begun
rows = sum(n for kind, n in enumerate(log.counts) if log.id_to_name.get(kind) in sys.argv[2].split(","))
"""
_TAIL = """
print(json.dumps({"used": used, "peak": peak(), "rows": rows}))
"""


def run() -> list[Row]:
    """Measure both in processes of their own."""
    with tempfile.TemporaryDirectory(prefix="stoop-dataflash-") as folder:
        return list(_rows(Path(folder) / "flight.bin"))


def _rows(path: Path) -> Iterator[Row]:
    small = make(path, SMALL)
    theirs, same = _child(_THEIRS, path), _child(_OURS, path)
    if theirs["rows"] != same["rows"]:
        raise RuntimeError("the two readers do not find the same rows")
    size = make(path, SIZE)
    ours = [_child(_OURS, path) for _ in range(REPEATS)]
    speed = size / float(np.median([run["used"] for run in ours])) / 1e6
    told = f"{size / 1e6:.0f} MB, every message, median of {REPEATS}"
    yield Row(PART, "DataFlash read per second of processor", speed, "MB/s", at_least=100.0, note=told)
    beside = small / theirs["used"] / 1e6
    yield Row(
        PART, "times faster than pymavlink's index", speed / beside, note=f"which does {beside:.2g} MB/s"
    )
    peak = max(run["peak"] for run in ours)
    yield Row(
        PART,
        "largest memory over the log",
        peak / size,
        at_most=2.0,
        note=f"whole process, {peak / 1e6:.0f} MB",
    )


def make(path: Path, size: int) -> int:
    """Write a log of at least so many bytes."""
    rng = np.random.default_rng(3)
    head = len(dataflash_bytes(_tables(0.0, 0.0, rng)))
    with path.open("wb") as file:
        begin = 0.0
        while file.tell() < size:
            content = dataflash_bytes(_tables(begin, STRETCH, rng))
            file.write(content if begin == 0.0 else content[head:])
            begin += STRETCH
        return file.tell()


def _tables(begin: float, length: float, rng: np.random.Generator) -> list[Table]:
    tables = []
    for name, (rate, instances, letters, columns) in MIX.items():
        count = round(length * rate)
        names = columns.split(",")
        stamps = np.repeat(1e6 * (begin + np.arange(count) / rate), instances)
        values: dict[str, Any] = {column: 100.0 * rng.random(stamps.size) for column in names}
        values |= {"TimeUS": stamps} | (
            {names[1]: np.tile(np.arange(instances), count)} if instances > 1 else {}
        )
        marks = "s#" if instances > 1 else "s-"
        tables.append(Table(name, columns, letters, marks, "F-", values))
    return tables


def _child(code: str, path: Path) -> dict[str, Any]:
    command = [sys.executable, "-c", _HEAD + code + _TAIL, str(path), ",".join(MIX)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    told: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return told
