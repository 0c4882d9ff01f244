"""What a person sees first of a report: verdict and predicted curves, then the estimates; all else is folded and in reach."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from naive.identification import example
from playwright.sync_api import Browser, Page

from stoop.report.identification import render

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
