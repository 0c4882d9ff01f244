"""Pages of studies: complete, self-contained, deaf to hostile text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import pytest

from stoop.errors import OutputError
from stoop.report.plots import Series, plot
from stoop.report.sheet import Code, Figure, Prose, Section, Sheet, Table, render_sheet, write_sheet

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
