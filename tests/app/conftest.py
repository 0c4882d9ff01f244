"""The app as a process of its own, and a real browser, both ended with the tests; logs that it opens."""

from __future__ import annotations

import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest

from stoop.base.units import FACTORS
from stoop_app import places
from stoop_app.folder import Project
from stoop_app.steps import PRODUCTS, Step, steps

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Locator, Page

#: a resize while figures are laid out, of Bokeh 3.9: it measures again
HARMLESS = "Cannot read properties of undefined (reading 'top_panel')"
PATIENCE = 600_000  #: ms until something must be there, on the busiest machine
#: column of a table -> variable, and the unit in which it is recorded
RECORDED = {
    "gyro_x": ("p", "deg/s"), "gyro_y": ("q", "deg/s"), "gyro_z": ("r", "deg/s"), "acc_x": ("ax", "m/s2"),
    "acc_y": ("ay", "m/s2"), "acc_z": ("az", "m/s2"), "roll_deg": ("phi", "deg"), "pitch_deg": ("theta", "deg"),
    "yaw_deg": ("psi", "deg"), "tas_kt": ("V", "kt"), "aoa_deg": ("alpha", "deg"), "h_ft": ("altitude", "ft"),
    "stick": ("elevator", "deg"), "wheel": ("aileron", "deg"),
}  # fmt: skip


@dataclass
class App:
    folder: Path
    process: subprocess.Popen[str]
    address: str

    @property
    def port(self) -> int:
        return int(self.address.split(":")[2].split("/")[0])

    @property
    def token(self) -> str:
        return self.address.rstrip("/").rpartition("/")[2]

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()
        assert self.process.stdout is not None
        self.process.stdout.close()


def start_app(folder: Path, *words: str, cwd: Path | None = None) -> App:
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    process = subprocess.Popen(
        [sys.executable, "-m", "stoop", "app", *words, "--folder", str(folder), "--no-browser"],
        stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, cwd=cwd, env=buffered,
    )  # fmt: skip
    assert process.stdout is not None
    lines = []
    for line in process.stdout:
        lines.append(line)
        if line.startswith("open: "):
            return App(folder, process, line.removeprefix("open: ").strip())
    pytest.fail("".join(lines))


def ended(step: Step | None) -> Step:
    assert step is not None
    while step.running:
        time.sleep(0.05)
    return step


@pytest.fixture
def app(tmp_path: Path) -> Iterator[Callable[..., App]]:
    started: list[App] = []

    def start(*words: str, folder: Path | None = None) -> App:
        started.append(start_app(folder or tmp_path / "project", *words, cwd=tmp_path))
        return started[-1]

    yield start
    for one in started:
        one.kill()
        for step in (s for kind in PRODUCTS for s in steps(one.folder, kind) if s.running):
            os.killpg(int(step.file("process.txt").read_text()), signal.SIGKILL)


@pytest.fixture
def nothing_starts(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Let no command run, and keep what the person did apart from other tests."""
    monkeypatch.setattr(places, "cache_folder", lambda: tmp_path / "memory")
    monkeypatch.setattr(places, "_session", {})
    idle = subprocess.Popen(["true"], start_new_session=True)
    idle.wait()
    monkeypatch.setattr("stoop_app.steps._process", lambda *_: idle)


@dataclass
class Tab:
    page: Page
    port: int
    clicks: int = 0
    elsewhere: list[str] = field(default_factory=list)
    errors: list[str] = field(default_factory=list)

    def click(self, name: str, exact: bool = True) -> None:
        self.page.locator("button:not([disabled])").get_by_text(name, exact=exact).first.click()
        self.clicks += 1

    def wait(self, text: str) -> None:
        self.page.get_by_text(text).first.wait_for()

    def fill(self, label: str, text: str) -> None:
        self.page.get_by_label(label).first.fill(text)
        self.clicks += 1

    def cell(self, row: str, column: str) -> Locator:
        found = self.page.locator(".tabulator-row", has=self.page.get_by_text(row, exact=True)).first
        return found.locator(f'.tabulator-cell[tabulator-field="{column}"]')

    def edit(self, row: str, value: str, column: str = "value") -> None:
        self.cell(row, column).click()
        entry = self.cell(row, column).locator("input").first
        entry.fill(value)
        entry.press("Enter")

    def settled(self, what: Locator) -> dict[str, float]:
        before: Any = None
        while (box := what.bounding_box()) != before or box is None:
            before = box
            self.page.wait_for_timeout(300)
        return dict(box)


@pytest.fixture
def tab(browser: Browser, request: pytest.FixtureRequest) -> Iterator[Callable[[App], Tab]]:
    """Return what opens an app in a browser of its own; at the end nothing was asked for elsewhere, and no script failed."""
    from playwright.sync_api import expect

    expect.set_options(timeout=PATIENCE)
    opened: list[Tab] = []

    def open_tab(app: App) -> Tab:
        page = browser.new_context(viewport={"width": 1280, "height": 900}).new_page()
        page.set_default_timeout(PATIENCE)
        one = Tab(page, app.port)
        own = (f"http://127.0.0.1:{app.port}/", f"ws://127.0.0.1:{app.port}/", "blob:", "data:")

        def asked(url: str) -> None:
            if not url.startswith(own):
                one.elsewhere.append(url)

        page.on("request", lambda r: asked(r.url))
        page.on("websocket", lambda w: asked(w.url))
        page.on("pageerror", lambda e: None if HARMLESS in str(e) else one.errors.append(str(e)))
        page.on("dialog", lambda d: one.errors.append(f"dialog: {d.message}"))
        page.goto(app.address)
        page.get_by_text("1 Log").wait_for()
        opened.append(one)
        return one

    yield open_tab
    for one in opened:
        if (folder := os.environ.get("STOOP_TEST_PICTURES")) and not one.page.is_closed():
            one.page.screenshot(path=Path(folder) / f"{request.node.name}.png", full_page=True)
        one.page.context.close()
    assert [one.elsewhere for one in opened if one.elsewhere] == [], "nothing comes from the network"
    assert [one.errors for one in opened if one.errors] == []


@pytest.fixture(scope="session")
def hover(tmp_path_factory: pytest.TempPathFactory) -> Path:
    from stoop.cli.main import main

    log = tmp_path_factory.mktemp("hover") / "hover.ulg"
    maneuver = Path(__file__).parent / "maneuver_short.toml"
    assert main(["simulate", "quad-x", "--maneuver", str(maneuver), "-o", str(log)]) == 0
    return log


@pytest.fixture(scope="session")
def ready(tmp_path_factory: pytest.TempPathFactory, hover: Path) -> Path:
    """Return the folder of an app with the log of a quadrotor that was read, its vehicle, and two windows."""
    from stoop.vehicle.builtin import builtin_text
    from stoop_plan.input_design.windows_file import Entry

    project = Project(tmp_path_factory.mktemp("ready") / "project")
    project.open_log(hover)
    project.take_vehicle(builtin_text("quad-x"))
    project.save_windows([Entry(flight="hover", start=a, stop=b) for a, b in ((0.5, 3.0), (4.5, 7.0))])
    ended(project.latest("info"))
    return project.root


@pytest.fixture
def quadrotor(tmp_path: Path, ready: Path) -> Path:
    return Path(shutil.copytree(ready, tmp_path / "project"))


@pytest.fixture(scope="session")
def table(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the log of an airplane as a table, two columns of which have names that nobody knows."""
    from stoop.simulation.fly import simulate_flight
    from stoop.simulation.maneuver import parse_maneuver
    from stoop.vehicle.builtin import load_vehicle

    shape = '[[input]]\ncontrol = "{}"\nshape = "3-2-1-1"\nstart = {}\nstep = 0.4\namplitude = 0.08\n'
    text = f"duration = 24.0\nrate = 50.0\n{shape.format('elevator', 2.0)}{shape.format('aileron', 12.0)}"
    flight = simulate_flight(load_vehicle("twin-boom"), parse_maneuver(text, "m"), 0, name="m")
    data = {str(name): flight.column(str(name)) for name in flight.data.data_vars}
    w, x, y, z = (data[f"q{i}"] for i in range(4))
    data["phi"] = np.arctan2(2 * (w * x + y * z), 1 - 2 * (x * x + y * y))
    data["theta"] = np.arcsin(2 * (w * y - z * x))
    data["psi"] = np.unwrap(np.arctan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z)))
    kept = {"time_s": flight.time} | {c: data[v] / FACTORS[u] for c, (v, u) in RECORDED.items()}
    log = tmp_path_factory.mktemp("table") / "mine.csv"
    rows, head = np.column_stack([*kept.values()]), ",".join(kept)
    np.savetxt(log, rows, delimiter=",", header=head, comments="", fmt="%.7g")
    return log
