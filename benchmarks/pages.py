"""Pages in a browser: Bokeh against plotly on 12 channels of 20,000 samples; a report as stoop writes it; a page of a flight.

Needs Chromium, and plotly (`pip install plotly`) for the comparison.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.table import Row
from stoop.report.series import Series, Strip
from stoop.report.sheet import Section, Sheet, write_sheet
from stoop.report.time_history import HistoryPanel, TimeHistory

PART = "pages"
CHANNELS, SAMPLES, ZOOMS = 12, 20_000, 10
ARGUMENTS = ["--headless=new", "--no-sandbox", "--disable-gpu", "--disable-background-networking"]
FRAME = "await new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)));"
BOKEH = f"""async () => {{ const range = Bokeh.documents[0].roots()[0].x_range;
  for (let i = 0; i < {ZOOMS}; i++) {{ range.setv({{start: i, end: 100 + i}}); {FRAME} }} }}"""
PLOTLY = f"""async () => {{ const plot = document.querySelector(".plotly-graph-div");
  for (let i = 0; i < {ZOOMS}; i++) {{ await Plotly.relayout(plot, {{"xaxis.range": [i, 100 + i]}}); {FRAME} }} }}"""


def run() -> list[Row]:
    """Write the pages, open them, and zoom ten times."""
    with tempfile.TemporaryDirectory(prefix="stoop-pages-") as scratch:
        return list(_rows(Path(scratch)))


def _rows(folder: Path) -> Iterator[Row]:
    from playwright.sync_api import sync_playwright

    time_axis, rng = np.arange(SAMPLES) / 100.0, np.random.default_rng(0)
    simulated = [np.sin(time_axis * (i + 1) / 7.0) for i in range(CHANNELS)]
    measured = [y + 0.1 * rng.standard_normal(SAMPLES) for y in simulated]
    pages = {"Bokeh": (_bokeh(folder, time_axis, measured, simulated), ".history.live canvas", BOKEH)}
    try:
        pages["plotly"] = (_plotly(folder, time_axis, measured, simulated), ".main-svg", PLOTLY)
    except ImportError:
        yield Row(PART, "plotly", None, note="not installed")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=shutil.which("chromium"), args=ARGUMENTS)
        for name, (path, drawn, zoom) in pages.items():
            page = browser.new_page(viewport={"width": 1280, "height": 900})
            began = time.perf_counter()
            page.goto(path.as_uri())
            page.wait_for_selector(drawn)
            opened = time.perf_counter() - began
            began = time.perf_counter()
            page.evaluate(zoom)
            zoomed = (time.perf_counter() - began) / ZOOMS
            what = f"{name}, {CHANNELS} channels of {SAMPLES} samples, two curves each"
            yield Row(PART, f"{what}: size", path.stat().st_size / 1e6, "MB")
            yield Row(PART, f"{what}: until drawn", opened, "s")
            yield Row(PART, f"{what}: a zoom", 1000.0 * zoomed, "ms", note=f"mean of {ZOOMS}")
            page.close()
        browser.close()
    yield _look(folder)


def _bokeh(folder: Path, time_axis: Any, measured: list[Any], simulated: list[Any]) -> Path:
    panels = []
    for i in range(CHANNELS):
        curves = (Series("measured", time_axis, measured[i]), Series("simulated", time_axis, simulated[i]))
        panels.append(HistoryPanel(f"channel {i}", (Strip("", curves),)))
    path = folder / "bokeh.html"
    write_sheet(Sheet("Bokeh", "", (Section("Channels", (TimeHistory(panels),)),)), path)
    return path


def _plotly(folder: Path, time_axis: Any, measured: list[Any], simulated: list[Any]) -> Path:
    import plotly.graph_objects as go
    from plotly.subplots import make_subplots

    figure = make_subplots(rows=CHANNELS, cols=1, shared_xaxes=True)
    for i in range(CHANNELS):
        for y in (measured[i], simulated[i]):
            figure.add_trace(go.Scatter(x=time_axis, y=y.astype("f4"), mode="lines"), row=i + 1, col=1)
    figure.update_layout(height=1800)
    path = folder / "plotly.html"
    path.write_text(figure.to_html(include_plotlyjs=True), "utf-8")
    return path


def _look(folder: Path) -> Row:
    """Time `stoop look` on a flight of half an hour at 100 Hz, written as PX4 would."""
    maneuver = Path(__file__).parents[1] / "examples" / "maneuver_first.toml"
    (folder / "long.toml").write_text(
        maneuver.read_text("utf-8").replace("duration = 75.0", "duration = 1800.0"), "utf-8"
    )
    stoop = [sys.executable, "-m", "stoop"]
    fly = [*stoop, "simulate", "twin-boom", "--maneuver", "long.toml", "-o", "long.ulg"]
    subprocess.run(fly, cwd=folder, check=True, capture_output=True)
    taken = []
    for _ in range(3):
        began = time.perf_counter()
        subprocess.run(
            [*stoop, "look", "long.ulg", "--overwrite"], cwd=folder, check=True, capture_output=True
        )
        taken.append(time.perf_counter() - began)
    size = (folder / "look.html").stat().st_size / 1e6
    note = f"{size:.1f} MB; least of 3, median {sorted(taken)[1]:.1f} s"
    return Row(PART, "stoop look, a log of half an hour", min(taken), "s", at_most=3.0, note=note)
