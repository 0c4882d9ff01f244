"""The whole path in a browser; two tabs, a closed browser, a killed server: nothing that was shown as saved is lost."""

import json
import os
import re
import signal
import time
from pathlib import Path

from playwright.sync_api import expect

from stoop.vehicle import load_vehicle
from stoop_app.folder import Project
from stoop_app.steps import PROCESS
from stoop_plan.input_design.windows_file import read_windows


def held(folder: Path, count: int) -> int:
    """Return the process of the latest of so many runs, halted: however slow the browser is, it has no result yet."""
    while len(runs := Project(folder).steps("runs")) < count or not runs[-1].file(PROCESS).exists():
        time.sleep(0.02)
    process = int(runs[-1].file(PROCESS).read_text("utf-8"))
    os.killpg(process, signal.SIGSTOP)
    return process


def told_to_stop(process: int) -> None:
    """Let a halted process go on once the signal to stop waits for it: on a busy machine it would be done before."""
    interrupt = 1 << (signal.SIGINT - 1)
    status = Path(f"/proc/{process}/status")
    while not int(re.findall(r"ShdPnd:\s*(\w+)", status.read_text())[0], 16) & interrupt:
        time.sleep(0.02)
    os.killpg(process, signal.SIGCONT)


def test_two_tabs_edit_one_vehicle(app, tab, quadrotor: Path) -> None:
    running = app(folder=quadrotor)
    one, other = tab(running), tab(running)
    for page in (one, other):
        page.click("3 Vehicle")
        page.wait("mass.inertia.xx")
    one.edit("mass.mass", "1.75")
    other.edit("mass.inertia.zz", "0.0456")
    for page in (one, other):
        page.wait("1 edit not saved")
    one.click("Save")
    one.wait("vehicle.toml is saved")
    other.wait("The file was changed in another tab")
    other.click("Save")
    other.wait("Your edits are kept in the form")
    assert load_vehicle(quadrotor / "vehicle.toml").value("mass.inertia.zz") != 0.0456
    other.click("Save")
    other.wait("vehicle.toml is saved")
    vehicle = load_vehicle(quadrotor / "vehicle.toml")
    assert (vehicle.value("mass.mass"), vehicle.value("mass.inertia.zz")) == (1.75, 0.0456)
    one.page.locator(".tabulator-cell", has_text="0.0456").first.wait_for()


def test_wrong_windows_and_values_and_a_vehicle_that_cannot_be_trimmed(app, tab, quadrotor: Path) -> None:
    page = tab(app(folder=quadrotor))
    page.click("4 Windows")
    page.wait("Propose windows")
    before = (quadrotor / "windows.toml").read_text("utf-8")
    stop = page.page.locator("input:visible").nth(1)
    kept = stop.input_value()
    assert float(kept) == 3.0
    stop.fill("0.5")
    stop.press("Enter")
    page.wait("is not before stop = 0.5")
    expect(page.page.locator("input:visible").nth(1)).to_have_value(kept)
    assert (quadrotor / "windows.toml").read_text("utf-8") == before
    page.click("3 Vehicle")
    page.wait("mass.inertia.xx")
    page.edit("mass.mass", "9", "low")
    page.click("Save")
    page.wait("are reversed or empty")
    page.click("Discard edits")
    page.wait("The form shows the file again")
    expect(page.cell("mass.mass", "low")).not_to_have_text("9")
    page.edit("mass.mass", "2.2")
    page.click("Save")
    page.wait("vehicle.toml is saved")
    page.click("Check by trim")
    page.wait("largest acceleration left over")
    text = (quadrotor / "vehicle.toml").read_text("utf-8")
    Project(quadrotor).take_vehicle(text.replace("mass = 2.2", "mass = 900.0"))
    page.wait("at full command the rotors lift")  # a file that was edited elsewhere, and cannot be used


def test_a_killed_server_and_a_closed_browser_lose_no_run(app, tab, quadrotor: Path) -> None:
    first = app(folder=quadrotor)
    page = tab(first)
    page.click("5 Fit")
    page.wait("No fit was run yet")
    page.click("Run the fit")
    page.wait("cost ")
    fit = held(quadrotor, 1)
    first.kill()
    page.wait("The app has ended or cannot be reached")
    page.page.close()
    assert Project(quadrotor).latest("runs").running, "it is a process of its own"
    page = tab(app(folder=quadrotor))
    page.wait("runs/001 · running")
    page.page.get_by_label("method").select_option("equation-error")
    page.click("Run the fit")  # several at once
    process = held(quadrotor, 2)
    page.wait("runs/002 · running")
    # until the page shows the command of this run, its Stop is that of the other
    page.page.get_by_text("-o runs/002").first.wait_for(state="attached")
    page.click("Stop")
    told_to_stop(process)
    page.wait("stopped before there was a result")
    page.click("runs/001 · running")
    page.click("Stop")
    told_to_stop(fit)
    page.wait("runs/001 · done")
    page.wait("interrupted")
    assert [step.state for step in Project(quadrotor).steps("runs")] == ["done", "failed"]


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

    page.click("4 Windows")
    page.wait("Drag across the strips")
    strip = page.page.locator(".bk-Figure").first
    strip.wait_for()
    page.click("theta")  # hides a curve
    page.page.locator("button:not(.bk-active)").get_by_text("theta", exact=True).wait_for()
    brushed = ((0.10, 0.30, "Fit"), (0.40, 0.62, "Fit"), (0.72, 0.95, "Predict"))
    for number, (first, last, use) in enumerate(brushed):
        box, mouse = page.settled(strip), page.page.mouse
        mouse.move(box["x"] + first * box["width"], box["y"] + 60)
        mouse.down()
        mouse.move(box["x"] + last * box["width"], box["y"] + 60, steps=8)
        mouse.up()
        page.click(use)
        page.page.get_by_text("brushed").nth(number).wait_for()
    saved = running.folder / "windows.toml"
    while not saved.exists() or [w.use for w in read_windows(saved)] != ["fit", "fit", "validate"]:
        page.page.wait_for_timeout(20)  # the page shows it before it is saved
    windows = read_windows(saved)
    assert 0.0 < windows[0].start < 2.0 < windows[0].stop < 4.0
    assert windows[1].start < 5.5 < windows[1].stop < 8.5 < windows[2].stop < 12.0

    page.click("3 Vehicle")
    page.click("quad-x")
    page.wait("Quadrotor X, 1.5 kg is now vehicle.toml: look at its numbers")
    page.page.locator(".tabulator-row").first.wait_for()
    page.page.wait_for_function("window.scrollY === 0")
    page.click("5 Fit")
    page.page.get_by_label("method").select_option("equation-error")
    page.click("Run the fit")
    page.page.frame_locator("iframe").get_by_text("identification report").first.wait_for()

    page.page.get_by_label("method").select_option("multiple-shooting")
    page.click("Run the fit")
    page.wait("cost ")
    page.page.locator(".curves path.simulated").first.wait_for()
    page.click("Stop")
    page.wait("multiple-shooting, interrupted")
    result = json.loads((running.folder / "runs" / "002" / "result.json").read_text("utf-8"))
    assert (result["status"], bool(result["parameters"])) == ("interrupted", True)
    page.click("6 Compare")
    compared = page.page.frame_locator("iframe")
    for text in ("Apart, σ", "Theil's inequality coefficient", "Windows and channels that both runs hold"):
        compared.get_by_text(text).first.wait_for()
    assert any(row.count("±") == 2 for row in compared.locator("tr").all_inner_texts())
    assert compared.locator(".strips").count() > 9
    page.click("7 Use")
    page.page.get_by_label("export to").select_option("state space (A, B, C, D)")
    page.click("Export")
    link = page.page.get_by_role("link").first
    link.wait_for()
    with page.page.expect_download() as download:
        link.click()
    assert Path(download.value.path()).stat().st_size > 0
