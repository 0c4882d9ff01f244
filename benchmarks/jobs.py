"""What a user waits for: whole commands on real and simulated flights, in processor time of one core.

Flights are those of the shared folder (`STOOP_SHARED`, else ``../shared``), or simulated. Every command runs once with an empty
cache of kernels and then warm; the least of the warm runs counts.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Final

from benchmarks.command import Run, timed
from benchmarks.prototype import SHARED
from benchmarks.table import Row

PART = "jobs"
REPEATS: Final = 3  #: warm runs
ROOT: Final = Path(__file__).parents[1]
EXAMPLES: Final = ROOT / "examples"
VTAIL: Final = SHARED / "data" / "altlnt-vtail-8kg-px4" / "flight2"
HEXACOPTER: Final = SHARED / "data" / "altlnt-hexacopter-px4"
ONE_CORE: Final = {"STOOP_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
#: of README's V-tail
VTAIL_VEHICLE: Final = ("--vehicle", str(EXAMPLES / "vtail.toml"))
VTAIL_WINDOWS: Final = ("--maneuver", "140:145", "146:152", "160:168.3", "--validate", "187:196")


def run() -> list[Row]:
    """Measure the commands."""
    with tempfile.TemporaryDirectory(prefix="stoop-jobs-") as scratch:
        return list(_rows(Path(scratch)))


def identify_vtail(out: str) -> tuple[str, ...]:
    """Return the words of README's identification of the V-tail, 48 parameters, into a folder."""
    return ("identify", str(VTAIL), *VTAIL_VEHICLE, *VTAIL_WINDOWS, "-o", out, "--overwrite")


def _rows(scratch: Path) -> Iterator[Row]:
    cache, out = scratch / "cache", str(scratch / "out")
    if not VTAIL.exists():
        yield Row(PART, "V-tail", None, note="shared folder not found: set STOOP_SHARED")
    else:
        identify = identify_vtail(out)
        cold, warm = _cold_and_warm(identify, cache)
        yield _row("stoop identify of README, warm", _least(warm).processor, 9.0)
        filtered = _least(_cold_and_warm((*identify, "--method", "filter-error"), cache)[1]).processor
        yield Row(
            PART, "the same by filter error, over output error", filtered / _least(warm).processor, "",
            at_most=3.0, note=f"whole commands, warm; {filtered:.2g} s",
        )  # fmt: skip
        yield Row(
            PART, "the same with an empty cache, beyond the warm run", cold.processor - _least(warm).processor,
            "s", note="kernels of its structure compiled, of each method that it tries",
        )  # fmt: skip
        both = min((timed(identify, cache, cores=2) for _ in range(REPEATS)), key=lambda one: one.ended)
        yield Row(PART, "the same, warm, two cores: wall time", both.ended, "s", at_most=6.0)
        find = ("maneuvers", str(VTAIL), *VTAIL_VEHICLE, "-o", str(scratch / "windows"), "--overwrite")
        yield _row("stoop maneuvers, V-tail", _least(_cold_and_warm(find, cache)[1]).processor, 8.0)
        hexacopter = ("maneuvers", str(HEXACOPTER), "--vehicle", str(EXAMPLES / "hexacopter.toml"), "--mapping",
                      str(EXAMPLES / "hexacopter_mapping.toml"), "-o", str(scratch / "hexacopter"), "--overwrite")  # fmt: skip
        spent = _least(_cold_and_warm(hexacopter, cache)[1]).processor
        yield _row("stoop maneuvers, hexacopter", spent, 10.0)
        look = ("look", str(VTAIL), "-o", str(scratch / "look.html"), "--overwrite")
        yield _row("stoop look, V-tail", _least(_cold_and_warm(look, cache)[1]).processor, None)
    yield from _simulated(scratch, cache)


def _simulated(scratch: Path, cache: Path) -> Iterator[Row]:
    """Yield what flights of our own simulation take."""
    yield _long_flight(scratch, cache)
    yield from _hover("quad-x", 6.0, scratch, cache)
    yield from _hover("hexa-x", 8.0, scratch, cache)


def _hover(vehicle: str, at_most: float, scratch: Path, cache: Path) -> Iterator[Row]:
    """Yield what the first simulation, windows and fit of a built-in multirotor take."""
    maneuver, log, found = EXAMPLES / "maneuver_quad.toml", str(scratch / f"{vehicle}.ulg"), scratch / vehicle
    simulate = ("simulate", vehicle, "--maneuver", str(maneuver), "-o", log, "--overwrite")
    cold, warm = _cold_and_warm(simulate, cache)
    yield _row(f"stoop simulate {vehicle}, empty cache", cold.processor, None, warm)
    windows = ("maneuvers", log, "--vehicle", vehicle, "-o", str(found), "--overwrite")
    cold, warm = _cold_and_warm(windows, cache)
    yield _row(f"stoop maneuvers, {vehicle}, empty cache", cold.processor, None, warm)
    identify = (
        "identify", log, "--vehicle", vehicle, "--maneuver", str(found / "windows.toml"),
        "-o", str(scratch / f"{vehicle}-fit"), "--overwrite",
    )  # fmt: skip
    cold, warm = _cold_and_warm(identify, scratch / f"{vehicle}-first")
    yield _row(f"first fit of {vehicle}, empty cache", cold.processor, at_most, warm)


def _long_flight(scratch: Path, cache: Path) -> Row:
    """Find the windows of ten minutes of the built-in airplane, whose controls move one after the other every 12 s."""
    lines = [
        'format = "stoop-maneuver/1"',
        "duration = 600.0",
        "rate = 100.0",
        "airspeed = 35.0",
        "altitude = 300.0",
    ]
    for number, start in enumerate(range(5, 590, 12)):
        control, sign = ("elevator", "aileron", "rudder")[number % 3], (-1) ** (number // 3)
        lines += [
            "[[input]]",
            f'control = "{control}"',
            'shape = "3-2-1-1"',
            f"start = {start}.0",
            "step = 0.3",
        ]
        lines.append(f"amplitude = {0.05 * sign}")
    maneuver, log = scratch / "long.toml", str(scratch / "long.ulg")
    maneuver.write_text("\n".join(lines), encoding="utf-8")
    timed(("simulate", "twin-boom", "--maneuver", str(maneuver), "-o", log, "--overwrite"), cache)
    find = ("maneuvers", log, "--vehicle", "twin-boom", "-o", str(scratch / "long"), "--overwrite")
    spent = _least(_cold_and_warm(find, cache)[1]).processor
    return _row("stoop maneuvers, ten minutes of an airplane, 44 free parameters", spent, 10.0)


def _cold_and_warm(words: Sequence[str], cache: Path) -> tuple[Run, list[Run]]:
    """Run a command on one core, first with what the cache holds of other commands."""
    cold, *warm = (timed(words, cache, variables=ONE_CORE, cores=1) for _ in range(1 + REPEATS))
    return cold, warm


def _least(runs: Sequence[Run]) -> Run:
    return min(runs, key=lambda one: one.processor)


def _row(figure: str, value: float, at_most: float | None, warm: Sequence[Run] = ()) -> Row:
    note = "processor time, one core"
    if warm:
        note += f"; warm {_least(warm).processor:.2g} s"
    return Row(PART, figure, value, "s", at_most=at_most, note=note)
