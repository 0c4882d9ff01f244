"""Text tables: CSV files of any origin, plain or gzipped, and folders of PX4 topics as `ulog2csv` writes them."""

from __future__ import annotations

import io
import os
import re
import warnings
import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.files import note_input
from stoop.base.toml import parse_source, quoted, quoted_key, read_source
from stoop.base.units import FACTORS, MICROSECOND
from stoop.errors import LogError
from stoop.logs.arrays import MIN_RISING, max_values
from stoop.logs.capture_csv import export_of, poses
from stoop.logs.recording import Defect, Recording, Stream, clean_stream, nothing_read, reason, unreadable

if TYPE_CHECKING:
    import pandas as pd

MAX_BYTES: Final = 256 * 2**20  #: text of one file, unpacked; a fast topic of an hour takes 100 MiB
MAX_ROWS: Final = 5_000_000  #: three hours at 400 Hz
MAX_HEADER: Final = 2**20  #: bytes of the first line
MAX_COLUMNS: Final = 4096
MAX_FILES: Final = 200  #: of a folder
MAX_LINE: Final = 2**20  #: bytes of a line that is given to NumPy, which takes ten times as many for a cell
FOLDER_MAPPING: Final = "mapping.toml"
_ENDING: Final = re.compile(r"\.csv(\.gz)?$", re.IGNORECASE)
_PLAIN: Final = b"0123456789+-.eE,\n"  #: bytes of a table of finite numbers
_WORDS: Final = re.compile(rb"(?:nan|inf)*")  #: the other numbers
_CLOCK: Final = re.compile(r"(t|[Tt]ime|[Tt]imestamp|[Ss]ystime)([ _]?[(\[]?(?P<unit>s|ms|us|ns)[)\]]?)?")
_UNITS: Final = {
    "V": "m/s", "vt": "m/s", "alpha": "rad", "beta": "rad", "phi": "rad", "theta": "rad", "psi": "rad",
    "p": "rad/s", "q": "rad/s", "r": "rad/s", "ax": "m/s2", "ay": "m/s2", "az": "m/s2",
    "vn": "m/s", "ve": "m/s", "vd": "m/s", "pn": "m", "pe": "m", "pd": "m", "altitude": "m",
    "elevator": "rad", "aileron": "rad", "rudder": "rad", "thrust": "N", "density": "kg/m3",
}  # fmt: skip
_TOPICS: Final = (
    "actuator_armed actuator_controls_0 actuator_controls_1 actuator_controls_2 actuator_controls_3 "
    "actuator_motors actuator_outputs actuator_servos airspeed airspeed_validated airspeed_wind "
    "battery_status cpuload differential_pressure distance_sensor ekf2_innovations ekf2_timestamps "
    "esc_status estimator_aid_src_airspeed estimator_attitude estimator_innovations "
    "estimator_local_position estimator_sensor_bias estimator_states estimator_status estimator_wind "
    "home_position input_rc manual_control_setpoint rate_ctrl_status rpm sensor_accel sensor_baro "
    "sensor_combined sensor_gps sensor_gyro sensor_mag system_power tecs_status vehicle_acceleration "
    "vehicle_air_data vehicle_angular_acceleration vehicle_angular_velocity vehicle_attitude "
    "vehicle_attitude_setpoint vehicle_control_mode vehicle_global_position vehicle_gps_position "
    "vehicle_imu vehicle_imu_status vehicle_land_detected vehicle_local_position "
    "vehicle_local_position_setpoint vehicle_magnetometer vehicle_rates_setpoint vehicle_status "
    "vehicle_thrust_setpoint vehicle_torque_setpoint vtol_vehicle_status wind wind_estimate "
    "yaw_estimator_status "
)
#: of PX4; by them the common prefix of the files of a log is found
KNOWN_TOPICS: Final = frozenset(_TOPICS.split())


def mapping_beside(path: Path) -> Path:
    """Return where the mapping of a log stands when none is named."""
    return path / FOLDER_MAPPING if path.is_dir() else path.with_name(path.name + ".toml")


def names_clock(mapping: Path) -> bool:
    """Return whether a mapping names the column of the time itself."""
    return "time" in parse_source(read_source(mapping, "mapping", LogError), str(mapping), LogError)


def read_csv(path: Path, mapping: Path | None = None, topics: frozenset[str] | None = None) -> Recording:
    """Read one CSV file, or a folder of them, with the columns of time that a mapping names.

    Parameters
    ----------
    path : the file or folder
    mapping : TOML file, see `stoop.flight.mapping`; None looks beside the log
    topics : files of a folder that are wanted; None means all

    Raises
    ------
    LogError
        When there is no mapping (the text holds one to start from), or nothing can be read.
    """
    place = mapping or mapping_beside(path)
    if mapping is None and not place.is_file():
        text = unpack(path)[0]
        export = export_of(path, text)
        header = [*poses(export, [np.empty(0)] * export.count)] if export else _header(path, text)
        raise LogError(
            f"{path}: a CSV log needs a mapping of its columns; save the lines below as {place.name} beside it, keep "
            f"and correct what applies (or let stoop map draft one)\n{template(header)}"
        )
    content = parse_source(read_source(place, "mapping", LogError), str(place), LogError)
    if path.is_dir() and "extends" in content and "time" not in content:
        return read_px4_folder(path)
    named = content.get("clock", {})
    tables = {"": content.get("time"), **(named if isinstance(named, dict) else {})}
    clocks = {name: str(x["column"]) for name, x in tables.items() if isinstance(x, dict) and "column" in x}
    return read_raw_csv(path, clocks, topics)


def read_raw_csv(
    path: Path, clocks: Mapping[str, str] | None = None, topics: frozenset[str] | None = None
) -> Recording:
    """Read one CSV file, or a folder of them, without a mapping.

    Parameters
    ----------
    path : the file or folder
    clocks : file -> column of its time, "" for all others; where there is none, the likeliest column is
        taken, and its unit from its name
    topics : files of a folder that are wanted; None means all

    Returns
    -------
    Recording : one stream per file, all columns as recorded, the clock among them; `info` names it

    Raises
    ------
    LogError
        When there is no CSV file, or no two samples with a time are left.
    """
    files = [path]
    if path.is_dir():
        files = sorted(file for file in path.iterdir() if _ENDING.search(file.name))[:MAX_FILES]
    if not files:
        raise LogError(f"{path}: no CSV file in this folder; name the folder of the log")
    wanted = [file for file in files if topics is None or file.name in topics or file == path]
    streams: dict[str, Stream] = {}
    defects: list[Defect] = []
    info: dict[str, str] = {}
    for file in wanted:
        table, found = read_table(file)
        column, factor = (clocks or {}).get(file.name, (clocks or {}).get("", "")), 1.0
        if not column or column not in table:  # a column may have no name
            column, unit = guess_clock(list(table))
            factor = FACTORS[unit]
            if not _CLOCK.fullmatch(column):
                long = ((n, np.mean(np.diff(x) > 0.0)) for n, x in table.items() if x.size > 2)
                column = next((n for n, rising in long if rising > MIN_RISING), column)
        stream, dropped = clean_stream(file.name, table[column] * factor, table)
        defects += [*found, *dropped]
        if stream.time.size > 1:
            streams[file.name] = stream
            info[f"clock of {file.name}"] = column
    if not streams:
        raise LogError(f"{path}: fewer than two samples with a time are left; name the column of the time")
    unread: dict[str, tuple[str, ...]] = {file.name: () for file in files if file not in wanted}
    return Recording(path, "table", streams, tuple(defects), info=info, unread=unread)


def guess_clock(header: list[str]) -> tuple[str, str]:
    """Return the likeliest column of the time and its unit, by names alone."""
    clock = next((name for name in header if _CLOCK.fullmatch(name)), header[0])
    match = _CLOCK.fullmatch(clock)
    return clock, (match and match["unit"]) or "s"


def template(header: list[str]) -> str:
    """Return a mapping to start from: each column under its own name, the likeliest one as the time."""
    clock, unit = guess_clock(header)
    lines = ["[time]", f"column = {quoted(clock)}", f'unit = "{unit}"', "", "[variables]"]
    rows = [(name, _UNITS.get(name, "1")) for name in header if name != clock]
    lines += [f'{quoted_key(name)} = {{column = {quoted(name)}, unit = "{u}"}}' for name, u in rows]
    return "\n".join(lines)


def read_table(path: Path) -> tuple[dict[str, FloatArray], tuple[Defect, ...]]:
    """Read a CSV file with one header line, plain or gzipped.

    Parameters
    ----------
    path : the file; its name ends in .csv or .csv.gz

    Returns
    -------
    columns : name -> (n,) numbers; cells that hold no number are NaN
    defects : a cut end, a broken archive, cells that hold no number

    Raises
    ------
    LogError
        When there is no header, no line of numbers, or more text than `MAX_BYTES`.
    """
    text, found = unpack(path)
    return parse_table(path, text, found)


def parse_table(
    path: Path, text: bytes, found: tuple[Defect, ...] = ()
) -> tuple[dict[str, FloatArray], tuple[Defect, ...]]:
    """Read the text of a table, with the defects `found` so far; see `read_table`."""
    text, cut = whole_lines(text, path.name)
    export = export_of(path, text)
    if export is not None:
        ends = (match.end() for match in re.finditer(b"\n", text))
        start = next(islice(ends, export.lines - 1, None), len(text))
        names = ",".join(f"column {i}" for i in range(export.count))
        parsed, found = parse_table(path, names.encode() + b"\n" + text[start:], (*found, *cut))
        nothing = np.full(len(next(iter(parsed.values()))), np.nan)  # of cells that the lines lack
        return poses(export, [parsed.get(f"column {i}", nothing) for i in range(export.count)]), found
    defects = [*found, *cut]
    header = _header(path, text)
    if text.count(b"\n") > MAX_ROWS:
        raise LogError(f"{path}: more than {MAX_ROWS} lines; cut the log to the flight of interest")
    if len(header) * text.count(b"\n") > max_values(path):
        raise LogError(f"{path}: more than {max_values(path)} numbers, for a file that short; damaged?")
    columns: dict[str, FloatArray] = {}
    plain = plain_numbers(text, len(header))
    if plain is not None:
        for name, values in zip(header, plain, strict=True):
            columns.setdefault(name, values)
        return columns, tuple(defects)
    import pandas as pd  # heavy, and only here

    try:
        table = pd.read_csv(
            io.BytesIO(text), skiprows=1, header=None, on_bad_lines="error",
            skip_blank_lines=True, low_memory=False, index_col=False, engine="c",
        )  # fmt: skip
    except (ValueError, OverflowError, MemoryError) as error:  # pandas.errors derive from ValueError
        cells = re.search(r"Expected (\d+) fields in line (\d+), saw (\d+)", str(error))
        if isinstance(error, pd.errors.EmptyDataError):
            why = ", nothing stands below its header"
        elif cells is not None:
            why = f", line {cells[2]} has {cells[3]} cells, those before have {cells[1]}"
        else:
            why = f" ({reason(error)})"
        raise LogError(
            f"{path}: not a table of numbers{why}; record again, correct or replace the file"
        ) from None
    named, filled = len(header), len(table.columns)
    if any(header[filled:]) or table.iloc[:, named:].notna().to_numpy().any():
        differ = f"the header names {named} columns, and the lines have {filled}"
        message = f"{differ}; those that both have are read"
        defects.append(Defect("corrupt", path.name, message))
    for name, label in zip(header, table.columns, strict=False):
        columns.setdefault(name, values := numbers(table[label]))
        if lost := int(np.isnan(values).sum() - table[label].isna().sum()):
            message = f"{lost} of {len(values)} cells hold no number"
            defects.append(Defect("text", f"{path.name} {name}", message))
    return columns, tuple(defects)


def plain_numbers(text: bytes, count: int) -> FloatArray | None:
    """Return the columns (count, n) of a text that holds a number in each cell below its header; None for any other text.

    NumPy reads such a text about as fast as pandas, which takes longer to import than to read a flight of minutes.
    """
    start = text.find(b"\n") + 1
    words = text[:start].translate(None, _PLAIN)
    others = text.translate(None, _PLAIN)[len(words) :]
    short = all(text.find(b"\n", i, i + MAX_LINE) >= 0 for i in range(start, len(text), MAX_LINE))
    if not start or not short or not _WORDS.fullmatch(others) or b"+n" in text:
        return None
    lines = io.BytesIO(text)
    lines.seek(start)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")  # of a text without a line
            table = np.loadtxt(lines, delimiter=",", comments=None, ndmin=2)
    except (ValueError, Warning, MemoryError):
        return None
    return table.T if table.shape[1] == count else None


def whole_lines(text: bytes, place: str) -> tuple[bytes, list[Defect]]:
    """Return a text without its last line where that has no end: whether its last number is whole cannot be known."""
    end = text.rfind(b"\n") + 1
    if not 0 < end < len(text):
        return text, []
    message = "the last line has no end, is perhaps cut, and was dropped"
    return text[:end], [Defect("truncated", place, message)]


def numbers(cells: pd.Series[Any]) -> FloatArray:
    """Return the cells of a column as numbers (n,): NaN what is none, infinite what is beyond float64."""
    import pandas as pd

    if cells.dtype.kind == "O":  # whole numbers beyond 64 bits, which pandas takes for objects
        cells = cells.astype(str)
    return np.asarray(pd.to_numeric(cells, errors="coerce"), dtype=np.float64)


def unpack(path: Path) -> tuple[bytes, tuple[Defect, ...]]:
    """Return the text of a file; a cut or damaged archive yields what it still holds."""
    text = bytearray()
    defects: tuple[Defect, ...] = ()
    stream = zlib.decompressobj(wbits=31)
    try:
        note_input(path)
        with path.open("rb") as file:
            if path.suffix != ".gz":
                text += file.read(min(MAX_BYTES, os.fstat(file.fileno()).st_size) + 1)
            while path.suffix == ".gz" and (packed := file.read(2**20)):
                while packed and len(text) <= MAX_BYTES:
                    text += stream.decompress(packed, MAX_BYTES + 1 - len(text))
                    # after the end of one gzip member: the next member, or padding with zeros
                    behind = stream.unused_data.lstrip(b"\0") if stream.eof else b""
                    packed = stream.unconsumed_tail or behind
                    if stream.eof and packed:
                        stream = zlib.decompressobj(wbits=31)
    except OSError as error:
        raise unreadable(path, error) from None
    except zlib.error:
        defects = (Defect("corrupt", path.name, "damaged archive; read up to the damage"),)
    else:
        if path.suffix == ".gz" and not stream.eof:
            defects = (Defect("truncated", path.name, "the archive is cut; the rest was read"),)
    if len(text) > MAX_BYTES:
        raise LogError(
            f"{path}: more than {MAX_BYTES >> 20} MiB of text; cut the log to the flight of interest"
        )
    return bytes(text), defects


def _header(path: Path, text: bytes) -> list[str]:
    if not text.strip():
        raise LogError(f"{path}: the log is empty; record again or name another file")
    line = text[: MAX_HEADER + 1].split(b"\n", 1)[0].rstrip(b"\r")
    names = line.split(b",")
    if len(names) == 1 and (b";" in line or b"\t" in line):
        raise LogError(
            f"{path}: its columns are not separated by commas; save it with commas and decimal points"
        )
    if len(line) > MAX_HEADER or len(names) > MAX_COLUMNS:
        raise LogError(
            f"{path}: the header has more than {MAX_COLUMNS} columns; is this a comma-separated table?"
        )
    try:
        return [name.decode("utf-8-sig").strip().strip('"') for name in names]
    except UnicodeDecodeError:
        raise LogError(f"{path}: not a text table; save it as UTF-8, with one header line") from None


def read_px4_folder(folder: Path) -> Recording:
    """Read a folder with one CSV file per PX4 topic and instance; what is wrong with one does not affect the others.

    Raises
    ------
    LogError
        When the folder holds no topic file, two logs, or nothing that can be read.
    """
    streams: dict[str, Stream] = {}
    defects: list[Defect] = []
    for file in topic_files(folder):
        place = file.path.name
        try:
            columns, found = read_table(file.path)
        except LogError as error:
            defects.append(Defect("skipped", place, str(error).removeprefix(f"{file.path}: ")))
            continue
        defects += found
        stamp = columns.pop("timestamp", None)
        if stamp is None:
            defects.append(Defect("skipped", place, "no column 'timestamp'"))
            continue
        stream, dropped = clean_stream(place, stamp * MICROSECOND, columns)
        defects += dropped
        if not stream.time.size:
            defects.append(Defect("skipped", place, "no sample with a time is left"))
            continue
        streams[f"{file.topic}/{file.instance}" if file.topic in streams else file.topic] = stream
    if not streams:
        raise nothing_read(folder, "no topic holds data", defects, "export the log again with ulog2csv")
    return Recording(folder, "px4-csv", streams, tuple(defects))


@dataclass(frozen=True)
class TopicFile:
    """One file of a folder: prefix of the log, topic and instance, by its name."""

    path: Path
    prefix: str
    topic: str
    instance: int


def topic_files(folder: Path) -> list[TopicFile]:
    """List the topic files of a folder, by topic and instance; the names begin with one common prefix.

    Raises
    ------
    LogError
        When there is none, or there are two logs: another prefix holds several topics, or a file that does not
        have the prefix repeats a topic.
    """
    try:
        paths = sorted(p for p in folder.iterdir() if _ENDING.search(p.name) and p.is_file())
    except OSError as error:
        raise LogError(f"{folder}: cannot be read ({error.strerror}); check its permissions") from None
    known: list[TopicFile] = []
    stems: dict[Path, tuple[str, int]] = {}
    for path in paths:
        stem = _ENDING.sub("", path.name)
        found = re.search(r"_(\d{1,2})$", stem)
        numbered = found is not None and stem not in KNOWN_TOPICS
        stems[path] = (stem[: found.start()], int(found[1])) if found and numbered else (stem, 0)
        stem, instance = stems[path]
        words = stem.split("_")
        endings = ("_".join(words[start:]) for start in range(len(words)))
        if topic := next((ending for ending in endings if ending in KNOWN_TOPICS), ""):  # the longest
            known.append(TopicFile(path, stem[: len(stem) - len(topic)], topic, instance))
    if not known:
        raise LogError(
            f"{folder}: no PX4 topic among its files; "
            "expected names such as log_vehicle_attitude_0.csv, or give a mapping for CSV files of your own"
        )
    topics: dict[str, set[tuple[str, int]]] = {}
    for file in known:
        topics.setdefault(file.prefix, set()).add((file.topic, file.instance))
    # the prefix that most topics have; of equals the shortest, as some topics end in another's name
    prefix = min(topics, key=lambda one: (-len(topics[one]), len(one), one))
    strays = [file for file in known if not file.path.name.startswith(prefix)]
    several = {p for p, own in topics.items() if p != prefix and len({topic for topic, _ in own}) > 1}
    several |= {file.prefix for file in strays if (file.topic, file.instance) in topics[prefix]}
    if several:
        names = ", ".join(sorted({prefix} | several)[:3])
        raise LogError(
            f"{folder}: more than one log ({names}); put the files of each log in a folder of its own"
        )
    named = [(path, *of) for path, of in stems.items() if path.name.startswith(prefix)]
    own = [TopicFile(path, prefix, stem[len(prefix) :], instance) for path, stem, instance in named]
    return sorted([*own, *strays], key=lambda file: (file.topic, file.instance))
