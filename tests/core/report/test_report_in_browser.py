"""A report in a real browser: what is seen first, time histories, zoom, legend, windows; print, dark, and no scripts."""

import csv
import io
import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from naive.identification import example
from playwright.sync_api import Browser, Page

from stoop.report.identification import Plots, render
from stoop.report.model import Model

PLACES = "Bokeh.documents[0].roots().map((one) => [one.x_range.start, one.x_range.end])"
CURVES = "Bokeh.documents[0].roots().flatMap((f) => f.renderers)"


@dataclass
class Seen:
    page: Page
    identification: Model
    troubles: list[str] = field(default_factory=list)

    def run(self, script: str) -> Any:
        return self.page.evaluate(script)

    def box(self, panel: int, strip: int = 0) -> dict[str, float]:
        place = self.page.locator(".history").first.locator(".strips").nth(panel).locator("> div").nth(strip)
        place.scroll_into_view_if_needed()
        found = place.bounding_box()
        assert found is not None
        return dict(found)

    def drag(self, panel: int, start: float, stop: float) -> None:
        at = self.box(panel)
        y = at["y"] + at["height"] / 2
        self.page.mouse.move(at["x"] + 70 + start * (at["width"] - 78), y)
        self.page.mouse.down()
        for share in np.linspace(start, stop, 5)[1:]:
            self.page.mouse.move(at["x"] + 70 + share * (at["width"] - 78), y)
        self.page.mouse.up()


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Model]:
    identification = example(("CL0", "CLalpha"))
    path = tmp_path_factory.mktemp("page") / "report.html"
    return Plots(identification).maneuvers().save(path), identification


def opened(browser: Browser, made: tuple[Path, Model], **options: Any) -> Seen:
    page = browser.new_page(viewport={"width": 1280, "height": 900}, **options)
    seen = Seen(page, made[1])
    note = seen.troubles.extend
    page.on("console", lambda one: note([one.text] * (one.type == "error")))
    page.on("pageerror", lambda error: note([str(error)]))
    page.on("request", lambda one: note([one.url] * (not one.url.startswith(("file:", "data:", "blob:")))))
    page.goto(made[0].as_uri())
    page.locator(".history").first.scroll_into_view_if_needed()
    return seen


def _show_strips(page: Page) -> None:
    """Wait until every strip of the first history is drawn: figures are made when they come into sight."""
    page.wait_for_selector(".history.live canvas")
    for strip in page.locator(".history").first.locator(".strips").all():
        strip.scroll_into_view_if_needed()
        strip.locator("canvas").first.wait_for(state="attached")


@pytest.fixture
def seen(browser: Browser, made: tuple[Path, Model]) -> Iterator[Seen]:
    seen = opened(browser, made)
    _show_strips(seen.page)
    yield seen
    assert seen.troubles == []
    seen.page.close()


def test_a_drag_zooms_all_channels_alike_and_a_double_click_shows_everything(seen: Seen) -> None:
    whole = seen.run(PLACES)
    seen.drag(0, 0.25, 0.5)
    seen.page.wait_for_function(f"({PLACES})[0][0] > {whole[0][0] + 0.5}")
    zoomed = seen.run(PLACES)
    assert len(zoomed) > 20
    assert all(one == zoomed[0] for one in zoomed)
    span = whole[0][1] - whole[0][0]
    assert zoomed[0] == pytest.approx([whole[0][0] + 0.25 * span, whole[0][0] + 0.5 * span], abs=0.03 * span)
    seen.page.get_by_role("button", name="reset").first.click()
    assert seen.run(PLACES) == whole


def test_the_cursor_reads_every_channel_at_one_time(seen: Seen) -> None:
    at = seen.box(6)
    seen.page.mouse.move(at["x"] + at["width"] / 3, at["y"] + at["height"] / 2)
    seen.page.wait_for_function("document.querySelectorAll('.history .values')[6].textContent !== ''")
    texts = seen.page.locator(".history").first.locator(".values").all_text_contents()
    times = {text.partition(" s:")[0] for text in texts}
    assert len(times) == 1
    trace = seen.identification.traces[0]
    k = int(np.flatnonzero(np.nan_to_num(trace.time, nan=np.inf) <= float(times.pop()) + 5e-4)[-1])
    for text, (name, one) in [*zip(texts[len(trace.inputs) :], trace.channels.items(), strict=False)][::5]:
        factor = 1.0 if seen.identification.units[name].startswith("m") else 180.0 / np.pi
        (read,) = re.findall(r"measured (−?[\d.e-]+)", text)
        values = factor * one.measured[k - 1 : k + 1]
        assert np.isclose(float(read.replace("−", "-")), values, rtol=1e-3).any()


def test_the_legend_hides_and_shows_a_curve_everywhere(seen: Seen) -> None:
    shown = f"{CURVES}.filter((r) => r.name === 'measured' && r.visible).length"
    before = seen.run(shown)
    key = seen.page.locator(".history").first.get_by_role("button", name="measured", exact=True)
    key.click()
    assert before == len(seen.identification.traces[0].channels)
    assert seen.run(shown) == 0
    key.click()
    assert seen.run(shown) == before


def test_a_marked_window_stands_there_to_be_copied_and_its_table_holds_the_data(seen: Seen) -> None:
    history = seen.page.locator(".history").first
    history.get_by_role("button", name="window").click()
    seen.drag(4, 0.2, 0.6)
    words = history.locator(".marked code").text_content() or ""
    ((start, stop),) = re.findall(r"^--maneuver (?:\w+@)?([\d.]+):([\d.]+)$", words)
    with seen.page.expect_download() as download:
        history.get_by_role("button", name="CSV").click()
    rows = list(csv.reader(io.StringIO(Path(download.value.path()).read_text("utf-8"))))
    head, table = rows[0], np.array([[float(x or "nan") for x in row] for row in rows[1:]])
    trace = seen.identification.traces[0]
    inside = (trace.time >= float(start) - 5e-4) & (trace.time <= float(stop) + 5e-4)
    assert inside.any()
    assert head[0] == "time [s]"
    assert table[:, 0] == pytest.approx(trace.time[inside], abs=1e-9)
    for name, factor, unit in (("p", 180.0 / np.pi, "deg/s"), ("az", 1.0, "m/s²")):
        column = table[:, head.index(f"simulated {name} [{unit}]")]
        expected = factor * trace.channels[name].simulated[inside]
        assert column == pytest.approx(expected, rel=1e-6, abs=1e-6, nan_ok=True)


def test_print_and_no_scripts_show_stills(browser: Browser, made: tuple[Path, Model], seen: Seen) -> None:
    seen.page.emulate_media(media="print")
    still, strips = seen.page.locator(".still").first, seen.page.locator(".strips").first
    assert still.is_visible()
    assert not strips.is_visible()
    plain = opened(browser, made, java_script_enabled=False)
    assert plain.page.locator(".still svg").first.is_visible()
    assert not plain.page.get_by_role("button", name="zoom").first.is_visible()
    plain.page.close()


def test_a_page_is_no_wider_than_the_screen_and_dark(browser: Browser, made: tuple[Path, Model]) -> None:
    seen = opened(browser, made, color_scheme="dark")
    for width in (420, 1280):
        seen.page.set_viewport_size({"width": width, "height": 900})
        _show_strips(seen.page)
        assert seen.run("document.documentElement.scrollWidth") <= width
    colors = seen.run(f"{CURVES}.map((r) => r.glyph.line_color?.value)")
    assert "#7aa2ff" in colors
    assert "#1d4ed8" not in colors
    assert seen.troubles == []
    seen.page.close()


SCREEN = 900
TOP = "(place) => Math.round(document.querySelector(place).getBoundingClientRect().top + scrollY)"
BOTTOM = TOP.replace("().top", "().bottom")
CUT = "[...document.querySelectorAll('.compact figcaption')].filter((one) => one.scrollWidth > one.clientWidth).length"
CLOSED = "[...document.querySelectorAll('details')].filter((one) => !one.open).length"


@pytest.fixture(scope="module")
def report(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("report") / "report.html"
    path.write_text(render(example()), "utf-8")
    return path


@pytest.fixture
def page(browser: Browser, report: Path, request: pytest.FixtureRequest) -> Iterator[Page]:
    options: dict[str, Any] = getattr(request, "param", {})
    opened = browser.new_page(viewport={"width": 1280, "height": SCREEN}, **options)
    opened.goto(report.as_uri())
    yield opened
    opened.close()


def test_the_first_screen_has_verdict_and_prediction_and_the_second_the_estimates(page: Page) -> None:
    page.wait_for_selector(".compact canvas")
    assert page.evaluate(TOP, ".verdict") < 0.25 * SCREEN
    assert page.evaluate(TOP, "#curves .history .panels") < 0.75 * SCREEN
    assert page.locator("#curves .chip").first.text_content() == "validation"
    assert page.evaluate(BOTTOM, "#curves .history .panels") < SCREEN
    assert page.evaluate(TOP, "#estimates") < 2 * SCREEN
    assert page.evaluate("document.documentElement.scrollHeight") < 4 * SCREEN
    sides = page.locator(".verdict .sides > div")
    assert [one.locator("h2").text_content() for one in sides.all()] == ["Against", "For"]
    assert all(1 <= one.locator("li").count() <= 3 for one in sides.all())
    closed = page.evaluate(CLOSED)
    page.evaluate("dispatchEvent(new Event('beforeprint'))")
    assert page.evaluate(CLOSED) == 0
    page.evaluate("dispatchEvent(new Event('afterprint'))")
    assert page.evaluate(CLOSED) == closed > 8


@pytest.mark.parametrize("page", [{}, {"java_script_enabled": False}], indirect=True)
def test_print_opens_all_and_a_link_what_is_folded(page: Page) -> None:
    folded = page.locator("details.fold > section")
    assert folded.count() > 8
    assert not folded.last.is_visible()
    page.emulate_media(media="print")
    assert all(one.is_visible() for one in folded.all())
    page.emulate_media(media="screen")
    places = [str(link.get_attribute("href")) for link in page.locator("nav a").all()]
    assert len(places) > 10
    for place in places:
        page.locator(f'nav a[href="{place}"]').click()
        page.locator(place).locator("> *").first.wait_for(state="visible")


@pytest.mark.parametrize("page", [{"color_scheme": "dark"}], indirect=True)
def test_a_narrow_dark_screen_holds_the_page(page: Page) -> None:
    page.set_viewport_size({"width": 420, "height": SCREEN})
    page.wait_for_selector(".compact canvas")
    assert page.evaluate("document.documentElement.scrollWidth") <= 420
    assert page.evaluate(TOP, "#curves .history") < 1.5 * SCREEN
    assert page.locator(".compact .score").first.is_visible()
    assert page.evaluate(CUT) == 0
