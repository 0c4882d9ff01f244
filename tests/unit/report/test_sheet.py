"""Pages of studies: complete, self-contained, deaf to hostile text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from stoop.errors import OutputError
from stoop.report.plots import plot
from stoop.report.series import Series
from stoop.report.sheet import Code, Details, Figure, Prose, Section, Sheet, Table, render_sheet, write_sheet

HOSTILE = '<script>alert("x")</script>&amp;'


def sheet(*parts: Prose | Code | Table | Figure, title: str = "One") -> Sheet:
    return Sheet("A page", "What it says.", (Section(title, parts),))


def body(html: str) -> ET.Element:
    """Return the body as a tree: what is not closed, or not escaped, does not parse."""
    return ET.fromstring(html[html.index("<body>") : html.index("</html>")])  # noqa: S314 - our own


def test_whatever_is_said_stays_text() -> None:
    import numpy as np

    drawn = plot([Series(HOSTILE, np.arange(3.0), np.arange(3.0))] * 2, HOSTILE, HOSTILE, HOSTILE)
    page = Sheet(
        HOSTILE,
        HOSTILE,
        (
            Section(
                HOSTILE,
                (
                    Prose(HOSTILE + "\n- " + HOSTILE),
                    Code(HOSTILE),
                    Table(HOSTILE, (HOSTILE, "n"), ((HOSTILE, "1"),)),
                    Figure(HOSTILE, drawn),
                ),
            ),
        ),
    )
    html = render_sheet(page)
    assert "<script" not in html
    assert sum(HOSTILE in (element.text or "") for element in body(html).iter()) >= 9


def test_the_page_reaches_for_nothing_outside_itself() -> None:
    html = render_sheet(sheet(Prose("a")))
    assert "default-src 'none'" in html
    for reach in ("http://", "https://", "src=", "@import", "url("):
        assert reach not in html


def test_prose_has_paragraphs_and_lists() -> None:
    tree = body(render_sheet(sheet(Prose("one\nstill one\n\ntwo:\n- first\n- second\nthree"))))
    section = tree.find(".//section")
    assert section is not None
    assert [e.text for e in section.iter() if e.tag in ("p", "li")] == [
        "one still one",
        "two:",
        "first",
        "second",
        "three",
    ]


def test_columns_of_numbers_are_flush_right() -> None:
    head = ("name", "cost", "ratio", "interval", "remark", "mixed", "power", "none")
    rows = (
        ("a", "1.5", "2.0×", "3–4", "9 of 10 ended elsewhere", "1", "1.2×10⁻⁷", "–"),
        ("b", "–", "−0.1×", "5–6", "", "best", "∞", "–"),
    )
    assert Table("", head, rows).numeric == (False, True, True, True, False, False, True, False)


def test_links_lead_to_sections_and_no_two_are_alike() -> None:
    sections = tuple(Section(title, ()) for title in ("Box N", "box n", "Ä", "Box n 2", "box-N"))
    tree = body(render_sheet(Sheet("t", "l", sections)))
    anchors = [e.get("id") for e in tree.iter("section")]
    assert len(set(anchors)) == 5
    assert [e.get("href") for e in tree.iter("a")] == [f"#{anchor}" for anchor in anchors]


def test_the_same_sheet_gives_the_same_bytes(tmp_path: Path) -> None:
    write_sheet(sheet(Table("c", ("a",), (("1",),))), tmp_path / "one.html")
    write_sheet(sheet(Table("c", ("a",), (("1",),))), tmp_path / "two.html")
    assert (tmp_path / "one.html").read_bytes() == (tmp_path / "two.html").read_bytes()


def test_a_folder_that_is_not_there_is_said(tmp_path: Path) -> None:
    with pytest.raises(OutputError):
        write_sheet(sheet(), tmp_path / "no" / "page.html")


def test_names_in_backticks_are_code() -> None:
    section = body(render_sheet(sheet(Prose("Ask `a <b>` or `c`.\n- one ` alone")))).find(".//section")
    assert section is not None
    assert [e.text for e in section.iter("code")] == ["a <b>", "c"]
    assert [e.text for e in section.iter("li")] == ["one ` alone"]


def test_a_column_wraps_as_a_whole() -> None:
    table = Table("", ("verdict", "what"), (("holds", "short"), ("holds", "long " * 12)))
    cells = list(body(render_sheet(sheet(table))).iter("td"))
    assert [cell.get("class") for cell in cells] == ["wrap", "wrap"]
    named = Table("", ("way", "n"), (("long " * 9, "1"), ("short", "2")))
    heads = [cell for cell in body(render_sheet(sheet(named))).iter("th") if cell.get("scope") == "row"]
    assert [cell.get("class") for cell in heads] == ["wrap", "wrap"]


@pytest.mark.parametrize(
    ("row", "folds"),
    [
        (("1", "roll", "2.1", "long " * 9), True),
        (("1", "roll", "long " * 9), False),  # there is room beside two columns
        (("1", "roll", "2.1", "short"), False),
        (("1", "long " * 9, "2.1", "long " * 9), False),
        (("1", "long " * 9, "2.1", "4"), False),
    ],
)
def test_a_long_last_column_stands_below_the_others_where_the_page_is_narrow(
    row: tuple[str, ...], folds: bool
) -> None:
    table = Table("", ("a",) * len(row), (row,))
    (drawn,) = body(render_sheet(sheet(table))).iter("table")
    assert ("folds" in str(drawn.get("class"))) == folds
    assert drawn.get("style") == (f"--beside: {len(row) - 1}" if folds else None)


def test_a_cell_opens_a_table_of_its_own() -> None:
    """It looks as its summary does, and folds as a text does."""
    inner = Table("", ("flight",), (("<b>",), ("2",)))
    table = Table("", ("n", "why"), (("1", Details("long " * 9, (inner,))),))
    (cell,) = (one for one in body(render_sheet(sheet(table))).iter("td") if one.find("details") is not None)
    assert cell.get("class") == "wrap"
    assert [one.text for one in cell.iter("th")] == ["flight", "<b>", "2"]
