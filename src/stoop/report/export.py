"""The page of an exported aircraft: the flight, our simulation and JSBSim, channel by channel."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.numbers import NOTHING, factor_and_unit
from stoop.base.variables import VARIABLES, WRAPPED
from stoop.exporters.comparison import Comparison
from stoop.exporters.jsbsim_aircraft import PLANET, relative_errors
from stoop.exporters.jsbsim_flight import FRAME_RATE
from stoop.exporters.jsbsim_model import delays
from stoop.exporters.record import differences, relative_differences
from stoop.report.plots import Series, Strip, stacked_plots
from stoop.report.sheet import Bullets, Code, Figure, Part, Prose, Section, Sheet, Table, render_sheet
from stoop.vehicle import Vehicle

PAGE: Final = "export.html"
EXPLANATION: Final = """\
What is left on the flat planet is integration and rounding:
- our Runge-Kutta takes one step per sample, JSBSim {rate:g} Adams-Bashforth steps a second or a few more, and a surface's \
lag is a bilinear filter there;
- JSBSim's standard atmosphere is 8·10⁻⁶ denser than ours at sea level (its constants are rounded), where the vehicle \
file asks for the standard density;
- a delay that is no whole number of samples is interpolated with a cubic through the samples in our simulation and with \
a line through the frames in JSBSim; in the column "on JSBSim's frames" both use the same points.

JSBSim's Earth, here at 45 degrees of latitude, is round and turns by 0.09 degrees of heading in 30 s, and its gravity
is not the vehicle file's. That is a difference between two worlds, not between two models of the aircraft.
"""
SCRIPT: Final = """\
import jsbsim

fdm = jsbsim.FGFDMExec(".")  # this folder
fdm.load_planet("{planet}", False)  # leave this line and the gravity model out for the Earth
fdm.load_script("scripts/{name}.xml")
fdm["simulation/gravity-model"] = 0
fdm.run_ic()
while fdm.run():
    print(fdm.get_sim_time(), fdm["velocities/vt-fps"])"""


def page_text(
    vehicle: Vehicle, aircraft: str, name: str, flown: Sequence[Comparison], notes: Sequence[str]
) -> str:
    """Return the page as HTML."""
    read = relative_errors(vehicle, aircraft)
    lead = (
        f"The aircraft in aircraft/{name} says in JSBSim's terms what the vehicle file says, and flies the same. "
        f"Read back, {len(read)} numbers differ from the vehicle's by at most {max(read.values()):.0e} of themselves."
    )
    parts: list[Section] = [_section(one) for one in flown]
    parts.append(Section("Why they differ at all", (Prose(EXPLANATION.format(rate=FRAME_RATE)),)))
    parts += [Section("Notes", (Bullets(notes),))] if notes else []
    parts.append(Section("Fly it", (Code(SCRIPT.format(planet=PLANET, name=name)),)))
    return render_sheet(Sheet(f"{vehicle.name} in JSBSim", lead, tuple(parts)))


def _section(flown: Comparison) -> Section:
    title = flown.maneuver.title
    drawing = stacked_plots(_strips(flown), "time, s", f"{title}: every channel as flown and simulated")
    measured = "Measured, by" if flown.maneuver.measured is not None else "By"
    parts: tuple[Part, ...] = (_table(flown), Figure(f"{measured} our simulation and by JSBSim", drawing))
    return Section(title, parts)


def _table(flown: Comparison) -> Table:
    vehicle, measured = flown.maneuver.record.vehicle, flown.maneuver.measured
    columns = {"JSBSim, flat planet": flown.relative}
    if delays(vehicle):
        columns["on JSBSim's frames"] = relative_differences(vehicle, flown.fine, flown.flat)
    columns["JSBSim, Earth"] = relative_differences(vehicle, flown.own, flown.earth)
    largest = np.abs(flown.own).max(axis=0)
    errors = []
    if measured is not None:
        errors = [_rms(differences(vehicle, y, measured)) for y in (flown.own, flown.flat)]
    rows = []
    for i, channel in enumerate(vehicle.outputs):
        relative = (f"{column[channel]:.1e}" for column in columns.values())
        rows.append(
            (
                channel,
                *(_shown(channel, float(largest[i])), *relative),
                *(_shown(channel, e[i]) for e in errors),
            )
        )
    head = ["channel", "largest magnitude", *columns]
    head += ["flight less simulation, rms", "flight less JSBSim, rms"] if errors else []
    caption = "Largest difference from our simulation, as a fraction of the channel's largest magnitude"
    return Table(caption, tuple(head), tuple(rows))


def _rms(values: FloatArray) -> list[float]:
    """Return the root mean square of each column of (n, n_y); NaN where nothing was measured."""
    return [float(np.sqrt(np.nanmean(v**2))) if np.isfinite(v).any() else float("nan") for v in values.T]


def _shown(channel: str, x: float) -> str:
    factor, unit = factor_and_unit(VARIABLES[channel].unit)
    return f"{x * factor:.4g} {unit}" if np.isfinite(x) else NOTHING


def _strips(flown: Comparison) -> list[Strip]:
    record, measured = flown.maneuver.record, flown.maneuver.measured
    out = []
    for i, channel in enumerate(record.vehicle.outputs):
        factor, unit = factor_and_unit(VARIABLES[channel].unit)
        curves = {"stoop": flown.own[:, i], "JSBSim": flown.flat[:, i]}
        if measured is not None:
            curves = {"flight": measured[:, i], **curves}
        series = [Series(n, record.time, factor * _unwrapped(channel, y)) for n, y in curves.items()]
        out.append(Strip(f"{channel}, {unit}", tuple(series)))
    return out


def _unwrapped(channel: str, y: FloatArray) -> FloatArray:
    """Return an angle without jumps, near zero where it begins."""
    known = np.isfinite(y)
    if channel not in WRAPPED or not known.any():
        return y
    out = y.copy()
    out[known] = np.unwrap(y[known])
    return np.asarray(out - 2.0 * np.pi * np.round(out[known][0] / (2.0 * np.pi)))
