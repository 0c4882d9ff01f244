"""Pages of studies and plots: complete, self-contained, deaf to hostile text, data at the right pixels."""

import re
import xml.etree.ElementTree as ET
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from stoop.base.arrays import FloatArray
from stoop.errors import OutputError
from stoop.report import sheet as sheets
from stoop.report.plots import FLOOR, HEIGHT, LEFT, RIGHT, TOP, WIDTH, plot, stacked_plots
from stoop.report.series import Series, Shade, Strip, thinned
from stoop.report.sheet import Code, Details, Figure, Prose, Section, Sheet, Table, mathml, render_sheet

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
    sheets.write_sheet(page, tmp_path / "one.html")
    assert (tmp_path / "one.html").read_text("utf-8") == render_sheet(page)
    with pytest.raises(OutputError):
        sheets.write_sheet(sheet(), tmp_path / "no" / "page.html")


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


BOX = WIDTH - LEFT - RIGHT
SVG = "{http://www.w3.org/2000/svg}"


def tree(html: str) -> ET.Element:
    return ET.fromstring(f'<div xmlns="http://www.w3.org/2000/svg">{html}</div>')  # noqa: S314 - our own


def paths(html: str, color: str) -> list[FloatArray]:
    """Return the points (k, 2) of each path of a color, px from the upper left corner of the box."""
    found = [e for e in tree(html).iter(f"{SVG}path") if f"stroke: var(--{color})" in e.get("style", "")]
    points = (np.array(re.findall(r"-?[\d.]+", e.get("d", "")), dtype=float).reshape(-1, 2) for e in found)
    return [at - (LEFT, TOP) for at in points]


def texts(html: str) -> list[str]:
    return [e.text or "" for e in tree(html).iter(f"{SVG}text")]


def keys(html: str) -> list[str]:
    return ["".join(e.itertext()) for e in tree(html).iter(f"{SVG}li")]


def test_points_are_where_the_axes_say() -> None:
    one = Series("a", np.array([0.0, 5.0, 10.0]), np.array([0.0, 1.0, 3.0]))
    (drawn,) = paths(plot([one], "x", "y", "d", x_range=(0.0, 10.0), y_range=(0.0, 4.0)), "hue0")
    expected = np.array([[0.0, HEIGHT], [BOX / 2, 0.75 * HEIGHT], [BOX, HEIGHT / 4]])
    assert drawn == pytest.approx(expected, abs=0.11)
    one = Series("a", np.array([0.0, 1.0, 2.0]), np.array([0.0, 1.0, 1.0]), "steps")
    (drawn,) = paths(plot([one], "x", "y", "d", x_range=(0.0, 2.0), y_range=(0.0, 1.0)), "hue0")
    corners = [[0, HEIGHT], [BOX / 2, HEIGHT], [BOX / 2, 0], [BOX, 0]]
    assert list(dict.fromkeys(map(tuple, drawn.tolist()))) == list(map(tuple, corners))


def test_logarithmic_axes_give_every_decade_the_same_room() -> None:
    one = Series("a", np.array([1.0, 10.0, 100.0, -1.0]), np.array([1e-6, 1e-3, 2.0, 1.0]))
    html = plot([one], "x", "y", "d", log_x=True, log_y=True, x_range=(1.0, 100.0), y_range=(1e-6, 1.0))
    (drawn,) = paths(html, "hue0")
    assert drawn[:2] == pytest.approx(np.array([[0.0, HEIGHT], [BOX / 2, HEIGHT / 2]]), abs=0.11)
    assert {"1", "10", "100", "10⁻³", "10⁻⁶"} <= set(texts(html))


def test_twenty_series_all_look_different_and_are_named() -> None:
    html = plot([Series(f"s{i}", np.arange(4.0), np.arange(4.0) + i) for i in range(20)], "x", "y", "twenty")
    assert len({e.get("style") for e in tree(html).iter(f"{SVG}line")}) == 20
    assert keys(html) == [f"s{i}" for i in range(20)]
    dashes = {e.get("style", "") for e in tree(html).iter(f"{SVG}path") if "var(--hue" in e.get("style", "")}
    assert len({re.sub("-0", "", dash) for dash in dashes}) == 20


def test_hardly_any_data_and_a_range_that_is_no_interval_still_make_a_drawing() -> None:
    for values in ([], [np.nan], [np.inf, 1.0], [3.0], [0.0, 0.0], [-1.0, 0.0], [1e300, 0.0]):
        array = np.array(values)
        for log in (False, True):
            html = plot([Series("a", array, array, "steps")], "x", "y", "d", log_x=log, log_y=log).lower()
            assert "nan" not in html
            assert "inf" not in html
    x = np.linspace(0.0, 1.0, 5)
    series = [Series("power", x, x**2)]
    usual = plot(series, "x", "y", "d")
    for wished in ((0.0, -1.0), (0.0, np.nan), (0.0, np.inf), (-1e308, 1e308)):
        assert plot(series, "x", "y", "d", x_range=wished, y_range=wished) == usual


def test_no_text_becomes_markup_or_mathematics() -> None:
    hostile = '<b>"$\\frac{$&amp;\x1b'
    one = (Series(hostile, np.arange(3.0), np.arange(3.0)), Series("b", np.arange(3.0), np.arange(3.0)))
    html = stacked_plots([Strip(hostile, one)], hostile, hostile, [Shade(0.0, 1.0, hostile, "fitted")])
    assert "<b>" not in html
    assert "\x1b" not in html
    assert any("\\frac" in text for text in texts(html))


def test_strips_share_one_axis_and_one_legend() -> None:
    time = np.linspace(0.0, 30.0, 301)
    both = (Series("measured", time, np.sin(time)), Series("simulated", time, np.cos(time)))
    html = stacked_plots([Strip("V, m/s", both), Strip("q, deg/s", both[:1])], "time, s", "two strips")
    assert {"V, m/s", "q, deg/s", "time, s"} <= set(texts(html))
    assert len(paths(html, "hue0")) == 2
    assert len(paths(html, "hue1")) == 1
    assert keys(html) == ["measured", "simulated"]


def test_every_stretch_has_its_edges_and_zero_is_in_sight_where_it_is_asked_for() -> None:
    """On an axis of 0 to 10 with its margins of 4 %."""
    one = (Series("a", np.array([0.0, 10.0]), np.array([4.0, 5.0])),)
    shades = [Shade(0.0, 4.0, "1", "fitted"), Shade(2.0, 6.0, "2", "declined")]
    html = stacked_plots([Strip("a", one)], "x", "d", shades)
    for use, edges in (("fitted", (0.0, 4.0)), ("declined", (2.0, 6.0))):
        places = [BOX * (v + 0.4) / 10.8 for v in edges]
        assert [p[0, 0] for p in paths(html, f"{use}-edge")] == pytest.approx(places, abs=0.11)
    one = (Series("a", np.array([0.0, 1.0]), np.array([4.0, 5.0])),)
    for zero in (True, False):
        assert ("0" in texts(stacked_plots([Strip("a", one, zero=zero)], "x, s", "d"))) == zero


def test_ticks_stand_where_values_are() -> None:
    lengths, floor = np.array([39.0, 41.0, 47.0]), TOP + HEIGHT
    html = plot([Series("a", lengths, lengths)], "x", "y", "d", x_ticks=[39.0, 41.0, 47.0])
    below = [e for e in tree(html).iter(f"{SVG}text") if floor < float(e.get("y", 0)) < floor + FLOOR - 15]
    assert [e.text for e in below] == ["39", "41", "47"]


def test_the_name_of_a_window_that_is_used_goes_before_one_that_is_declined() -> None:
    x = np.linspace(0.0, 100.0, 5)
    used = [Shade(a, b, name, "fitted") for a, b, name in ((40.0, 42.0, "seven"), (70.0, 80.0, "eight"))]
    shades = [Shade(30.0, 52.0, "six", "declined"), *used]
    html = stacked_plots([Strip("a", (Series("s", x, x),))], "x", "d", shades)
    assert set(texts(html)) & {"six", "seven", "eight"} == {"seven", "eight"}


FLOATS = st.floats(-1e6, 1e6) | st.just(float("nan"))


@given(arrays(np.float64, st.integers(0, 400), elements=FLOATS), st.integers(5, 50))
def test_a_thinned_curve_keeps_its_extremes_its_ends_and_its_breaks(y: FloatArray, columns: int) -> None:
    kept, values, _ = thinned(Series("a", np.arange(len(y), dtype=np.float64), y), columns)
    there = np.isfinite(y)
    assert np.array_equal(values, y[kept.astype(int)], equal_nan=True)
    assert len(np.flatnonzero(np.diff(np.isfinite(values)))) == len(np.flatnonzero(np.diff(there)))
    pieces = 1 + np.count_nonzero(np.diff(there))
    assert len(kept) <= max(2 * columns, 2 * columns + 6 * pieces + len(y) // columns * pieces)
    if there.any():
        assert np.nanmax(values) == y[there].max()
        assert np.nanmin(values) == y[there].min()
