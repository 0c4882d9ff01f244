"""Pages of a model structure that was determined, and of an aircraft that was exported to JSBSim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.numbers import NOTHING, factor_and_unit
from stoop.base.variables import VARIABLES, WRAPPED
from stoop.estimate.regression.least_squares import TimeDomain
from stoop.estimate.regression.structure import Structure
from stoop.exporters.jsbsim_aircraft import relative_errors
from stoop.exporters.jsbsim_flight import FRAME_RATE, PLANET, Comparison, differences, relative_differences
from stoop.exporters.jsbsim_model import actuators
from stoop.report.series import Series
from stoop.report.sheet import Bullets, Code, Part, Prose, Section, Sheet, Table, render_sheet
from stoop.report.time_history import HistoryPanel, TimeHistory, with_residual
from stoop.vehicle import Vehicle

STRUCTURE_LEAD: Final = """\
Nondimensional coefficients were computed sample by sample from measured accelerations and rates, with the mass \
properties and the thrust of the vehicle file; terms were then chosen among candidates. A constant is always there. \
The estimates are those of a regression: a start for stoop identify, not its result."""
EXPORT_PAGE: Final = "export.html"
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


def structure_sheet(
    structure: Structure,
    vehicle: Vehicle,
    names: Mapping[str, Mapping[str, str]],
    estimates: Mapping[str, tuple[float, float]],
    command: str,
) -> Sheet:
    """Return the page: chosen terms, the steps to them, and the coefficients over time.

    `names` are parameters by coefficient and term; `estimates` are estimate and standard error by parameter.
    """
    steps_head = ("step", "action", "term", "partial F", "threshold", "terms", "R²", "PRESS", "PSE")
    sections = []
    for coefficient, chosen in structure.chosen.items():
        constants = [("1", n) for n, t in vehicle.terms[coefficient].items() if t.strip() == "1"]
        rows = []
        for term, name in (*constants, *names[coefficient].items()):
            value, std = estimates.get(name, (np.nan, np.nan))
            shown = [f"{v:.4g}".replace("-", "−") if np.isfinite(value) else NOTHING for v in (value, std)]
            rows.append((term, name, *shown))
        table = Table("Chosen terms", ("term", "parameter", "estimate", "std. error"), tuple(rows))
        share = 100.0 * chosen.selection.model.r2
        summary = f"{len(chosen.terms)} of {len(chosen.candidates)} candidates; they explain {share:.1f} % of the variation."
        steps = tuple(
            (
                str(i), s.action, chosen.candidates[s.column], f"{s.f:.1f}", f"{s.threshold:.3g}", str(len(s.model.columns)),
                f"{s.model.r2:.4f}", f"{s.model.press:.3e}", f"{s.model.pse:.3e}",
            )
            for i, s in enumerate(chosen.selection.steps, 1)
        )  # fmt: skip
        caption = "Steps; F of the term, R², PRESS and PSE of the model after the step"
        smooth, panels = TimeDomain(), []
        for number, history in enumerate(structure.histories, 1):
            terms, nothing = vehicle.terms[coefficient].items(), np.zeros(len(history.time))
            modeled = sum((vehicle.value(n) * history.regressor(t) for n, t in terms), nothing)
            columns = np.column_stack([history.coefficients[coefficient], modeled, history.time])
            measured, modeled, time = smooth.rows(columns, history.dt).T
            if len(time):
                curves = (
                    Series("measured", time, measured, role="measured", width=2.8),
                    Series("chosen terms", time, modeled, role="fit"),
                )
                strips = with_residual(curves, "measured − chosen terms", measured - modeled)
                panels.append(HistoryPanel(coefficient, strips, meaning=f"stretch {number}"))
        title = f"{coefficient} as it was flown, smoothed over {smooth.span:g} s, and the chosen terms, against time in s."
        drawn = [TimeHistory([panel]) for panel in panels]
        parts: list[Part] = [Prose(summary), table, Prose(title), *drawn, Table(caption, steps_head, steps)]
        sections.append(Section(coefficient, parts))
    notes = [n for chosen in structure.chosen.values() for n in chosen.notices] + list(structure.notices)
    first = [Section("Notes", (Bullets(notes),))] if notes else []
    made = Section("Made by", (Code(command),))
    return Sheet(f"Model structure of {vehicle.name}", STRUCTURE_LEAD, (*first, *sections, made))


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
        caption = Prose(f"{measured} our simulation and by JSBSim, against time in s, and their difference.")
        sections.append(Section(title, (_differences(one), caption, _history(one))))
    sections.append(Section("Why they differ at all", (Prose(EXPLANATION.format(rate=FRAME_RATE)),)))
    sections += [Section("Notes", (Bullets(notes),))] if notes else []
    sections.append(Section("Fly it", (Code(SCRIPT.format(planet=PLANET, name=name)),)))
    return render_sheet(Sheet(f"{vehicle.name} in JSBSim", lead, tuple(sections)))


def _differences(flown: Comparison) -> Table:
    vehicle, measured = flown.record.vehicle, flown.record.measured
    columns = {"JSBSim, flat planet": flown.relative}
    if actuators(vehicle):
        columns["on JSBSim's frames"] = relative_differences(vehicle, flown.fine, flown.flat)
    columns["JSBSim, Earth"] = relative_differences(vehicle, flown.own, flown.earth)
    head = ["channel", "largest magnitude", *columns]
    errors: list[FloatArray] = []
    if measured is not None:
        head += ["flight less simulation, rms", "flight less JSBSim, rms"]
        errors = [differences(vehicle, y, measured) for y in (flown.own, flown.flat)]
    rows = []
    for i, channel in enumerate(vehicle.outputs):
        factor, unit = factor_and_unit(VARIABLES[channel].unit)
        sizes = [float(np.abs(flown.own[:, i]).max())]
        for error in errors:  # NaN where nothing was measured
            known = error[np.isfinite(error[:, i]), i]
            sizes.append(float(np.sqrt(np.mean(known**2))) if known.size else np.nan)
        largest, *rms = (f"{x * factor:.4g} {unit}" if np.isfinite(x) else NOTHING for x in sizes)
        rows.append((channel, largest, *(f"{column[channel]:.1e}" for column in columns.values()), *rms))
    caption = "Largest difference from our simulation, as a fraction of the channel's largest magnitude"
    return Table(caption, tuple(head), tuple(rows))


def _history(flown: Comparison) -> TimeHistory:
    """Return every channel as flown and simulated, and the difference between the simulations below."""
    record, measured, panels = flown.record, flown.record.measured, []
    for i, channel in enumerate(record.vehicle.outputs):
        factor, unit = factor_and_unit(VARIABLES[channel].unit)
        curves = {"stoop": flown.own[:, i], "JSBSim": flown.flat[:, i]}
        if measured is not None:
            curves = {"flight": measured[:, i], **curves}
        series = {}
        for name, y in curves.items():
            known = np.isfinite(y)
            if channel in WRAPPED and known.any():  # an angle without jumps, near zero where it begins
                y = y.copy()
                y[known] = np.unwrap(y[known])
                y -= 2.0 * np.pi * np.round(y[known][0] / (2.0 * np.pi))
            series[name] = Series(name, record.time, factor * y, role=ROLES[name], width=WIDTHS[name])
        difference = series["JSBSim"].y - series["stoop"].y
        strips = with_residual(list(series.values()), "JSBSim − stoop", difference)
        panels.append(HistoryPanel(channel, strips, unit, VARIABLES[channel].meaning))
    return TimeHistory(panels)
