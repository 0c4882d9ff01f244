"""Logs drawn from the grammar of each format, with hostile numbers, names, sizes and clocks, as Hypothesis strategies.

They are written from the public specifications, not from the readers, so that they hold what a specification allows and no
writer of ours has written: nested and cyclic definitions, several instances, messages in any order, every width of number,
complex numbers, empty and nested arrays, links in circles, fill values and scales.

References
----------
PX4 Autopilot User Guide, "ULog File Format". ArduPilot, "Logging: DataFlash message definitions" (types and units of FMT,
FMTU, UNIT and MULT). RFC 4180 (comma-separated values).
"""

from __future__ import annotations

import io
import math
import struct
import warnings

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from hypothesis import strategies as st
from scipy.io import netcdf_file, savemat
from studies.robustness.hostile import FLOATS, SHARES, words
from studies.robustness.sample_logs import ARRAY_MAPPING, NETCDF_MAPPING, Sample, single

from stoop.base.variables import VARIABLES

ULOG_TYPES = {
    "int8_t": "b", "uint8_t": "B", "int16_t": "h", "uint16_t": "H", "int32_t": "i", "uint32_t": "I", "int64_t": "q",
    "uint64_t": "Q", "float": "f", "double": "d", "bool": "?", "char": "c",
}  # fmt: skip
PX4_TOPICS = {
    "vehicle_angular_velocity": "float[3] xyz", "sensor_combined": "float[3] gyro_rad;float[3] accelerometer_m_s2",
    "vehicle_attitude": "float[4] q;float[4] delta_q_reset",
    "vehicle_local_position": "float vx;float vy;float vz;bool v_xy_valid",
    "airspeed_validated": "float true_airspeed_m_s;float calibrated_airspeed_m_s", "actuator_servos": "float[8] control",
    "actuator_motors": "float[12] control", "actuator_outputs": "uint32_t noutputs;float[16] output",
}  # fmt: skip  #: topic -> its fields behind the time stamp, as PX4 writes them
DATAFLASH_TYPES = {
    "b": "b", "B": "B", "h": "h", "H": "H", "i": "i", "I": "I", "q": "q", "Q": "Q", "f": "f", "d": "d", "n": "4s", "N": "16s",
    "Z": "64s", "c": "h", "C": "H", "e": "i", "E": "I", "L": "i", "M": "B", "a": "64s", "g": "e",
}  # fmt: skip
ARDUPILOT = {
    "IMU": ("QBfffffff", "TimeUS,I,GyrX,GyrY,GyrZ,AccX,AccY,AccZ,T"), "ATT": ("Qccccc", "TimeUS,DesRoll,Roll,DesPitch,Pitch,Yaw"),
    "ARSP": ("QBfff", "TimeUS,I,Airspeed,DiffPress,Temp"), "RCOU": ("QHHHH", "TimeUS,C1,C2,C3,C4"),
    "XKF1": ("QBccCfff", "TimeUS,C,Roll,Pitch,Yaw,VN,VE,VD"), "PARM": ("QNff", "TimeUS,Name,Value,Default"),
    "MSG": ("QZ", "TimeUS,Message"),
}  # fmt: skip  #: message -> its types and columns
SYNC = bytes.fromhex("2f731320250cbb12")
USUAL = np.random.default_rng(1).normal(0.0, 0.3, 4000)  #: numbers that are not hostile
NAMES = ("time", "t", "gyro", "x", "y", "z", "q", "name", "acc", "data")
TYPES = ["f2", "f4", "f8", "i1", "u1", "i2", "u2", "i4", "u4", "i8", "u8", ">f4", ">i4", "?", "c8", "c16"]


def encoded(text: str) -> bytes:
    """Return a text as UTF-8, surrogates too."""
    return text.encode("utf-8", "surrogatepass")


class Choices:
    """Choices for a log, of which a share is hostile."""

    def __init__(self, draw) -> None:
        self.draw = draw
        self.share = draw(st.sampled_from(SHARES))

    def bad(self) -> bool:
        """Return whether the next choice is hostile."""
        return self.share > 0.0 and self.draw(st.integers(0, 99)) >= 100.0 * (1.0 - self.share)

    def upto(self, most: int) -> int:
        """Draw a number from zero to ``most``."""
        return self.draw(st.integers(0, most))

    def one(self, *options):
        """Draw one of some."""
        return self.draw(st.sampled_from(options))

    def some(self, options, least: int = 1, most: int | None = None) -> list:
        """Draw different ones of some."""
        return self.draw(st.lists(st.sampled_from(list(options)), min_size=least, max_size=most, unique=True))

    def word(self, usual: str) -> str:
        """Draw a name or text."""
        return self.draw(words) if self.bad() else usual

    def size(self, usual: int, most: int) -> int:
        """Draw a count or size that a file states."""
        return self.one(0, 1, most // 2, most - 1, most) if self.bad() else usual

    def numbers(self, letter: str, count: int) -> list:
        """Draw numbers of a letter of `struct`, a few of them hostile."""
        begin = self.upto(2000)
        usual, cells = USUAL[begin : begin + count], self.draw(
            st.lists(st.integers(0, max(count - 1, 0)), max_size=math.ceil(10 * self.share) if count else 0)
        )  # fmt: skip
        if letter in "efd":
            found, largest = usual.tolist(), {"e": 65504.0, "f": 3.4028234e38}.get(letter, math.inf)
            for place in cells:
                value = self.draw(st.sampled_from(FLOATS) | st.floats())
                found[place] = value if not abs(value) > largest else math.copysign(math.inf, value)
            return found
        bits = 8 * struct.calcsize(letter)
        low, high = (0, 2**bits - 1) if letter.isupper() else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        found = [int(1000 * abs(x)) % min(high, 2000) for x in usual]
        for place in cells:
            found[place] = self.one(low, high, 0, 1, high // 2)
        return found

    def packed(self, letters: str) -> bytes:
        """Draw the bytes of a row of numbers, flags and texts."""
        if self.bad():
            return self.draw(
                st.binary(min_size=struct.calcsize("<" + letters), max_size=struct.calcsize("<" + letters))
            )
        flags = [letter in "?c" for letter in letters]
        cells = (
            b"\1" if flag else struct.pack(f"<{x}", *self.numbers(x, 1))
            for x, flag in zip(letters, flags, strict=True)
        )
        return b"".join(cells)

    def clock(self, count: int, period: float) -> list[float]:
        """Draw times of samples [s], most of them rising."""
        start = self.one(0.0, 2.0, 1.7e9, 1.8e13) if self.bad() else 2.0
        times = [start + period * i for i in range(count)]
        for _ in range(self.upto(2) if self.bad() else 0):
            at, leap = self.upto(count - 1), self.one(-1e3, -period, 0.0, 60.0, 1e6, 1e12)
            times[at:] = self.one([t + leap for t in times[at:]], [times[at] + leap] * (count - at))
        return times

    def times(self) -> list[float]:
        """Draw the clock of a stream."""
        return self.clock(self.one(1, 2, 5, 60), self.one(0.004, 0.02, 0.1))

    def shuffled(self, rows: list[tuple[float, bytes]]) -> bytes:
        """Return messages in the order of their times, or seldom in another."""
        return b"".join(row for _, row in (rows if self.bad() else sorted(rows, key=lambda row: row[0])))


def stamp(seconds: float) -> int:
    """Return a time in microseconds as an unsigned integer."""
    return int(max(0, int(seconds * 1e6)) % 2**64)


def message(kind: str, content: bytes) -> bytes:
    """Return a message of a ULog."""
    return struct.pack("<HB", len(content) % 2**16, ord(kind)) + content[: 2**16 - 1]


def beside(d: Choices) -> bytes:
    """Draw a message of a ULog beside the data: information, a parameter, a text, a dropout, a sync mark."""
    kind, text = d.one(*"IMPQLCSO"), encoded(d.word("armed"))
    if kind in "IMPQ":
        letter = d.one("int32_t", "float", "char[5]", d.word("uint64_t"))
        key = encoded(f"{letter} {d.word('SYS_AUTOSTART')}")[:255]
        value = b"12345" if "char" in letter else d.packed(ULOG_TYPES.get(letter, "q"))
        head = {"M": b"\0", "Q": bytes([d.size(1, 255)])}.get(kind, b"")
        return message(kind, head + bytes([d.size(len(key), 255)]) + key + value)
    return message(kind, {
        "L": bytes([d.size(54, 255)]) + struct.pack("<Q", stamp(2.0)) + text,
        "C": bytes([54]) + struct.pack("<HQ", d.size(1, 65535), stamp(2.0)) + text,
        "S": SYNC, "O": struct.pack("<H", d.size(40, 65535)),
    }[kind])  # fmt: skip


def ulog_fields(d: Choices, names: list[str]) -> str:
    """Draw the fields of a topic; a type may be another topic, or the topic itself."""
    kinds = [*ULOG_TYPES, *(names if d.bad() else ())]
    counts = (d.size(0, 2**16) if d.bad() else d.one(0, 0, 3) for _ in range(1 + d.upto(4)))
    return ";".join(f"{d.one(*kinds)}{f'[{n}]' if n else ''} {d.word(f'f{i}')}" for i, n in enumerate(counts))


def ulog_letters(fields: str) -> str:
    """Return the letters of `struct` of the fields of a topic."""
    out = ""
    for field in fields.split(";"):
        kind, _, count = field.partition(" ")[0].partition("[")
        out += ULOG_TYPES.get(kind, "B") * min(
            int(count.rstrip("]") or 1) if count.rstrip("]").isdigit() else 1, 64
        )
    return out


@st.composite
def ulogs(draw) -> Sample:
    """Draw a ULog."""
    d = Choices(draw)
    names = [*d.some(PX4_TOPICS, 1, 4), *(d.word(f"topic_{i}") for i in range(d.upto(2)))]
    formats = {name: PX4_TOPICS.get(name) or ulog_fields(d, names) for name in names}
    out = b"ULog\x01\x12\x35" + bytes([d.size(1, 255)]) + struct.pack("<Q", stamp(2.0))
    if draw(st.booleans()):
        flags = d.one(bytes(16), bytes(8) + b"\1" + bytes(7))
        out += message("B", flags + struct.pack("<3Q", *(d.size(0, 2**64 - 1) for _ in range(3))))
    ends = ["" if d.bad() else ";" for _ in formats]
    parts = [
        message("F", encoded(f"{name}:uint64_t timestamp;{fields}{end}"))
        for (name, fields), end in zip(formats.items(), ends, strict=True)
    ]
    parts += [beside(d) for _ in range(d.upto(3))]
    data = []
    for i, (name, fields) in enumerate(formats.items()):
        for instance in range(1 + d.bad()):
            head = struct.pack("<H", d.size(2 * i + instance, 65535))
            parts.append(message("A", bytes([instance]) + head + encoded(name)))
            rows = [d.packed(ulog_letters(fields)) for _ in range(3)]
            data += [
                (t, message("D", head + struct.pack("<Q", stamp(t)) + rows[k % 3]))
                for k, t in enumerate(d.times())
            ]
    data += [(draw(st.floats(2.0, 3.0)), beside(d)) for _ in range(d.upto(3))]
    if d.bad():
        parts = draw(st.permutations(parts))
    return single("a.ulg", out + b"".join(parts) + d.shuffled(data), "ulog")


def dataflash_kinds(d: Choices) -> dict[str, tuple[str, list[str]]]:
    """Draw messages: their types and columns."""
    chosen = {name: (ARDUPILOT[name][0], ARDUPILOT[name][1].split(",")) for name in d.some(ARDUPILOT, 1, 5)}
    for i in range(d.upto(2)):
        letters = "Q" + d.draw(st.text(st.sampled_from(sorted(DATAFLASH_TYPES)), min_size=1, max_size=14))
        chosen[d.word(f"T{i}")] = letters, ["TimeUS", *(d.word(f"c{k}") for k in range(len(letters) - 1))]
    return chosen


def dataflash_rows(d: Choices, letters: str, columns: list[str]) -> list[tuple[float, list]]:
    """Draw the samples of a message: time and cells."""
    times, clock = d.times(), not d.bad()
    cells = [
        [stamp(t) for t in times] if clock and column == "TimeUS"
        else [d.word("ABC")] * len(times) if letter in "nNZa" else d.numbers(DATAFLASH_TYPES[letter], len(times))
        for letter, column in zip(letters, columns, strict=True)
    ]  # fmt: skip
    return [(t, list(row)) for t, row in zip(times, zip(*cells, strict=True), strict=True)]


def definition(kind: int, size: int, name: str, letters: str, columns: str) -> bytes:
    """Return a message that defines messages of DataFlash."""
    return b"\xa3\x95\x80" + struct.pack(
        "<BB4s16s64s", kind, size, encoded(name), encoded(letters), encoded(columns)
    )


def dataflash_units(d: Choices, kinds: dict) -> bytes:
    """Draw units, multipliers and, of each kind of messages, the marks of its columns; "#" numbers the instance."""
    out = definition(200, 76, "UNIT", "QbZ", "TimeUS,Id,Label") + definition(
        201, 20, "MULT", "Qbd", "TimeUS,Id,Mult"
    )
    out += definition(202, 44, "FMTU", "QBNN", "TimeUS,FmtType,UnitIds,MultIds")
    for mark, label in (("s", "s"), ("E", "rad/s"), ("#", "instance")):
        out += b"\xa3\x95\xc8" + struct.pack("<Qb64s", 0, ord(mark), encoded(d.word(label)))
    for mark, factor in (("F", 1e-6), ("0", 1.0), ("-", 0.0)):
        out += b"\xa3\x95\xc9" + struct.pack("<Qbd", 0, ord(mark), d.one(*FLOATS) if d.bad() else factor)
    for number, (_, columns) in enumerate(kinds.values(), 129):
        numbered = d.upto(len(columns) - 1) if d.bad() else 1
        marks = "".join("#" if i == numbered else d.one(*"sE-?") for i in range(len(columns)))
        factors = "".join(d.one(*"F0-") for _ in columns)
        out += b"\xa3\x95\xca" + struct.pack(
            "<QB16s16s", 0, d.size(number, 255), marks.encode(), factors.encode()
        )
    return out


@st.composite
def dataflashes(draw) -> Sample:
    """Draw a DataFlash log of ArduPilot."""
    d = Choices(draw)
    kinds = dataflash_kinds(d)
    out, data = definition(128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"), []
    for i, (name, (letters, columns)) in enumerate(kinds.items(), 129):
        layout, kind = "<" + "".join(DATAFLASH_TYPES[letter] for letter in letters), d.size(i, 255)
        out += definition(
            kind, d.size(3 + struct.calcsize(layout), 255) % 256, name, letters, ",".join(columns)
        )
        for t, row in dataflash_rows(d, letters, columns):
            cells = [encoded(cell) if isinstance(cell, str) else cell for cell in row]
            data.append((t, b"\xa3\x95" + bytes([kind]) + struct.pack(layout, *cells)))
    return single(
        "a.bin",
        out + (dataflash_units(d, kinds) if draw(st.booleans()) else b"") + d.shuffled(data),
        "dataflash",
    )


def lines(d: Choices, rows: list[list]) -> bytes:
    """Write rows as text, some cells in odd ways; the last line seldom has no end."""
    for _ in range(d.upto(3) if d.bad() else 0):
        row = rows[d.upto(len(rows) - 1)]
        row[d.upto(len(row) - 1)] = d.one(
            f"1{'0' * 400}", "0x10", "1_0", "1,5", '"', "1e400", "", "true", "-"
        )
    return encoded("\n".join(",".join(map(str, row)) for row in rows) + ("" if d.bad() else "\n"))


@st.composite
def dataflash_texts(draw) -> Sample:
    """Draw a DataFlash log as text."""
    d = Choices(draw)
    rows = [["FMT", 128, 89, "FMT", "BBnNZ", "Type,Length,Name,Format,Columns"]]
    for i, (name, (letters, columns)) in enumerate(dataflash_kinds(d).items(), 129):
        rows.append(["FMT", d.size(i, 10**6), d.size(50, 255), name, letters, *columns])
        rows += [[name, *(f" {cell}" for cell in row)] for _, row in dataflash_rows(d, letters, columns)]
    return single("a.log", lines(d, rows), "lines")


@st.composite
def tables(draw) -> Sample:
    """Draw a table of comma-separated values with its mapping."""
    d = Choices(draw)
    names = d.some(VARIABLES, 1, 12)
    times = d.clock(d.one(1, 2, 5, 60, 400), d.one(0.01, 0.02, 0.1))
    labels = [d.word(name) for name in names]
    rows = [["t", *labels], *map(list, zip(times, *(d.numbers("d", len(times)) for _ in names), strict=True))]
    mapping = ["[time]", 'column = "t"', f'unit = "{d.word("s")}"', "[variables]"]
    for name, label in zip(names, labels, strict=True):
        key = (
            label.replace("\\", "").replace('"', "").encode("unicode_escape").decode().replace("\\x", "\\u00")
        )
        mapping.append(f'{name} = {{ column = "{key}", unit = "{VARIABLES[name].unit}" }}')
    return single("a.csv", lines(d, rows), "lines", encoded("\n".join(mapping)))


def array(d: Choices, count: int):
    """Draw an array of any type of number, of ``count`` samples or of another shape."""
    shape = d.one(
        (count,), (count, 1), (1, count), (count, 3), (3, count), (0,), (), (2, 2, count), (3, 1, count), (count, 80)
    )  # fmt: skip
    size = math.prod(shape)
    numbers = d.numbers("d", min(size, 400)) + [0.5] * max(size - 400, 0)
    with np.errstate(all="ignore"):
        return np.array(numbers).astype(d.one(*TYPES)).reshape(shape)


def motion(d: Choices, count: int) -> dict:
    """Draw a clock and a gyroscope, so that most files are read."""
    gyro = {f"gyro.{axis}": np.array(d.numbers("f", count)) for axis in "xyz"}
    return {"time": np.array(d.clock(count, 0.02)), **gyro}


def matlab_value(d: Choices, count: int, depth: int):
    """Draw what SciPy writes into a MATLAB file."""
    kind = d.upto(7)
    if kind == 0 and depth < 4:
        return {d.one(*NAMES): matlab_value(d, count, depth + 1) for _ in range(1 + d.upto(2))}
    if kind == 1:
        return d.word("text")
    if kind == 2 and depth < 4:
        cells = np.empty(d.upto(3), dtype=object)
        for i in range(len(cells)):
            cells[i] = matlab_value(d, count, depth + 1)
        return cells
    if kind == 3:
        return np.array([(1.0, 2)] * d.upto(3), dtype=[("x", "f8"), ("n", "i4")])
    return array(d, count)


@st.composite
def matlabs(draw) -> Sample:
    """Draw a MATLAB file of version 5."""
    d = Choices(draw)
    count = d.one(1, 2, 50)
    tree = {d.one(*NAMES): matlab_value(d, count, 0) for _ in range(d.upto(5))}
    known = motion(d, count)
    tree |= {"time": known.pop("time"), "gyro": {name[-1]: x for name, x in known.items()}}
    sink = io.BytesIO()
    savemat(sink, tree, do_compression=draw(st.booleans()), oned_as=d.one("row", "column"))
    undated = (
        b"MATLAB 5.0 MAT-file".ljust(116) + sink.getvalue()[116:]
    )  # the first line says when it was written
    return single("a.mat", undated, "matlab", ARRAY_MAPPING)


def grow(d: Choices, group, count: int, depth: int) -> None:
    """Fill a group of HDF5."""
    for name in d.some([*NAMES, *(f"{name}{i}" for i, name in enumerate(NAMES))], 0, 4):
        kind = d.upto(8)
        if name in group:
            continue
        if kind == 0 and depth < 4:
            grow(d, group.create_group(name), count, depth + 1)
        elif kind == 1:
            group[name] = d.one(
                h5py.SoftLink("/"), h5py.SoftLink("/none"), h5py.ExternalLink("/etc/passwd", "/")
            )
        elif kind == 2:
            group[name] = group  # a circle
        elif kind == 3:
            group.create_dataset(name, data=np.array(["a", "b"] * 3, dtype=object), dtype=h5py.string_dtype())
        elif kind == 4:
            group.create_dataset(name, data=h5py.Empty("f8"))
        else:
            data = array(d, count)
            plain = data.ndim and data.size and data.dtype.kind in "fiu"
            made = group.create_dataset(
                name, data=data, **({"compression": "gzip", "fillvalue": 1} if plain else {})
            )
            made.attrs["units"] = np.bytes_(encoded(d.word("rad/s")) or b" ")


@st.composite
def hdf5s(draw) -> Sample:
    """Draw an HDF5 file, as MATLAB 7.3 and netCDF 4 write them."""
    d, sink = Choices(draw), io.BytesIO()
    count = d.one(1, 2, 50)
    with h5py.File(sink, "w") as file:
        for name, values in motion(d, count).items():
            file[name.replace(".", "/")] = values
        grow(d, file, count, 0)
    return single("a.h5", sink.getvalue(), "hdf5", ARRAY_MAPPING)


@st.composite
def netcdfs(draw) -> Sample:
    """Draw a netCDF 3 file."""
    d = Choices(draw)
    count, length = d.one(1, 2, 50), draw(st.booleans())
    letters, variables = {"f4": "f", "f8": "d", "i1": "b", "i2": "h", "i4": "i", "S1": ""}, {}
    for name, kind in {
        "time": "f8",
        "q": "f8",
        **{n: d.one(*letters) for n in d.some(NAMES[1:], 3, 3)},
    }.items():
        known = motion(d, count)["time" if name == "time" else "gyro.x"]
        keys = (
            d.some(("scale_factor", "add_offset", "_FillValue", "missing_value"), 2, 2)
            if kind != "S1"
            else ()
        )
        attributes = {key: d.numbers(letters[kind] if key == "_FillValue" else "d", 1)[0] for key in keys}
        attributes["units"] = d.word("rad/s").encode("utf-8", "replace")
        with np.errstate(all="ignore"):
            variables[name] = np.full(count, b"a") if kind == "S1" else known.astype(kind), kind, attributes
    return single("a.nc", netcdf_bytes(variables, count if length else None), "words", NETCDF_MAPPING)


def netcdf_bytes(variables: dict, length: int | None) -> bytes:
    """Write variables of one dimension: values, type and attributes."""
    sink = io.BytesIO()
    file = netcdf_file(sink, "w")
    file.createDimension("time", length)
    with warnings.catch_warnings():  # of attributes that do not fit; closing writes once more
        warnings.simplefilter("ignore")
        for name, (values, kind, attributes) in variables.items():
            variable = file.createVariable(name, kind, ("time",))
            variable[:] = values
            for key, value in attributes.items():
                setattr(variable, key, value)
        file.flush()
        content = sink.getvalue()
        file.close()
    return content


@st.composite
def parquets(draw) -> Sample:
    """Draw a Parquet file."""
    d, sink = Choices(draw), io.BytesIO()
    count = d.one(0, 1, 2, 50)
    known = motion(d, max(count, 1))
    columns = {name: known[name][:count] for name in ("time", "gyro.x")}
    struct_of_x = pa.struct([("x", pa.float64())])
    kinds = (
        lambda: pa.array([None] * count, pa.null()),
        lambda: pa.array([d.word("a").encode("utf-8", "replace")] * count, pa.binary()),
        lambda: pa.array([[0.5] * (i % 4) for i in range(count)], pa.list_(pa.float64())),
        lambda: pa.array(
            [{"x": 1.0, "y": "a"}] * count, pa.struct([("x", pa.float64()), ("y", pa.string())])
        ),
        lambda: pa.array(d.numbers("q", count), pa.timestamp(d.one("ms", "us", "ns"))),
        lambda: pa.array([{"x": x} if x < 0.2 else None for x in d.numbers("d", count)], struct_of_x),
        lambda: pa.array([[0.5, x] for x in d.numbers("d", count)], pa.list_(pa.float64(), 2)),
        lambda: pa.array(([None, 1, 7] * count)[:count], pa.decimal128(12, 3)),
        lambda: pa.array(["a"] * count).dictionary_encode(),
        lambda: pa.array([True] * count),
        lambda: pa.array(np.zeros(count, "f2")),
        lambda: pa.array(d.numbers("Q", count), pa.uint64()),
    )
    for i in range(d.upto(4)):
        columns[d.one(*NAMES) + d.one("", str(i), str(i))] = d.one(*kinds)()
    pq.write_table(pa.table(columns), sink, compression=d.one("none", "snappy", "zstd", "gzip"))
    return single("a.parquet", sink.getvalue(), "parquet", ARRAY_MAPPING)


DRAWN = {
    "ulog": ulogs(), "dataflash": dataflashes(), "dataflash-text": dataflash_texts(), "csv": tables(), "matlab": matlabs(),
    "hdf5": hdf5s(), "netcdf": netcdfs(), "parquet": parquets(),
}  # fmt: skip  #: format -> its logs
