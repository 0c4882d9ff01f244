"""A fleet on disk: a folder with its figures, its parts, and the alarms that were told.

``figures/`` holds a Parquet file for each source, ``parts.csv`` the table of parts as it was given, ``fleet.json`` (schema
``stoop-fleet/1``) the rate of false alarms, the threshold and every alarm. Files of one update are moved into place together.
"""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from stoop.extend.errors import StoopError
from stoop.extend.files import only_writer, write_files
from stoop.extend.text import count
from stoop.extend.verbs import install
from stoop_fleet.causes import EVERY, Cause
from stoop_fleet.parts import Parts, day, read_parts
from stoop_fleet.table import FIGURES, LOGS, NEEDED, FigureTable, of_frames, read_figures, read_frame

if TYPE_CHECKING:
    from stoop_fleet.analysis import Alarm, FleetAnalysis
    from stoop_fleet.logs import LogFigures

SCHEMA: Final = "stoop-fleet/1"
STATE, PARTS, PAGE = "fleet.json", "parts.csv", "fleet.html"
RATE: Final = 1.0  #: false alarms of a new fleet in a year


@dataclass(frozen=True)
class ToldAlarm:
    """An alarm as it was told.

    Attributes
    ----------
    vehicle, figure, kind : texts, see `Alarm` and `Change`
    size, std_error : of a step in the unit of the figure; of a drift per day
    unit : of the figure, empty where it is not known
    began, found : flights
    began_time, found_time : s since 1970, UTC
    causes : the likeliest first
    back : flight of the change before that it takes back, or empty
    withdrawn : whether later flights no longer show it
    """

    vehicle: str
    figure: str
    kind: str
    size: float
    std_error: float
    began: str
    found: str
    began_time: float
    found_time: float
    causes: tuple[Cause, ...]
    back: str = ""
    withdrawn: bool = False
    unit: str = ""

    @classmethod
    def of(cls, alarm: Alarm, unit: str) -> ToldAlarm:
        """Return an alarm of a figure in a unit."""
        change = alarm.change
        return cls(
            alarm.vehicle, alarm.figure, change.kind, change.size, change.error, alarm.began, alarm.found,
            alarm.began_time, alarm.found_time, alarm.causes, alarm.back, unit=unit,
        )  # fmt: skip

    @property
    def since(self) -> str:
        """The flight in which it began, with its day."""
        return f"{self.began} ({day(self.began_time)})"

    @property
    def per(self) -> str:
        """The unit of the size, with what it is per; empty for a step of what has none."""
        return shown_unit(self.unit) + (" a day" if self.kind == "drift" else "")

    @property
    def explanation(self) -> str:
        """The two likeliest causes, with their probabilities."""
        said = [f"back to before {self.back}"] if self.back else []
        first, *_ = self.causes
        also = f", as {', '.join(first.figures)}" if first.figures else ""
        likeliest = [f"{one.name} ({100.0 * one.probability:.0f} %)" for one in self.causes[:2]]
        return "; ".join([*said, ", or ".join([likeliest[0] + also, *likeliest[1:]])])

    def is_of(self, other: ToldAlarm) -> bool:
        """Tell whether both tell of one change: of the same figure, begun in flights of which none is after the other's alarm."""
        same = (self.vehicle, self.figure) == (other.vehicle, other.figure)
        if self.vehicle == EVERY:
            return same and self.causes[0].what == other.causes[0].what
        return same and self.began_time <= other.found_time and other.began_time <= self.found_time


def shown_unit(unit: str) -> str:
    """Return a unit as it follows a number."""
    return "" if unit in ("", "1") else f" {unit}"


@dataclass(frozen=True, eq=False)
class Fleet:
    """A fleet as a folder holds it; see `open_fleet`."""

    folder: Path
    table: FigureTable
    parts: Parts
    alarms_a_year: float
    threshold: float
    alarms: tuple[ToldAlarm, ...]  #: withdrawn ones included, by vehicle, figure and time

    def extent(self) -> str:
        """Return how many vehicles, flights and figures there are."""
        table = self.table
        flights = len(set(zip(table.vehicle, table.flight, strict=True)))
        return f"{count(len(set(table.vehicle)), 'vehicle')}, {count(flights, 'flight')}, {count(len(table.figures()), 'figure')}"

    def standing(self) -> tuple[ToldAlarm, ...]:
        """Return the alarms that were not withdrawn."""
        return tuple(one for one in self.alarms if not one.withdrawn)

    def analysis(self) -> FleetAnalysis:
        """Return models, threshold and changes anew."""
        from stoop_fleet.analysis import analyze

        return analyze(self.table, self.parts, self.alarms_a_year)


def open_fleet(folder: Path | str) -> Fleet:
    """Return the fleet in a folder that ``stoop fleet`` wrote.

    Raises
    ------
    StoopError
        One line: it holds none, one of another version, or a file of it is damaged.
    """
    folder = Path(folder)
    rate, threshold, alarms = _state(folder)
    return Fleet(folder, read_figures(*_partitions(folder)), _parts(folder), rate, threshold, alarms)


@dataclass(frozen=True, eq=False)
class Update:
    """A fleet with new tables, the alarms that are new, the analysis, and what logs could not tell; further `files` by name."""

    fleet: Fleet
    fresh: tuple[ToldAlarm, ...]
    analysis: FleetAnalysis
    absent: Sequence[tuple[str, str, str]]
    files: dict[str, bytes | str] = field(default_factory=dict)


@contextmanager
def updated_fleet(
    folder: Path,
    sources: Sequence[Path],
    parts: Path | None = None,
    alarms_a_year: float | None = None,
    logs: Callable[[], LogFigures] | None = None,
) -> Iterator[Update]:
    """Add tables of figures to the fleet in a folder, or begin one; it is written at the end of the block, unless that raises.

    What the block tells counts as told no earlier: a command that is killed tells its alarms again.

    Parameters
    ----------
    folder : Path
    sources : sequence of Path
        Tables; one of the name of an earlier one replaces it.
    parts : Path, optional
        Table of parts; replaces the earlier one.
    logs : callable, optional
        Returns the figures of all logs so far; it may read the folder, which nobody else changes then.
    alarms_a_year : float, optional
        Rate of false alarms of the whole fleet; by default the earlier one, else `RATE`.

    Raises
    ------
    StoopError
        One line; the fleet is what it was.
    """
    from stoop_fleet.analysis import analyze  # what opens a store has no need of it

    new = {f"{FIGURES}/{source.stem}.parquet": read_figures(source) for source in sources}
    if len({*new, *[LOGS] * (logs is not None)}) < len(sources) + (logs is not None):
        raise StoopError(
            f"{folder}: two tables have one name; rename one, each is kept under the name of its file"
        )
    with only_writer(folder):
        read = None if logs is None else logs()
        new |= {} if read is None else {LOGS: read.table}
        earlier, told = earlier_state(folder)
        rate = alarms_a_year or earlier
        kept = [path for path in _partitions(folder) if f"{FIGURES}/{path.name}" not in new]
        files: dict[str, bytes | str] = {name: _parquet(one) for name, one in new.items()}
        table = of_frames(
            ", ".join(map(str, (*kept, *sources, *["logs"] * (logs is not None)))),
            [*(read_frame(path, NEEDED) for path in kept), *(one.frame() for one in new.values())],
        )
        known = _parts(folder) if parts is None else read_parts(parts)
        found = analyze(table, known, rate)
        now = [ToldAlarm.of(one, found.figures[one.figure].rows.unit[-1]) for one in found.alarms]
        every, fresh = _merged(told, now)
        files |= {} if read is None else read.files
        files |= {} if parts is None else {PARTS: parts.read_bytes()}
        state = {"schema": SCHEMA, "alarms_a_year": rate, "threshold": found.threshold}
        state["alarms"] = [document(one) for one in every]
        absent = () if read is None else read.absent
        update = Update(Fleet(folder, table, known, rate, found.threshold, every), fresh, found, absent)
        yield update
        files |= update.files
        write_files(folder, {**files, STATE: json.dumps(state, indent=1, allow_nan=False) + "\n"})


def _merged(
    told: Sequence[ToldAlarm], now: Sequence[ToldAlarm]
) -> tuple[tuple[ToldAlarm, ...], tuple[ToldAlarm, ...]]:
    """Return the alarms of now with the withdrawn ones, and those of now that were not told."""
    standing = [one for one in told if not one.withdrawn]
    fresh = tuple(one for one in now if not any(one.is_of(other) for other in standing))
    gone = [one for one in told if one.withdrawn]
    gone += [replace(one, withdrawn=True) for one in standing if not any(one.is_of(other) for other in now)]
    every = sorted([*now, *gone], key=lambda a: (a.vehicle, a.figure, a.began_time, a.withdrawn))
    return tuple(every), fresh


def document(alarm: ToldAlarm) -> dict[str, Any]:
    """Return an alarm as JSON holds it."""
    return {**vars(alarm), "causes": [vars(cause) for cause in alarm.causes]}


def earlier_state(folder: Path) -> tuple[float, tuple[ToldAlarm, ...]]:
    """Return rate and alarms of the fleet in a folder, or of a new one; `StoopError` as of `open_fleet`."""
    if not (folder / STATE).exists():
        return RATE, ()
    rate, _, told = _state(folder)
    return rate, told


def _state(folder: Path) -> tuple[float, float, tuple[ToldAlarm, ...]]:
    """Return rate, threshold and alarms that were told."""
    path = folder / STATE
    try:
        state = json.loads(path.read_text("utf-8"))  # replaced later: no input of the command
        if (schema := state["schema"]) != SCHEMA:
            raise StoopError(
                f"{path}: of schema {schema}, not {SCHEMA}; give its tables to a new folder, or use that version of stoop"
            )
        alarms = tuple(
            ToldAlarm(**{**one, "causes": tuple(_cause(cause) for cause in one["causes"])})
            for one in state["alarms"]
        )
        return float(state["alarms_a_year"]), float(state["threshold"]), alarms
    except FileNotFoundError:
        raise StoopError(
            f"{folder}: holds no fleet; begin one with stoop fleet FIGURES.csv -o {folder}"
        ) from None
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        raise StoopError(f"{path}: damaged; remove it, and give the tables once more") from None


def _cause(entry: dict[str, Any]) -> Cause:
    return Cause(**{**entry, "figures": tuple(entry.get("figures", ()))})


def _partitions(folder: Path) -> list[Path]:
    return sorted((folder / FIGURES).glob("*.parquet"))


def _parts(folder: Path) -> Parts:
    path = folder / PARTS
    return read_parts(path) if path.exists() else Parts()


def _parquet(table: FigureTable) -> bytes:
    out = io.BytesIO()
    try:
        table.frame().to_parquet(out, index=False)
    except ImportError:
        raise StoopError(f"a store of a fleet needs a library for Parquet; {install('parquet')}") from None
    return out.getvalue()
