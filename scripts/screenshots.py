"""Make the screenshots of pages in docs/images from the V-tail flight: ``python scripts/screenshots.py FLIGHT2``.

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
        take(page, folder / "result" / "report.html", "#prediction .history", 6, "report.png")
        take(page, folder / "look.html", "#time-histories .history", 1, "look.png")
        take(page, folder / "look.html", "#path", 0, "look-path.png", whole=True)
        browser.close()


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
