"""Make the screenshots of pages and app in docs/images from the V-tail flight: ``python scripts/screenshots.py FLIGHT2``.

Needs Chromium; the pages are written into a folder of temporary files.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

from playwright.sync_api import Page, sync_playwright

ROOT = Path(__file__).resolve().parents[1]
IMAGES = ROOT / "docs" / "images"
ARGUMENTS = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]


def main(flight: str) -> None:
    """Write the pages, open them and take the pictures."""
    with tempfile.TemporaryDirectory(prefix="stoop-screenshots-") as scratch, sync_playwright() as playwright:
        folder, stoop = Path(scratch), [sys.executable, "-m", "stoop"]
        windows = ["--maneuver", "140:145", "146:152", "160:168.3", "--validate", "187:196"]
        vehicle = str(ROOT / "examples" / "vtail.toml")
        subprocess.run(
            [*stoop, "identify", flight, "--vehicle", vehicle, *windows, "-o", "result"],
            cwd=folder,
            check=True,
        )
        subprocess.run([*stoop, "look", flight], cwd=folder, check=True)
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        page = browser.new_page(viewport={"width": 1280, "height": 860})
        take(page, folder / "result" / "report.html", "#curves .history", 11, "report.png")
        take(page, folder / "look.html", "#time-histories .history", 1, "look.png")
        take(page, folder / "look.html", "#path", 0, "look-path.png", whole=True)
        app(page, flight, vehicle)
        browser.close()


def app(page: Page, flight: str, vehicle: str) -> None:
    """Go from the log to a report in the app, taking pictures; its folder and the flight stand where a user's would."""
    place = Path(tempfile.gettempdir()) / "flights"
    shutil.rmtree(place, ignore_errors=True)
    shutil.copytree(flight, place / "flight2")
    words = [sys.executable, "-m", "stoop", "app", "flight2", "--no-browser"]
    with subprocess.Popen(words, cwd=place, stdout=subprocess.PIPE, text=True) as running:
        assert running.stdout is not None  # noqa: S101 - asked for
        address = (
            next(line for line in running.stdout if line.startswith("open: ")).removeprefix("open: ").strip()
        )
        page.set_default_timeout(240_000)
        page.goto(address)
        page.get_by_text("What the columns mean").first.click()
        page.get_by_text("A row for each column").first.wait_for()
        page.wait_for_timeout(2000)
        page.screenshot(path=IMAGES / "app-columns.png")
        page.get_by_text("3 Vehicle").first.click()
        page.get_by_label("path of a vehicle file").fill(vehicle)
        page.locator("button:not([disabled])").get_by_text("Use", exact=True).first.click()
        page.get_by_text("Next: the windows").first.click()
        page.get_by_text("held out, to be predicted").first.wait_for()
        page.wait_for_timeout(3000)
        page.screenshot(path=IMAGES / "app-windows.png")
        page.get_by_text("Run the fit").first.click()
        page.get_by_text("parameters", exact=False).first.wait_for()
        page.wait_for_timeout(2500)
        page.screenshot(path=IMAGES / "app-fit.png")
        page.frame_locator("iframe").get_by_text("48 free parameters").first.wait_for()
        page.wait_for_timeout(1500)
        page.screenshot(path=IMAGES / "app-report.png")
        page.get_by_text("3 Vehicle").first.click()
        page.locator("math").first.wait_for()
        page.wait_for_timeout(1500)
        page.screenshot(path=IMAGES / "app-vehicle.png")
        running.terminate()
    shutil.rmtree(place)


def take(page: Page, path: Path, selector: str, panel: int, name: str, whole: bool = False) -> None:
    """Take a picture of a part of a page, the cursor over one of its panels."""
    page.goto(path.as_uri())
    part = page.locator(selector).first
    part.scroll_into_view_if_needed()
    if whole:
        page.wait_for_timeout(1500)
        part.screenshot(path=IMAGES / name)
        return
    page.wait_for_selector(f"{selector}.live canvas")
    strips = part.locator(".strips").nth(panel)
    strips.evaluate("(one) => scrollTo(0, one.getBoundingClientRect().top + scrollY - 120)")
    page.wait_for_timeout(1500)
    box = strips.bounding_box()
    assert box is not None  # noqa: S101 - it was scrolled to
    page.mouse.move(box["x"] + 0.55 * box["width"], box["y"] + 60)
    page.wait_for_timeout(500)
    page.screenshot(path=IMAGES / name)


if __name__ == "__main__":
    main(str(Path(sys.argv[1]).resolve()))
