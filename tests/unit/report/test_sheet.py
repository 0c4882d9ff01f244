"""Pages of studies: complete, self-contained, deaf to hostile text."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest

from stoop.errors import OutputError
from stoop.report.plots import plot
from stoop.report.series import Series
from stoop.report.sheet import (
    Code,
    Details,
    Figure,
    Prose,
    Section,
    Sheet,
    Table,
    mathml,
    render_sheet,
    write_sheet,
)

HOSTILE = '<script>alert("x")</script>&amp;'
LONG = "long " * 9


def sheet(*parts: Prose | Code | Table | Figure, title: str = "One") -> Sheet:
    return Sheet("A page", "What it says.", (Section(title, parts),))


def body(html: str) -> ET.Element:
    """Return the body as a tree: what is not closed, or not escaped, does not parse."""
    return ET.fromstring(html[html.index("<body>") : html.index("</html>")])  # noqa: S314 - our own


def test_whatever_is_said_stays_text() -> None:
    drawn = plot([Series(HOSTILE, np.arange(3.0), np.arange(3.0))] * 2, HOSTILE, HOSTILE, HOSTILE)
    table = Table(HOSTILE, (HOSTILE, "n"), ((HOSTILE, "1"),))
    parts = (Prose(HOSTILE + "\n- " + HOSTILE), Code(HOSTILE), table, Figure(HOSTILE, drawn))
    html = render_sheet(Sheet(HOSTILE, HOSTILE, (Section(HOSTILE, parts),)))
    assert "<script" not in html
    assert sum(HOSTILE in (element.text or "") for element in body(html).iter()) >= 9


def test_the_page_reaches_for_nothing_outside_itself_and_is_written_alike(tmp_path: Path) -> None:
    page = sheet(Prose("a"), Table("c", ("a",), (("1",),)))
    html = render_sheet(page)
    assert "default-src 'none'" in html
    for reach in ("http://", "https://", "src=", "@import", "url("):
        assert reach not in html
    write_sheet(page, tmp_path / "one.html")
    assert (tmp_path / "one.html").read_text("utf-8") == render_sheet(page)
    with pytest.raises(OutputError):
        write_sheet(sheet(), tmp_path / "no" / "page.html")


def test_prose_has_paragraphs_lists_and_code() -> None:
    text = "one\nstill one\n\ntwo:\n- first\n- second\nthree `a <b>` or `c`.\n- one ` alone"
    section = body(render_sheet(sheet(Prose(text)))).find(".//section")
    assert section is not None
    found = ["".join(e.itertext()) for e in section.iter() if e.tag in ("p", "li")]
    assert found == ["one still one", "two:", "first", "second", "three a <b> or c.", "one ` alone"]
    assert [e.text for e in section.iter("code")] == ["a <b>", "c"]


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


def test_a_long_last_column_stands_below_the_others_where_the_page_is_narrow() -> None:
    for row, folds in (
        (("1", "roll", "2.1", LONG), True), (("1", "roll", LONG), False), (("1", "roll", "2.1", "short"), False),
        (("1", LONG, "2.1", LONG), False), (("1", LONG, "2.1", "4"), False),
    ):  # fmt: skip
        (drawn,) = body(render_sheet(sheet(Table("", ("a",) * len(row), (row,))))).iter("table")
        assert ("folds" in str(drawn.get("class"))) == folds, row
        assert drawn.get("style") == (f"--beside: {len(row) - 1}" if folds else None)


def test_a_column_wraps_as_a_whole_and_a_cell_opens_a_table_of_its_own() -> None:
    """It looks as its summary does, and folds as a text does."""
    inner = Table("", ("flight",), (("<b>",), ("2",)))
    for head, rows, tag in (
        (("verdict", "what"), (("holds", "short"), ("holds", LONG)), "td"),
        (("way", "n"), ((LONG, "1"), ("short", "2")), "th"),
        (("n", "why"), (("1", Details(LONG, (inner,))),), "td"),
    ):
        drawn = body(render_sheet(sheet(Table("", head, rows))))
        cells = [one for one in drawn.iter(tag) if tag == "td" or one.get("scope") == "row"]
        if rows[0][0] == "1":
            (cell,) = cells = [one for one in cells if one.find("details") is not None]
            assert [one.text for one in cell.iter("th")] == ["flight", "<b>", "2"]
        assert {cell.get("class") for cell in cells} == {"wrap"}


def test_mathml_holds_nothing_but_mathematics() -> None:
    made = mathml(r"C_L = C_{L_0} + C_{L_q} \frac{q \bar{c}}{2 V}", "block")
    assert made.startswith('<math display="block">')
    assert "<mfrac>" in made
    assert "&amp;" not in made
    for latex in (
        r"\text{<script>alert(1)</script>}", "<img src=x onerror=alert(1)>", r"\href{javascript:alert(1)}{x}",
        r"\frac{a}{", "a & b", r"\text{</math><script>}", r"\style{background:url(http://x)}{y}", "",
        r"\text{&lt;script&gt;}",
    ):  # fmt: skip
        made = str(mathml(latex))
        for forbidden in ("<script", "<img", "<a", "href=", "onerror=", "style=", "src="):
            assert forbidden not in made.replace("&lt;", ""), latex
    assert "a < b" not in str(mathml(r"\text{a < b}"))
