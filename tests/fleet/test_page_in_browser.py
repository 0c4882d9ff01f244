"""The page of a fleet in a browser: words and a day filter alarms and panels; an alarm opens its flights without scripts."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from fleet.made_up import EXCHANGED, changed, fleet
from playwright.sync_api import Browser, Page

from stoop_fleet.analysis import analyze
from stoop_fleet.page import fleet_page
from stoop_fleet.parts import day
from stoop_fleet.store import Fleet, ToldAlarm

PANELS, ROWS = ".panels > figure:not([hidden])", "tr.told:not([hidden])"


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, ToldAlarm]:
    table, parts = fleet()
    worn = changed(table, "thrust", EXCHANGED, -0.15)
    found = analyze(worn, parts, 0.1)
    (alarm,) = (ToldAlarm.of(one, "") for one in found.alarms)
    one = Fleet(Path("store"), worn, parts, 0.1, found.threshold, (alarm,))
    return fleet_page(one, found).save(tmp_path_factory.mktemp("fleet") / "fleet.html"), alarm


@pytest.fixture
def page(browser: Browser, written: tuple[Path, ToldAlarm], request: pytest.FixtureRequest) -> Iterator[Page]:
    options: dict[str, Any] = getattr(request, "param", {})
    opened = browser.new_page(viewport={"width": 420, "height": 900}, **options)
    opened.goto(written[0].as_uri())
    yield opened
    opened.close()


@pytest.mark.parametrize("page", [{}, {"java_script_enabled": False}], indirect=True)
def test_an_alarm_opens_its_flights(page: Page) -> None:
    flights = page.locator("td details tbody tr")
    assert not flights.first.is_visible()
    page.locator("td summary").click()
    assert flights.first.is_visible()
    assert page.evaluate("document.documentElement.scrollWidth") <= 420


def test_words_and_a_day_filter_alarms_and_panels(page: Page, written: tuple[Path, ToldAlarm]) -> None:
    words, date = (page.locator(f".filter input[type={kind}]") for kind in ("search", "date"))

    def shown() -> tuple[int, int]:
        return page.locator(ROWS).count(), page.locator(PANELS).count()

    for text, found in {"": (1, 16), "v3": (1, 2), "v3b": (1, 1), "V3-18": (1, 0), "drag": (0, 8), "1.1": (0, 16),
                        "thrust rotor_1 1.1": (0, 8), "v9": (0, 0)}.items():  # fmt: skip
        words.fill(text)
        assert shown() == found, text
    words.fill("")
    for later, count in ((0.0, 1), (86400.0, 0)):
        date.fill(str(day(written[1].began_time + later)))
        assert shown() == (count, count)
    date.fill("")
    page.locator(".filter input[type=checkbox]").check()
    assert shown() == (1, 1)
