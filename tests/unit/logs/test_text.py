"""CSV tables: what was written is read; what is damaged yields what is left, or one typed error."""

from __future__ import annotations

import gzip
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stoop.base.arrays import FloatArray
from stoop.errors import LogError
from stoop.logs import csv_tables, read
from stoop.logs.csv_tables import read_table
from stoop.logs.recording import Defect

any_file = settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@contextmanager
def refusal_in_one_line() -> Iterator[None]:
    """Let a typed error pass, if it is one line."""
    try:
        yield
    except LogError as error:
        if "\n" in str(error):
            raise AssertionError(error) from error


def table(rows: int = 50) -> bytes:
    lines = [f"{i},{0.1 * i!r},{-1.5 * i!r}" for i in range(rows)]
    return ("timestamp,x[0],x[1]\n" + "\n".join(lines) + "\n").encode()


@any_file
@given(st.lists(st.tuples(st.floats(allow_nan=True), st.floats(-1e300, 1e300)), min_size=1, max_size=20))
def test_numbers_survive_the_round_trip(tmp_path: Path, rows: list[tuple[float, float]]) -> None:
    path = tmp_path / "a.csv"
    path.write_text("a,b\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows))
    columns, defects = read_table(path)
    # pandas may be off in the last digit, depending on its version
    np.testing.assert_allclose(np.column_stack([columns["a"], columns["b"]]), np.array(rows), rtol=1e-15)
    assert defects == ()


def test_plain_and_gzipped_are_the_same(tmp_path: Path) -> None:
    (tmp_path / "a.csv").write_bytes(table())
    (tmp_path / "a.csv.gz").write_bytes(
        gzip.compress(table()[:400]) + gzip.compress(table()[400:]) + b"\0" * 9
    )
    plain, packed = read_table(tmp_path / "a.csv")[0], read_table(tmp_path / "a.csv.gz")[0]
    assert list(plain) == ["timestamp", "x[0]", "x[1]"]
    for name, values in plain.items():
        assert np.array_equal(values, packed[name])


def test_a_cut_text_loses_only_its_last_line(tmp_path: Path) -> None:
    whole = table()
    path = tmp_path / "a.csv"
    for end in range(len(whole) - 40, len(whole)):
        path.write_bytes(whole[:end])
        columns, defects = read_table(path)
        assert columns["timestamp"].size == whole[:end].count(b"\n") - 1
        assert bool(defects) == (whole[end - 1 : end] != b"\n")


def test_a_cut_archive_yields_what_is_left_or_says_so(tmp_path: Path) -> None:
    whole = gzip.compress(table(2000))
    path = tmp_path / "a.csv.gz"
    sizes = []
    for end in range(0, len(whole) - 1, 97):
        path.write_bytes(whole[:end])
        try:
            columns, defects = read_table(path)
        except LogError:
            continue
        assert any(d.kind == "truncated" for d in defects)
        sizes.append(columns["timestamp"].size)
    assert sizes == sorted(sizes)
    assert sizes[-1] > 1000


@any_file
@given(st.binary(max_size=200), st.booleans())
def test_any_bytes_give_a_table_or_a_log_error(tmp_path: Path, content: bytes, packed: bool) -> None:
    path = tmp_path / ("a.csv.gz" if packed else "a.csv")
    path.write_bytes(gzip.compress(content) if packed else content)
    with refusal_in_one_line():
        columns, _ = read_table(path)
        assert len({values.size for values in columns.values()}) <= 1


@any_file
@given(st.integers(0, 10**6), st.integers(0, 255))
def test_a_damaged_archive_raises_nothing_else(tmp_path: Path, place: int, byte: int) -> None:
    content = bytearray(gzip.compress(table(200)))
    content[place % len(content)] = byte
    path = tmp_path / "a.csv.gz"
    path.write_bytes(content)
    with refusal_in_one_line():
        read_table(path)


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "empty"),
        (b"\n\n", "empty"),
        (b"a,b\n", "not a table of numbers, nothing stands below its header"),
        (b"a,b\n1,2,3\n4,5\n6,7,8,9\n", "line 4 has 4 cells, those before have 3"),
        (b"a;b\n1,5;2\n", "not separated by commas; save it with commas and decimal points"),
        (b"a\tb\n1\t2\n", "not separated by commas"),
        (b"\xff\xfe\x00\n1\n", "not a text table"),
        (b"a" * (2**20 + 10) + b"\n1\n", "4096 columns"),
    ],
)
def test_what_is_no_table_is_refused_in_one_line(tmp_path: Path, content: bytes, words: str) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(content)
    with pytest.raises(LogError, match=words) as caught:
        read_table(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_an_archive_that_unfolds_without_end_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(csv_tables, "MAX_BYTES", 2**16)
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(b"a,b\n" + b"1,2\n" * 10**6))
    with pytest.raises(LogError, match="MiB of text"):
        read_table(path)


def test_too_many_lines(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(csv_tables, "MAX_ROWS", 40)
    (tmp_path / "a.csv").write_bytes(table(50))
    with pytest.raises(LogError, match="more than 40 lines"):
        read_table(tmp_path / "a.csv")


def test_cells_without_a_number_become_nan_and_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("t,x\n0,1\n1,oops\n2,\n3,4\n")
    columns, defects = read_table(path)
    assert np.array_equal(columns["x"], [1.0, np.nan, np.nan, 4.0], equal_nan=True)
    assert [str(d) for d in defects] == ["a.csv x: 1 of 4 cells hold no number"]


@pytest.mark.parametrize("sign", ["", "-"])
def test_whole_numbers_beyond_float64_are_infinite(tmp_path: Path, sign: str) -> None:
    """pandas keeps them as Python integers, which numpy cannot hold."""
    path, large = tmp_path / "a.csv", f"{sign}1{400 * '0'}"
    path.write_text(f"t,x\n0,1\n1,{large}\n2,3\n")
    columns, defects = read_table(path)
    assert columns["x"].tolist() == [1.0, float(f"{sign}inf"), 3.0]
    assert [str(d) for d in defects] == []
    log = tmp_path / "a.log"
    rows = "".join(f"IMU, {1000 * i}, {large if i == 7 else i}\n" for i in range(60))
    log.write_text(f"FMT, 130, 19, IMU, Qf, TimeUS,GyrX\n{rows}")
    gyro = read(log).streams["IMU"].columns["GyrX"]
    assert gyro[6:9].tolist() == [6.0, float(f"{sign}inf"), 8.0]


CELLS = ["nan", "inf", "-inf", "Infinity", "1e400", "-1e400", "1e-400", "9" * 400, "-" + "9" * 900, "9" * 20, "x", "1_0",
         "0x10", "", "True", "NA", "null", "+5", "1.", ".5", "1d5", "\u00b2",
         "18446744073709551616", "- 1", "--1", "\t3"]  # fmt: skip


@pytest.mark.parametrize("cell", CELLS, ids=[cell[:8] for cell in CELLS])
def test_a_number_is_read_alike_by_all_readers_of_text(cell: str, tmp_path: Path) -> None:
    """A CSV file, a DataFlash text of few lines (read by Python), and one of many (by pandas)."""
    (tmp_path / "a.csv").write_text("t,x\n0,1\n1," + cell + "\n2,3\n", encoding="utf-8")
    found = [read_table(tmp_path / "a.csv")[0]["x"][1]]
    for lines in (5, 60):
        rows = "".join(f"IMU, {1000 * i}, {cell if i == 3 else 1}\n" for i in range(lines))
        (tmp_path / "a.log").write_text(f"FMT, 130, 19, IMU, Qf, TimeUS,GyrX\n{rows}", encoding="utf-8")
        found.append(read(tmp_path / "a.log").streams["IMU"].columns["GyrX"][3])
    np.testing.assert_array_equal(found, found[0])


def test_header_is_stripped(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_bytes(b'\xef\xbb\xbft, "x" ,y\r\n0,1,2\r\n')
    assert list(read_table(path)[0]) == ["t", "x", "y"]


def test_a_folder_in_place_of_a_file(tmp_path: Path) -> None:
    with pytest.raises(LogError, match="cannot be read"):
        read_table(tmp_path)


def test_a_short_archive_of_many_numbers(tmp_path: Path) -> None:
    path = tmp_path / "a.csv.gz"
    path.write_bytes(gzip.compress(b"a,b,c,d\n" + b",,,\n" * 2_000_000))
    with pytest.raises(LogError, match="for a file that short"):
        read_table(path)


def by_pandas(
    path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[dict[str, FloatArray], tuple[Defect, ...]]:
    with monkeypatch.context() as patched:
        patched.setattr(csv_tables, "plain_numbers", lambda text, count: None)
        return read_table(path)


FLOATS = st.floats().map(repr) | st.floats(width=32).map(lambda x: str(np.float32(x)))
NUMBERS = FLOATS | st.integers(-(2**63), 2**64 - 1).map(str)
ODD = st.sampled_from(
    [
        *CELLS,
        "+nan",
        "-nan",
        "NaN",
        "+inf",
        " 1",
        "1 ",
        '"1"',
        "1\r",
        "#1",
        "e",
        "-",
        "1e",
        "1\v",
        "1e5.0",
        "nan1",
    ]
)


@any_file
@given(data=st.data())
def test_what_numpy_reads_is_what_pandas_reads(
    data: st.DataObject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Cells, columns, defects and refusals, of sound tables and of such with odd cells and lines."""
    width = data.draw(st.integers(1, 4))
    cells = NUMBERS | ODD if data.draw(st.booleans()) else NUMBERS
    rows = data.draw(st.lists(st.lists(cells, min_size=width, max_size=width), max_size=8))
    if data.draw(st.booleans()) and rows:
        rows[data.draw(st.integers(0, len(rows) - 1))] = data.draw(st.lists(cells, max_size=5))
    header = ["t", "x", "x", "nan"][:width]
    text = "".join(",".join(row) + "\n" for row in [header, *rows])[
        : data.draw(st.none() | st.integers(-3, -1))
    ]
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8", newline="")
    try:
        expected, found = by_pandas(path, monkeypatch)
    except LogError as error:
        with pytest.raises(LogError, match=re.escape(str(error))):
            read_table(path)
        return
    columns, defects = read_table(path)
    assert (list(columns), defects) == (list(expected), found)
    for name, values in columns.items():
        np.testing.assert_allclose(values, expected[name], rtol=1e-15, atol=0.0)


LONG = b"t,x\n" + b"1" * (csv_tables.MAX_LINE + 1) + b",2\n"


@pytest.mark.parametrize("text", [b"t,x\n0,1\n1,nan\n2,-inf\n", b"t,x\n\n0,1\n\n"])
def test_tables_of_numbers_are_left_to_numpy(text: bytes) -> None:
    assert csv_tables.plain_numbers(text, 2) is not None


@pytest.mark.parametrize(
    "text",
    [
        b"t,x\n0,1\n1,\n",
        b"t,x\n0,oops\n",
        b"t,x\n",
        b"t,x",
        b"t,x\n\n\n",
        b"t,x\n0,1,2\n",
        b"t,x\n0,1\n2\n",
        LONG,
    ],
)
def test_other_tables_are_not(text: bytes) -> None:
    assert csv_tables.plain_numbers(text, 2) is None
