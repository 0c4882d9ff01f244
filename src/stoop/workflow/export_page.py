"""The page beside an exported aircraft: the flight, our simulation and JSBSim, channel by channel."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.units import DEGREE
from stoop.base.variables import WRAPPED
from stoop.export.jsbsim_aircraft import PLANET, relative_errors
from stoop.export.jsbsim_flight import FRAME_RATE, frames_per_sample, jsbsim_readings
from stoop.export.jsbsim_model import delays
from stoop.export.record import Record, differences, file_name, own_readings, relative_differences
from stoop.flight import VARIABLES
from stoop.report.plots import Series, Strip, stacked_plots
from stoop.report.sheet import Code, Figure, Prose, Section, Sheet, Table, render_sheet
from stoop.vehicle import Vehicle
from stoop.workflow.export_subject import Maneuver

PAGE: Final = "export.html"
GOAL: Final = 1e-3  #: of a channel's maximum
_EXPLAINED: Final = """\
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
_FLY: Final = """\
import jsbsim

fdm = jsbsim.FGFDMExec(".")  # this folder
fdm.load_planet("{planet}", False)  # leave this line and the gravity model out for the Earth
fdm.load_script("scripts/{name}.xml")
fdm["simulation/gravity-model"] = 0
fdm.run_ic()
while fdm.run():
    print(fdm.get_sim_time(), fdm["velocities/vt-fps"])"""


@dataclass(frozen=True, eq=False)
class Comparison:
    """One maneuver, flown by our simulation and by JSBSim.

    Attributes
    ----------
    maneuver : Maneuver
    own, fine : (n, n_y)
        Our simulation: a step per sample, and a step per frame of JSBSim.
    flat, earth : (n, n_y)
        JSBSim on the flat planet and on its Earth.
    """

    maneuver: Maneuver
    own: FloatArray
    fine: FloatArray
    flat: FloatArray
    earth: FloatArray

    @property
    def title(self) -> str:
        """What was flown."""
        return self.maneuver.title

    @property
    def record(self) -> Record:
        """What flew."""
        return self.maneuver.record

    @property
    def measured(self) -> FloatArray | None:
        """What the flight's instruments read, (n, n_y)."""
        return self.maneuver.measured

    @property
    def relative(self) -> dict[str, float]:
        """Largest difference of each channel over its largest magnitude, JSBSim against our simulation."""
        return relative_differences(self.record.vehicle, self.own, self.flat)


def compare(root: Path, maneuver: Maneuver) -> Comparison:
    """Fly a maneuver by our equations and in JSBSim, whose root folder holds the exported aircraft.

    Raises
    ------
    StoopError
        The flight diverges, or JSBSim is not there.
    """
    record = maneuver.record
    name = file_name(record.vehicle.name)
    many = frames_per_sample(record.dt)
    return Comparison(
        maneuver,
        own_readings(record),
        own_readings(record, many),
        jsbsim_readings(root, name, record, root / PLANET),
        jsbsim_readings(root, name, record, None),
    )


def verdict(flown: Comparison) -> str:
    """Say how far the two are apart."""
    channel, largest = max(flown.relative.items(), key=lambda item: item[1])
    return f"{flown.title}: JSBSim within {largest:.1e} of each channel's maximum (largest in {channel})."


def page_text(
    vehicle: Vehicle, aircraft: str, name: str, flown: Sequence[Comparison], notes: Sequence[str]
) -> str:
    """Return the page as HTML."""
    read = relative_errors(vehicle, aircraft)
    lead = (
        f"The aircraft in aircraft/{name} says in JSBSim's terms what the vehicle file says, and flies the same. "
        f"Read back, {len(read)} numbers differ from the vehicle's by at most {max(read.values()):.0e} of themselves."
    )
    sections = [_section(one) for one in flown]
    why = Section("Why they differ at all", (Prose(_EXPLAINED.format(rate=FRAME_RATE)),))
    said = [Section("Notes", (Prose("\n".join(f"- {note}" for note in notes)),))] if notes else []
    use = Section("Fly it", (Code(_FLY.format(planet=PLANET, name=name)),))
    return render_sheet(Sheet(f"{vehicle.name} in JSBSim", lead, (*sections, why, *said, use)))


def _section(flown: Comparison) -> Section:
    drawing = stacked_plots(_strips(flown), "time, s", f"{flown.title}: every channel as flown and simulated")
    caption = (
        "Measured, by our simulation and by JSBSim"
        if flown.measured is not None
        else "By our simulation and by JSBSim"
    )
    return Section(flown.title, (_table(flown), Figure(caption, drawing)))


def _table(flown: Comparison) -> Table:
    vehicle, late = flown.record.vehicle, bool(delays(flown.record.vehicle))
    head = ["channel", "largest magnitude", "JSBSim, flat planet"]
    columns = [flown.relative]
    if late:
        head.append("on JSBSim's frames")
        columns.append(relative_differences(vehicle, flown.fine, flown.flat))
    head.append("JSBSim, Earth")
    columns.append(relative_differences(vehicle, flown.own, flown.earth))
    largest = np.abs(flown.own).max(axis=0)
    measured = flown.measured is not None
    head += ["flight less simulation, rms", "flight less JSBSim, rms"] if measured else []
    rows = []
    for i, channel in enumerate(vehicle.outputs):
        row = [channel, _shown(channel, float(largest[i])), *(f"{c[channel]:.1e}" for c in columns)]
        row += [_shown(channel, x) for x in _errors(flown, i)] if measured else []
        rows.append(tuple(row))
    words = "Largest difference from our simulation, as a fraction of the channel's largest magnitude"
    return Table(words, tuple(head), tuple(rows))


def _errors(flown: Comparison, i: int) -> list[float]:
    """Return root mean squares of the flight less both simulations."""
    if flown.measured is None:
        return []
    apart = [differences(flown.record.vehicle, y, flown.measured)[:, i] for y in (flown.own, flown.flat)]
    return [float(np.sqrt(np.nanmean(d**2))) if np.isfinite(d).any() else float("nan") for d in apart]


def _scale(channel: str) -> tuple[float, str]:
    """Return what takes a channel to the unit it is shown in, and that unit."""
    own = VARIABLES[channel].unit
    return (1.0 / DEGREE, own.replace("rad", "deg")) if own.startswith("rad") else (1.0, own)


def _shown(channel: str, x: float) -> str:
    factor, unit = _scale(channel)
    return f"{x * factor:.4g} {unit}" if np.isfinite(x) else "–"


def _strips(flown: Comparison) -> list[Strip]:
    out = []
    for i, channel in enumerate(flown.record.vehicle.outputs):
        factor, unit = _scale(channel)
        curves = {"stoop": flown.own[:, i], "JSBSim": flown.flat[:, i]}
        if flown.measured is not None:
            curves = {"flight": flown.measured[:, i], **curves}
        shown = [Series(n, flown.record.time, factor * _turned(channel, y)) for n, y in curves.items()]
        out.append(Strip(f"{channel}, {unit}", tuple(shown)))
    return out


def _turned(channel: str, y: FloatArray) -> FloatArray:
    """Return an angle without jumps, near zero where it begins."""
    seen = np.isfinite(y)
    if channel not in WRAPPED or not seen.any():
        return y
    out = y.copy()
    out[seen] = np.unwrap(y[seen])
    return np.asarray(out - 2.0 * np.pi * np.round(out[seen][0] / (2.0 * np.pi)))
