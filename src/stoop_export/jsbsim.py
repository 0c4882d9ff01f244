"""Target ``jsbsim``: the aircraft for JSBSim, a start, a script, and the page of how it flies."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError
from stoop.extend.motion import Trim
from stoop.extend.reports import sheet, with_residual
from stoop.extend.text import factor_and_unit
from stoop.extend.variables import FAMILIES, VARIABLES
from stoop.extend.verbs import install
from stoop_export import jsbsim_aircraft
from stoop_export.agreement import EXPORT_PAGE, agreement_table
from stoop_export.exporter import Exported, Exporter, encoded, installed, written
from stoop_export.jsbsim_aircraft import relative_errors
from stoop_export.jsbsim_comparison import Comparison, compare
from stoop_export.jsbsim_flight import FRAME_RATE, PLANET, differences, file_name, relative_differences
from stoop_export.jsbsim_model import THRUST, actuators, channel
from stoop_export.reference_flight import reference_record, steady_start, with_restarts

ROLES: Final = {"flight": "measured", "stoop": "fit", "JSBSim": "lag"}
WIDTHS: Final = {"flight": 2.8, "stoop": 2.2, "JSBSim": 1.2}  #: px: the later lie on the earlier
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


def export_page(
    vehicle: Vehicle, aircraft: str, name: str, flown: Sequence[Comparison], notes: Sequence[str]
) -> str:
    """Return the page of an exported aircraft as HTML: the flight, our simulation and JSBSim, channel by channel."""
    read = relative_errors(vehicle, aircraft)
    lead = (
        f"The aircraft in aircraft/{name} says in JSBSim's terms what the vehicle file says, and flies the same. "
        f"Read back, {len(read)} numbers differ from the vehicle's by at most {max(read.values()):.0e} of themselves."
    )
    sections = []
    for one in flown:
        title = one.record.title
        measured = "Measured, by" if one.record.measured is not None else "By"
        caption = sheet.Prose(
            f"{measured} our simulation and by JSBSim, against time in s, and their difference."
        )
        sections.append(
            sheet.Section(title, (_differences(one), agreement_table(one.compared), caption, _history(one)))
        )
    sections.append(
        sheet.Section("Why they differ at all", (sheet.Prose(EXPLANATION.format(rate=FRAME_RATE)),))
    )
    sections += [sheet.Section("Notes", (sheet.Bullets(notes),))] if notes else []
    sections.append(sheet.Section("Fly it", (sheet.Code(SCRIPT.format(planet=PLANET, name=name)),)))
    return sheet.render_sheet(sheet.Sheet(f"{vehicle.name} in JSBSim", lead, tuple(sections)))


def _differences(flown: Comparison) -> sheet.Table:
    vehicle, measured = flown.record.vehicle, flown.record.measured
    columns = {"JSBSim, flat planet": flown.relative}
    if actuators(vehicle):
        columns["on JSBSim's frames"] = relative_differences(vehicle.outputs, flown.fine, flown.flat)
    columns["JSBSim, Earth"] = relative_differences(vehicle.outputs, flown.own, flown.earth)
    head = ["channel", "largest magnitude", *columns]
    errors: list[FloatArray] = []
    if measured is not None:
        head += ["flight less simulation, rms", "flight less JSBSim, rms"]
        errors = [differences(vehicle.outputs, y, measured) for y in (flown.own, flown.flat)]
    rows = []
    for i, name in enumerate(vehicle.outputs):
        factor, unit = factor_and_unit(VARIABLES[name].unit)
        sizes = [float(np.abs(flown.own[:, i]).max())]
        for error in errors:  # NaN where nothing was measured
            known = error[np.isfinite(error[:, i]), i]
            sizes.append(float(np.sqrt(np.mean(known**2))) if known.size else np.nan)
        largest, *rms = (f"{x * factor:.4g} {unit}" if np.isfinite(x) else "–" for x in sizes)
        rows.append((name, largest, *(f"{column[name]:.1e}" for column in columns.values()), *rms))
    caption = "Largest difference from our simulation, as a fraction of the channel's largest magnitude"
    return sheet.Table(caption, tuple(head), tuple(rows))


def _history(flown: Comparison) -> sheet.TimeHistory:
    """Return every channel as flown and simulated, and the difference between the simulations below."""
    record, measured, panels = flown.record, flown.record.measured, []
    for i, output in enumerate(record.vehicle.outputs):
        factor, unit = factor_and_unit(VARIABLES[output].unit)
        curves = {"stoop": flown.own[:, i], "JSBSim": flown.flat[:, i]}
        if measured is not None:
            curves = {"flight": measured[:, i], **curves}
        series = {}
        for name, y in curves.items():
            known = np.isfinite(y)
            if (
                output in FAMILIES["circular"] and known.any()
            ):  # an angle without jumps, near zero where it begins
                y = y.copy()
                y[known] = np.unwrap(y[known])
                y -= 2.0 * np.pi * np.round(y[known][0] / (2.0 * np.pi))
            series[name] = sheet.Series(name, record.time, factor * y, role=ROLES[name], width=WIDTHS[name])
        difference = series["JSBSim"].y - series["stoop"].y
        strips = with_residual(list(series.values()), "JSBSim − stoop", difference)
        panels.append(sheet.HistoryPanel(output, strips, unit, VARIABLES[output].meaning))
    return sheet.TimeHistory(panels)


NOT_FLOWN: Final = f"Not flown: the package jsbsim is not installed; {install('jsbsim')}."
SLOPES: Final = (
    "The reaction of rotors without a lag to their spin-up is computed from the last step of JSBSim, so it is a step late "
    "({}); give rotors.lag to have it exactly."
)


class JSBSim(Exporter):
    """The aircraft, and the page of how it flies; without a steady flight there is no start to give."""

    @cached_property
    def start(self) -> Trim | str:
        """The steady flight, or why there is none."""
        try:
            return self.point
        except SimulationError as error:
            return f"No start and no script: {error}."

    @cached_property
    def texts(self) -> dict[str, str]:
        """The files by place."""
        start = None if isinstance(self.start, str) else steady_start(self.vehicle, self.start)
        return jsbsim_aircraft.folder(self.vehicle, start)

    @property
    def aircraft(self) -> str:
        """Place of the aircraft file."""
        name = file_name(self.vehicle.name)
        return f"aircraft/{name}/{name}.xml"

    def files(self) -> Exported:
        """Return the files, and which properties drive the aircraft."""
        vehicle = self.vehicle
        driving = {channel(n): VARIABLES[n].unit if n in VARIABLES else "1" for n in vehicle.recorded}
        if vehicle.file.propulsion is not None and vehicle.file.propulsion.kind == "constant":
            driving[THRUST] = "N"
        named = [place if unit == "1" else f"{place} ({unit})" for place, unit in driving.items()]
        notes = (f"To be set in flight: {', '.join(named)}.",) if named else ()
        return Exported(encoded(self.texts), self.aircraft, notes)

    def lacks(self) -> list[str]:
        """Return that JSBSim has no slopes of the channels."""
        return [SLOPES.format(", ".join(self.vehicle.sloped))] if self.vehicle.sloped else []

    def fly(self, made: Exported) -> Exported:
        """Fly the steady flight and the maneuvers, and add their page."""
        missing = [self.start] if isinstance(self.start, str) else []
        if not installed("jsbsim"):
            return made.with_notes([*missing, NOT_FLOWN])
        maneuvers = [with_restarts(maneuver) for maneuver in self.model.maneuvers]
        record = None if isinstance(self.start, str) else reference_record(self.vehicle, self.start)
        if record is not None:
            maneuvers.insert(0, record)
        flown: list[Comparison] = []
        for maneuver in maneuvers:  # another loading is exported with its maneuver
            texts = jsbsim_aircraft.folder(maneuver.vehicle, None) if maneuver.loaded else self.texts
            with written(texts) as root:
                try:
                    flown.append(compare(root, maneuver))
                except SimulationError as error:  # the model cannot hold it open loop; the others are flown
                    missing.append(f"{maneuver.title}: {error}.")
        made = made.with_notes(missing)
        name = file_name(self.vehicle.name)
        page = export_page(self.vehicle, self.texts[self.aircraft], name, flown, made.notes)
        files = {**made.files, **encoded({EXPORT_PAGE: page})}
        return replace(made, files=files, main=EXPORT_PAGE).with_notes(map(str, flown))
