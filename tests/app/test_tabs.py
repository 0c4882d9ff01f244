"""Two tabs, a closed browser, a killed server: nothing that was shown as saved is lost."""

from __future__ import annotations

import os
import re
import signal
import time
from pathlib import Path

from playwright.sync_api import expect

from stoop.app.folder import Project
from stoop.app.steps import PROCESS
from stoop.vehicle.builtin import builtin_text
from stoop.vehicle.load import load_vehicle


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
    slow = re.sub(r"^airspeed = .*$", "airspeed = 4.0", builtin_text("twin-boom"), flags=re.MULTILINE)
    Project(quadrotor).take_vehicle(slow)
    page.wait("Twin-boom UAV")
    page.click("Check by trim")
    page.wait("no steady flight")


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
    run = Project(quadrotor).latest("runs")
    assert run.running, "it is a process of its own"
    again = app(folder=quadrotor)
    page = tab(again)
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
