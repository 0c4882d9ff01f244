"""The page of a flight: its channels over time with gaps, faults and windows, its path, spectra, and frequency responses."""

from __future__ import annotations

import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from stoop.base.numbers import NOTHING, factor_and_unit, number
from stoop.base.variables import RATES, VARIABLES, WRAPPED
from stoop.flight import Flight, FlightSummary
from stoop.flight.frequency_responses import FrequencyResponse
from stoop.flight.spectra import frequency_responses, power_spectra, spectrogram
from stoop.report.bode_plots import response_panels
from stoop.report.plots import heat_maps, plot
from stoop.report.series import HUES, KINDS, Series, Shade, Strip
from stoop.report.sheet import Bullets, Code, Details, Panel, Panels, Part, Prose, Section, Sheet, Table
from stoop.report.time_history import HistoryPanel, TimeHistory
from stoop.report.track import Track

if TYPE_CHECKING:
    from stoop.flight.windows import Found, Overview

ACCELERATIONS: Final = ("ax", "ay", "az")
GROUPS: Final = (
    ("surfaces", ("elevator", "aileron", "rudder", "flap")),
    (
        "commands",
        ("control_roll", "control_pitch", "control_yaw", "control_throttle", "throttle", "injected"),
    ),
    ("rates", RATES),
    ("attitude", ("phi", "theta", "psi")),
    ("specific force", ACCELERATIONS),
    ("velocity over ground", ("vn", "ve", "vd")),
    ("height", ("altitude", "height")),
    ("airspeed", ("V", "airspeed_pitot", "airspeed_equivalent")),
    ("flow angles", ("alpha", "beta")),
    ("wind as logged", ("wind_n", "wind_e")),
    ("position", ("pn", "pe", "pd")),
    ("servos", "servo_"),
    ("motors", "motor_"),
    ("rotor speeds", "rotor_"),
    ("output pulses", "pwm_"),
)  #: variables that share a panel, or the beginning of their names
#: shown otherwise
UNSHOWN: Final = frozenset(("q0", "q1", "q2", "q3", "vn_smooth", "ve_smooth", "vd_smooth"))
LONG: Final = 0.9  #: share of the flight; a fault of it all is listed and not shaded
MAX_ERROR: Final = 0.7  #: of a response's magnitude, beyond which it is not drawn
LEAD: Final = """\
{span} at {rate:g} Hz, {channels} channels. Blue: windows worth fitting; orange: worth predicting; grey with dashed edges: other \
maneuvers; red: suspected faults. Where a curve is interrupted nothing was recorded. Drag to zoom; choose "window" and drag to \
cut a window of your own."""
SPECTRA_LEAD: Final = """\
One-sided power spectral densities of the whole record, windows of {window:g} s with half overlap. Peaks above some 10 Hz are \
vibration, most often of propellers; what is filtered on board is missing."""
RESPONSES_LEAD: Final = """\
Rate over command of the same axis over rad/s, with coherence; the bands are 95 % random error. Where the coherence is low the \
rate does not answer the command alone, and under an autopilot the response is also that of its feedback: use windows."""


def flight_sheet(seen: Overview, command: str = "", following: Sequence[str] = ()) -> Sheet:
    """Return the page; `command` made it, `following` is the command that fits the windows."""
    summary, found, flight = seen.summary, seen.found, seen.summary.flight
    start, stop = float(flight.time[0]), float(flight.time[-1])
    notices = [one for one in summary.notices if one not in [fault.notice for fault in flight.faults]]
    defects = Bullets([fault.notice for fault in flight.faults] or ["none found"])
    sections = [
        Section("Suspected faults", (defects,), "Faults"),
        Section("Time histories", (flight_history(flight, found),)),
    ]
    track = Track.of(flight)
    sections += [Section("Path", (track,))] if track else []
    sections += [one for one in (_spectra(flight), _responses(frequency_responses(flight))) if one]
    sections.append(_windows(found, seen.why, following))
    sections.append(_channels(summary))
    sections += [Section("Notes", (Bullets(notices, "notes"),))] if notices else []
    if flight.parameters:
        rows = tuple((name, number(value, 7)) for name, value in sorted(flight.parameters.items()))
        table = Table("", ("parameter", "value"), rows, label="Parameters of the autopilot")
        sections.append(Section("Autopilot", (Details(f"{len(rows)} parameters", (table,)),)))
    sections += [Section("Made by", (Code(command),))] if command else []
    span = f"{start:.2f} to {stop:.2f} s on the log's own clock ({stop - start:.1f} s)"
    lead = LEAD.format(span=span, rate=flight.rate, channels=len(summary.rows))
    return Sheet(flight.name, lead, tuple(sections), "flight")


def flight_history(flight: Flight, found: Found) -> TimeHistory:
    """Return all channels, those alike in one panel, with windows and faults as shades."""
    panels = channel_panels(flight, [str(name) for name in flight.channels if name not in UNSHOWN])
    shades = [Shade(w.start, w.stop, str(i), KINDS[w.purpose]) for i, w in enumerate(found.windows, 1)]
    length = float(flight.time[-1] - flight.time[0])
    faults = (one for one in flight.faults if one.stop - one.start < LONG * length)
    shades += [Shade(one.start, one.stop, "", "fault") for one in faults]
    return TimeHistory(panels, "--maneuver ", shades, wide=True, each=True)


def channel_panels(flight: Flight, chosen: Sequence[str] | None = None) -> list[HistoryPanel]:
    """Return panels of those of the chosen channels that hold a value, those alike in one; by default of `GROUPS`."""
    given = flight.channels if chosen is None else chosen
    names = [name for name in given if np.isfinite(flight.column(name)).any()]
    panels, shown = [], set[str]()
    for title, members in GROUPS:
        own = [n for n in names if (n.startswith(members) if isinstance(members, str) else n in members)]
        panels += [_panel(flight, title, own)] if own else []
        shown.update(own)
    others = [name for name in names if name not in shown and chosen is not None]
    return [*panels, *(_panel(flight, name, [name]) for name in others)]


def _panel(flight: Flight, title: str, names: Sequence[str]) -> HistoryPanel:
    factor, unit = factor_and_unit(VARIABLES[names[0]].unit if names[0] in VARIABLES else "")
    curves = []
    for i, name in enumerate(names):
        values = factor * flight.column(name)
        if name in WRAPPED:  # a turn is a jump, not a curve
            values = np.where(np.abs(np.diff(values, prepend=values[:1])) > factor * np.pi, np.nan, values)
        curves.append(Series(name, flight.time, values, role=f"hue{i % HUES}", width=1.2))
    meaning = VARIABLES[names[0]].meaning if len(names) == 1 and names[0] in VARIABLES else ""
    return HistoryPanel(title, (Strip("", tuple(curves), height=96.0),), unit, meaning, name=title)


def _spectra(flight: Flight) -> Section | None:
    panels: list[Panel] = []
    for title, names in (("Rates", RATES), ("Specific force", ACCELERATIONS)):
        found = power_spectra(flight, [n for n in names if n in flight.names])
        if found:
            unit = VARIABLES[names[0]].unit
            curves = [Series(one.name, one.frequency, one.density) for one in found]
            about = f"Power spectra: {title}"
            drawn = plot(curves, "Hz", f"({unit})²/Hz", about, log_x=True, log_y=True)
            panels.append(Panel(title, drawn))
    if not panels:
        return None
    known = [n for n in (*RATES, *ACCELERATIONS) if n in flight.names and np.isfinite(flight.column(n)).any()]
    maps: list[Panel] = []
    if known:  # all pictures have the same axes
        over_time = [spectrogram(flight, name) for name in known]
        densities = {f"Spectrogram of {one.name}": one.density for one in over_time}
        pictures = heat_maps(over_time[0].time, over_time[0].frequency, densities, "time, s", "Hz")
        maps = [Panel(n, p, meaning=VARIABLES[n].meaning) for n, p in zip(known, pictures, strict=True)]
    parts: list[Part] = [Prose(SPECTRA_LEAD.format(window=10.0), muted=True), Panels(panels, "large")]
    parts += [Prose("Over time, brighter is stronger by decades:", muted=True), Panels(maps)] if maps else []
    return Section("Spectra", parts)


def _responses(found: Sequence[FrequencyResponse]) -> Section | None:
    found = [one for one in found if (one.bound < MAX_ERROR).any()]
    if not found:
        return None
    panels = response_panels([(one, None) for one in found], MAX_ERROR)
    return Section("Frequency responses", (Prose(RESPONSES_LEAD, muted=True), Panels(panels, "large")))


def _windows(found: Found, why: str, following: Sequence[str]) -> Section:
    if not found.windows:
        return Section("Windows", (Bullets([f"none found: {why}"]),))
    rows = []
    for i, w in enumerate(found.windows, 1):
        peak = number(w.maneuver.strength, 3) if w.maneuver else NOTHING
        rows.append((str(i), w.span, w.purpose, w.axis, peak, str(w.why)))
    head = ("number", "window s", "use", "axis", "peak, times usual", "why")
    table = Table("", head, tuple(rows), label="Windows")
    next_step = (Code(shlex.join(following)),) if following else ()
    return Section("Windows worth fitting", (table, *next_step), "Windows")


def _channels(summary: FlightSummary) -> Section:
    rows = tuple(
        (
            row.variable, row.unit, number(row.minimum), number(row.median), number(row.maximum), row.source,
            number(row.rate, 3), str(row.gaps), number(row.longest_gap, 3), f"{100.0 * row.missing:.1f} %", row.meaning,
        )
        for row in summary.rows
    )  # fmt: skip
    recorded = ("source", "Hz", "gaps", "longest, s", "missing", "meaning")
    head = ("channel", "unit", "lowest", "median", "highest", *recorded)
    kinds = ("", "", "n", "n", "n", "", "n", "n", "n", "n", "wrap")
    return Section("Channels", (Table("", head, rows, kinds, label="Channels"),))
