"""The whole path on a simulated quadrotor: sent by the browser, brushed, fitted, stopped, compared, exported."""

from __future__ import annotations

import json
from pathlib import Path

from stoop.input_design.windows_file import read_windows


def test_from_a_sent_log_to_an_export(app, tab, hover: Path) -> None:
    running = app()
    page = tab(running)
    page.wait("Drop a flight log here")
    page.page.locator("input[type=file]").first.set_input_files(hover)
    page.wait("Next: the vehicle")
    assert (running.folder / "logs" / "hover.ulg").read_bytes() == hover.read_bytes()

    # What a fit lacks is said, and it cannot be run.
    page.click("5 Fit")
    page.wait("Choose a vehicle first")
    assert page.page.locator("button", has_text="Run the fit").first.is_disabled()

    # Windows are brushed on the plot.
    page.click("4 Windows")
    page.wait("Drag across the strips")
    strip = page.page.locator(".bk-Figure").first
    strip.wait_for()
    page.click("theta")  # hides a curve
    page.page.locator("button:not(.bk-active)").get_by_text("theta", exact=True).wait_for()
    for number, (first, last, use) in enumerate(
        ((0.10, 0.30, "Fit"), (0.40, 0.62, "Fit"), (0.72, 0.95, "Predict"))
    ):
        box = page.settled(strip)
        y = box["y"] + 60
        page.page.mouse.move(box["x"] + first * box["width"], y)
        page.page.mouse.down()
        page.page.mouse.move(box["x"] + last * box["width"], y, steps=8)
        page.page.mouse.up()
        page.click(use)
        page.page.get_by_text("brushed").nth(number).wait_for()
    saved = running.folder / "windows.toml"
    while not saved.exists() or [w.use for w in read_windows(saved)] != ["fit", "fit", "validate"]:
        page.page.wait_for_timeout(20)  # the page shows it before it is saved
    windows = read_windows(saved)
    assert 0.0 < windows[0].start < 2.0 < windows[0].stop < 4.0
    assert windows[1].start < 5.5 < windows[1].stop < 8.5 < windows[2].stop < 12.0

    # A vehicle of the package, one number edited in the form.
    page.click("3 Vehicle")
    page.click("quad-x")
    page.wait("Quadrotor X, 1.5 kg is now vehicle.toml: look at its numbers")
    page.page.locator(".tabulator-row").first.wait_for()
    page.page.wait_for_function("window.scrollY === 0")
    page.click("5 Fit")
    page.page.get_by_label("method").select_option("equation-error")
    page.click("Run the fit")
    page.page.frame_locator("iframe").get_by_text("identification report").first.wait_for()

    # Stop keeps the best so far.
    page.page.get_by_label("method").select_option("multiple-shooting")
    page.click("Run the fit")
    page.wait("cost ")
    page.page.locator(".curves path.simulated").first.wait_for()
    page.click("Stop")
    page.wait("multiple-shooting, interrupted")
    result = json.loads((running.folder / "runs" / "002" / "result.json").read_text("utf-8"))
    assert result["status"] == "interrupted"
    assert result["parameters"]

    # Side by side.
    page.click("6 Compare")
    compared = page.page.frame_locator("iframe")
    for text in ("Apart, σ", "Theil's inequality coefficient", "Windows and channels that both runs hold"):
        compared.get_by_text(text).first.wait_for()
    rows = compared.locator("tr").all_inner_texts()
    assert any(row.count("±") == 2 for row in rows)
    assert compared.locator(".strips").count() > 9

    page.click("7 Use")
    page.page.get_by_label("export to").select_option("state space (A, B, C, D)")
    page.click("Export")
    link = page.page.get_by_role("link").first
    link.wait_for()
    with page.page.expect_download() as download:
        link.click()
    assert Path(download.value.path()).stat().st_size > 0
