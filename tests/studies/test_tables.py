"""Tables: the same bytes everywhere, readable by anyone."""

from __future__ import annotations

import csv
import io

import pytest

from stoop.base.csv_text import csv_text


def test_cells_are_plain_and_quoted_where_needed() -> None:
    text = csv_text(("a", "b"), [("x, y", 1.0 / 3.0), ('say "no"', None), (True, 12)])
    assert text == 'a,b\r\n"x, y",0.3333333333\r\n"say ""no""",\r\nyes,12\r\n'


def test_a_reader_gets_back_what_was_written() -> None:
    rows = [("line\nbreak", "1e-14"), ("", "µ")]
    assert list(csv.reader(io.StringIO(csv_text(("p", "q"), rows), newline=""))) == [
        ["p", "q"],
        *map(list, rows),
    ]


def test_a_row_of_another_width_is_a_mistake() -> None:
    with pytest.raises(ValueError, match="a row of 1 cells under 2 names"):
        csv_text(("a", "b"), [("x",)])
