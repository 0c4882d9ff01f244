"""CSV tables: what was written is read; what is damaged yields what is left, or one typed error."""

import gzip
import re
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stoop.errors import LogError
from stoop.logs import csv_tables, read
from stoop.logs.csv_tables import read_table


def table(rows: int = 50) -> bytes:
    lines = [f"{i},{0.1 * i!r},{-1.5 * i!r}" for i in range(rows)]
    return ("timestamp,x[0],x[1]\n" + "\n".join(lines) + "\n").encode()


def test_plain_and_gzipped_are_the_same(tmp_path: Path) -> None:
    packed = gzip.compress(table()[:400]) + gzip.compress(table()[400:]) + b"\0" * 9
    (tmp_path / "a.csv").write_bytes(table())
    (tmp_path / "a.csv.gz").write_bytes(packed)
    plain, packed_columns = read_table(tmp_path / "a.csv")[0], read_table(tmp_path / "a.csv.gz")[0]
    assert list(plain) == ["timestamp", "x[0]", "x[1]"]
    for name, values in plain.items():
        assert np.array_equal(values, packed_columns[name])
    (tmp_path / "a.csv").write_bytes(b'\xef\xbb\xbft, "x" ,y\r\n0,oops,2\r\n1,,2\r\n')
    columns, defects = read_table(tmp_path / "a.csv")
    assert list(columns) == ["t", "x", "y"]
    assert np.isnan(columns["x"]).all()
    assert [str(d) for d in defects] == ["a.csv x: 1 of 2 cells hold no number"]


def test_a_cut_text_loses_only_its_last_line_and_a_cut_archive_yields_what_is_left(tmp_path: Path) -> None:
    whole = table()
    path = tmp_path / "a.csv"
    for end in range(len(whole) - 40, len(whole)):
        path.write_bytes(whole[:end])
        columns, defects = read_table(path)
        assert columns["timestamp"].size == whole[:end].count(b"\n") - 1
        assert bool(defects) == (whole[end - 1 : end] != b"\n")
    whole, path, sizes = gzip.compress(table(2000)), tmp_path / "a.csv.gz", []
    for end in range(0, len(whole) - 1, 397):
        path.write_bytes(whole[:end])
        with suppress(LogError):
            columns, defects = read_table(path)
            assert any(d.kind == "truncated" for d in defects)
            sizes.append(columns["timestamp"].size)
    assert sizes == sorted(sizes)
    assert sizes[-1] > 1000
    path.write_bytes(whole + whole[:900] + bytes(90))  # a damaged member behind a sound one
    columns, (defect,) = read_table(path)
    assert (columns["timestamp"].size, defect.kind) == (2000, "corrupt")


def test_what_is_no_table_is_refused_in_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path, packed = tmp_path / "a.csv", tmp_path / "a.csv.gz"
    for content, words in (
        (b"", "empty"),
        (b"\n\n", "empty"),
        (b"a,b\n", "not a table of numbers, nothing stands below its header"),
        (b"a,b\n1,2,3\n4,5\n6,7,8,9\n", "line 4 has 4 cells, those before have 3"),
        (b"a;b\n1,5;2\n", "not separated by commas; save it with commas and decimal points"),
        (b"a\tb\n1\t2\n", "not separated by commas"),
        (b"\xff\xfe\x00\n1\n", "not a text table"),
        (b"a" * (2**20 + 10) + b"\n1\n", "4096 columns"),
    ):
        path.write_bytes(content)
        with pytest.raises(LogError, match=words) as caught:
            read_table(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
    with pytest.raises(LogError, match="cannot be read"):
        read_table(tmp_path)
    packed.write_bytes(gzip.compress(b"a,b,c,d\n" + b",,,\n" * 2_000_000))
    with pytest.raises(LogError, match="for a file that short"):
        read_table(packed)
    monkeypatch.setattr(csv_tables, "MAX_BYTES", 2**16)
    packed.write_bytes(gzip.compress(b"a,b\n" + b"1,2\n" * 10**5))
    with pytest.raises(LogError, match="MiB of text"):
        read_table(packed)
    monkeypatch.setattr(csv_tables, "MAX_ROWS", 40)
    path.write_bytes(table(50))
    with pytest.raises(LogError, match="more than 40 lines"):
        read_table(path)


CELLS = ["nan", "inf", "-inf", "Infinity", "1e400", "-1e400", "1e-400", "9" * 400, "-" + "9" * 900, "9" * 20, "x", "1_0",
         "0x10", "", "True", "NA", "null", "+5", "1.", ".5", "1d5", "\u00b2",
         "18446744073709551616", "- 1", "--1", "\t3"]  # fmt: skip


def test_a_number_is_read_alike_by_all_readers_of_text(tmp_path: Path) -> None:
    """A CSV file, a DataFlash text of few lines (read by Python), and one of many (by pandas)."""
    for cell in CELLS:
        (tmp_path / "a.csv").write_text("t,x\n0,1\n1," + cell + "\n2,3\n", encoding="utf-8")
        found = [read_table(tmp_path / "a.csv")[0]["x"][1]]
        for lines in (5, 60):
            rows = "".join(f"IMU, {1000 * i}, {cell if i == 3 else 1}\n" for i in range(lines))
            (tmp_path / "a.log").write_text(f"FMT, 130, 19, IMU, Qf, TimeUS,GyrX\n{rows}", encoding="utf-8")
            found.append(read(tmp_path / "a.log").streams["IMU"].columns["GyrX"][3])
        np.testing.assert_array_equal(found, found[0], err_msg=cell[:8])
        if len(cell) > 100:  # beyond float64, which pandas keeps as Python integers
            assert found[0] == float("-inf" if cell[0] == "-" else "inf")


FLOATS = st.floats().map(repr) | st.floats(width=32).map(lambda x: str(np.float32(x)))
NUMBERS = FLOATS | st.integers(-(2**63), 2**64 - 1).map(str)
EDGES = ["+nan", "-nan", "NaN", "+inf", " 1", "1 ", '"1"', "1\r", "#1", "e", "-", "1e", "1\v", "1e5.0", "nan1"]  # fmt: skip
ODD = st.sampled_from([*CELLS, *EDGES])


@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(data=st.data())
def test_numpy_reads_as_pandas(data: st.DataObject, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Cells, columns, defects and refusals, of sound tables and of such with odd cells and lines."""
    width = data.draw(st.integers(1, 4))
    cells = NUMBERS | ODD if data.draw(st.booleans()) else NUMBERS
    rows = data.draw(st.lists(st.lists(cells, min_size=width, max_size=width), max_size=8))
    if data.draw(st.booleans()) and rows:
        rows[data.draw(st.integers(0, len(rows) - 1))] = data.draw(st.lists(cells, max_size=5))
    header = ["t", "x", "x", "nan"][:width]
    text = "".join(",".join(row) + "\n" for row in [header, *rows])
    text = text[: data.draw(st.none() | st.integers(-3, -1))]
    path = tmp_path / "a.csv"
    path.write_text(text, encoding="utf-8", newline="")
    try:
        with monkeypatch.context() as patched:
            patched.setattr(csv_tables, "plain_numbers", lambda text, count: None)
            expected, found = read_table(path)
    except LogError as error:
        with pytest.raises(LogError, match=re.escape(str(error))):
            read_table(path)
        return
    columns, defects = read_table(path)
    assert (list(columns), defects) == (list(expected), found)
    for name, values in columns.items():
        np.testing.assert_allclose(values, expected[name], rtol=1e-15, atol=0.0)
