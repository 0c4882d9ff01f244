"""Pages of planning: what to fly next and the standard errors to expect, and which windows of a flight to fit."""

from __future__ import annotations

import math
import shlex
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final, Literal

import numpy as np

from stoop import Flight
from stoop.extend.motion import Maneuver
from stoop.extend.reports import plots, sheet
from stoop.extend.text import factor_and_unit, number
from stoop.extend.variables import FAMILIES, VARIABLES
from stoop_plan.injection_targets import MANUAL_THROTTLE

if TYPE_CHECKING:  # the page of a flight takes colors and commands from here, and needs no optimization
    from stoop.extend.flights import Proposed
    from stoop_plan.input_design.optimization import Proposal
    from stoop_plan.input_design.windows import FoundWindows

DESIGN_LEAD: Final = """\
The input below is the one, of those tried, whose flight makes the error bars of the parameters of {vehicle} smallest \
together (D-optimality), as far as the model is right that it was designed for: {source}. It stays within the amplitude, \
the slew and the envelope that are listed. Compared with it is what the textbook flies: a {textbook} on one control after the \
other, of the same duration and amplitude."""
DESIGN_EXPECTED: Final = """\
Standard errors before the flight, after the textbook's flight, and after the designed one. They are predictions: the \
Cramer-Rao bound for the noise of the sensors, with the initial state and the sensor biases unknown. Colored residuals widen \
all of them alike; a model that is wrong in kind is not in them."""
#: use of a window -> color of its stretch
COLORS: Final[Mapping[str, Literal["fitted", "predicted", "declined"]]] = {
    "fit": "fitted", "predict": "predicted", "not used": "declined",
}  # fmt: skip
FLOWN: Final = (
    "Deflections from the trim, and the readings to expect between their limits, against time in s."
)
FROM_TRIM: Final = """\
The lines of the card are flown one by one, each once, with the whole stop and from trim: readings and standard errors are \
those of as many flights, each with an initial state and sensor biases of its own."""
ROBUSTNESS: Final = """\
The model is what is to be measured, so it is wrong. Flown with {draws} models drawn from what is known: {outside} left the \
envelope{most}, {untrimmed} did not fly straight at this speed. In those that stayed inside, the error bars together \
(D-optimality) were {low} to {high} of the textbook's."""
NOTHING_KNOWN: Final = """\
Nothing is known of the parameters, so no other models were drawn: begin with half the amplitude, and watch."""
WINDOWS_LEAD: Final = """\
Stretches of the flight that are worth fitting: those in which a pilot or an injected signal moved the controls far more than \
usual, chosen by {criterion}. Each was \
taken because it adds most for its length to those before it; the choice ends when another adds less than 5 % to the error \
bars. One of each axis that was flown twice is held out, where the others determine enough: what a model predicts there shows \
what it is worth. The windows avoid gaps, the ground, stuck sensors and saturated motors. Edit {name} beside this page to \
accept, move or decline, then run the command at the end."""
BY_VEHICLE: Final = (
    "their information about the free numbers of {vehicle} (Fisher's information, D-optimality)"
)
BY_COMMAND: Final = "how strongly, and how independently of each other, commands and rates move in them"
KEY: Final = """\
Blue: to be fitted. Orange: to be predicted. Grey with dashed edges: a maneuver that is not proposed, behind those that are. \
Information is the mean logarithm by which a window alone shrinks the error bars (0.69 halves them); gain, likewise, beside \
the windows chosen before it."""
EXPECTED: Final = """\
Standard errors that the windows to be fitted will give, as far as the vehicle file is right in kind: those of a quick fit of \
these windows, corrected for the color of its residuals and the scatter of the maneuvers, as those of stoop identify. {guess}"""
QUICK_FIT: Final = """\
The quick fit is that of stoop identify without its checks and figures. A dash: it leaves the number at a bound."""

FLOWN_FILES: Final = {
    "maneuver.lua": "script of ArduPilot Plane that adds the maneuver to what the autopilot commands",
    "ardupilot.param": "parameters of logs and scripting",
    "fly_px4.py": "script of the computer on board or on the ground, in offboard mode",
    "px4_setpoints.csv": "what it sends: outputs over time, and the rates to expect",
    "px4.params": "parameters of logs and offboard mode",
    "fly_crazyflie.py": "script of the computer with the radio",
    "crazyflie_setpoints.csv": "what it sends: attitude and height over time",
    "config.txt": "what the micro-SD deck logs",
}
SWEEP_FILE: Final = "parameters of the mode System ID for one axis: load it, fly the mode, load the next"
NO_IMPROVEMENT: Final = {
    True: "no design is better than the textbook's input: the files fly the textbook's; raise --evaluations",
    False: "no design is better than the textbook's input, which cannot be flown this way; raise --evaluations",
}  #: by whether the textbook's input is proposed
HOW_TO_FLY: Final = """\
Read the first lines of each file. Rehearse it in simulation and on the ground, and begin with half the amplitude. What \
moves the surfaces is the maneuver and the autopilot together, so the log, not this page, says what was flown."""


def design_sheet(proposal: Proposal, command: str, flown: Mapping[str, str] | None = None) -> sheet.Sheet:
    """Return the page of a proposal: the maneuver, the response, and the expected standard errors.

    ``flown`` are the files for a pilot or an autopilot.
    """
    best, setup = proposal.best, proposal.setup
    limits, time, outputs = setup.limits, best.maneuver.time, setup.vehicle.outputs
    deflections = []
    for control, move in best.maneuver.deflections().items():
        factor, unit = _given_in(control)
        strip = sheet.Strip("", (sheet.Series("deflection", time, factor * move, role="input"),))
        deflections.append(sheet.HistoryPanel(control, (strip,), unit))
    families = tuple(
        (one.shape, f"{one.gain:.2f} per parameter", f"{proposal.ratio(one):.2f} of the textbook's")
        for one in proposal.designs
    )
    responses = []
    for channel, span in limits.envelope.items():
        factor, unit = factor_and_unit(VARIABLES[channel].unit)
        edges = (
            sheet.Series("limits", time[[0, -1]], np.full(2, factor * edge), role="lag") for edge in span
        )
        reading = sheet.Series(
            "reading", time, factor * best.forecast.readings[:, outputs.index(channel)], role="fit"
        )
        meaning = VARIABLES[channel].meaning
        responses.append(sheet.HistoryPanel(channel, (sheet.Strip("", (reading, *edges)),), unit, meaning))
    controls = []
    for c, amplitude in limits.amplitude.items():
        factor, unit = _given_in(c)
        floor, slew = factor * limits.min_amplitude.get(c, 0.0), factor * limits.slew.get(c, math.inf)
        rate = f"{slew:.3g} {unit}/s" if math.isfinite(slew) else "–"
        controls.append(
            (c, f"±{factor * amplitude:.3g} {unit}", f"{floor:.3g} {unit}" if floor else "–", rate)
        )
    flown_by_it = (
        "maneuver.toml is" if setup.retrim is None else "maneuver_1.toml and so on, one for each line, are"
    )
    files = (
        f"{flown_by_it} what stoop simulate flies; maneuver.csv has the changes from the trim against time, in the units that "
        "it names."
    )
    head = ("family", "information gained", "error bars together (D-optimality)")
    tried = sheet.Table("The families that were tried", head, families)
    heads = ("control", "amplitude", "smallest amplitude", "slew")
    limited: list[sheet.Table | sheet.Bullets] = [
        sheet.Table("Limits of the controls", heads, tuple(controls))
    ]
    if proposal.refused:
        limited.append(sheet.Bullets(tuple(why for _, why in proposal.refused)))
    worse = () if proposal.is_improvement else (sheet.Bullets((NO_IMPROVEMENT[proposal.is_textbook],)),)
    lines = () if setup.retrim is None else (sheet.Prose(FROM_TRIM),)
    flown = dict(flown or {})
    by_hand: tuple[sheet.Section, ...] = ()
    if flown:
        listed = tuple((name, FLOWN_FILES.get(name, SWEEP_FILE)) for name in flown)
        sweeps = any(name.startswith("sid_") for name in flown)
        warned = (sheet.Bullets((MANUAL_THROTTLE,)),) if sweeps else ()
        how = (sheet.Table("", ("file", "what it is"), listed), *warned, sheet.Prose(HOW_TO_FLY))
        by_hand = (sheet.Section("How to fly it", how),)
    if "card.txt" in flown:
        by_hand = (sheet.Section("Flight card", (sheet.Code(flown["card.txt"]),)),)
    sections = (
        *by_hand,
        sheet.Section(
            "What to fly",
            (
                sheet.Prose(FLOWN),
                *lines,
                *worse,
                sheet.TimeHistory([*deflections, *responses]),
                sheet.Prose(files),
                tried,
            ),
        ),
        sheet.Section("Limits", tuple(limited)),
        sheet.Section(
            "Expected standard errors", (sheet.Prose(DESIGN_EXPECTED), *lines, *_standard_errors(proposal))
        ),
        sheet.Section("If the model is wrong", (sheet.Prose(_robustness(proposal)),)),
        sheet.Section("Made by", (sheet.Code(command),)),
    )
    lead = DESIGN_LEAD.format(
        vehicle=setup.vehicle.name, source=proposal.source, textbook=proposal.reference.input[0].shape
    )
    return sheet.Sheet(f"What to fly next: {setup.vehicle.name}", lead, sections)


def _given_in(control: str) -> tuple[float, str]:
    """Return factor and unit in which a control is given: degrees of a surface, the unit of a command as it is."""
    unit = Maneuver.unit_of(control)
    return factor_and_unit(unit) if unit == "rad" else (1.0, "" if unit == "1" else unit.replace("2", "²"))


def _standard_errors(proposal: Proposal) -> tuple[sheet.Figure, sheet.Table]:
    """Draw the standard errors over the textbook's, and list them by parameter."""
    setup, best = proposal.setup, proposal.best
    base = setup.std(proposal.expected)
    place = np.arange(1.0, len(base) + 1.0)
    series = [sheet.Series("textbook", np.array([0.5, len(base) + 0.5]), np.ones(2))]
    with np.errstate(invalid="ignore"):
        ratios = [(one.shape, setup.std(one.forecast) / base) for one in proposal.designs]
    series[:0] = [sheet.Series(shape, place, ratio, "points") for shape, ratio in ratios]
    labels = ("parameter, in the order of the table", "standard error over the textbook's")
    drawing = plots.plot(series, *labels, "Standard errors of every parameter over the textbook's")
    columns = (proposal.now, base, setup.std(best.forecast))
    rows = []
    for i, name in enumerate(setup.names):
        now, textbook, designed = (float(c[i]) for c in columns)
        shown = [number(v, 3) if np.isfinite(v) else "unknown" for v in (now, textbook, designed)]
        rows.append((name, number(float(setup.values[i]), 4), *shown, f"{designed / textbook:.2f}"))
    head = ("parameter", "believed", "now", "textbook", "designed", "designed over textbook")
    table = sheet.Table("Standard errors", head, tuple(rows))
    return sheet.Figure("Below one is better than the textbook", drawing), table


def _robustness(proposal: Proposal) -> str:
    robust = proposal.robustness
    if not np.any(proposal.setup.known):
        return NOTHING_KNOWN
    if not robust.ratios:
        return f"Of {robust.draws} models drawn from what is known, none stayed inside: begin with half the amplitude, and watch."
    most = f" (by {100.0 * robust.largest_excess:.0f} % of its width at most)" if robust.outside else ""
    low, high = (f"{v:.2f}" for v in (min(robust.ratios), max(robust.ratios)))
    return ROBUSTNESS.format(
        draws=robust.draws, outside=robust.outside, most=most, untrimmed=robust.untrimmed, low=low, high=high
    )


def windows_sheet(
    found: FoundWindows, flights: Mapping[str, Flight], vehicle: str, command: str, following: Sequence[str]
) -> sheet.Sheet:
    """Return the page; `vehicle` is its name or empty, `following` the words of the command that takes the file."""
    from stoop_plan.input_design.windows_file import NAME

    criterion = BY_VEHICLE.format(vehicle=vehicle) if vehicle else BY_COMMAND
    sections = [
        sheet.Section(
            f"The flight {name}" if len(flights) > 1 else "The flight", (flight_history(found, flight),)
        )
        for name, flight in flights.items()
    ]
    rows = tuple(
        (
            str(i), span_of(w, found), w.purpose, w.axis, f"{w.information:.2f}", f"{w.gain:.2f}" if w.gain else "–",
            str(w.why),
        )
        for i, w in enumerate(found.windows, 1)
    )  # fmt: skip
    head = ("number", "window s", "use", "axis", "information", "gain", "why")
    sections.append(sheet.Section("Windows", (sheet.Prose(KEY), sheet.Table("", head, rows))))
    if found.expected:
        errors = tuple(
            (e.name, *(number(x, k) if math.isfinite(x) else "–" for x, k in shown), percent(e.relative))
            for e in found.expected
            for shown in [((e.value, 4), (e.std_error, 3))]
        )
        table = sheet.Table("", ("parameter", "quick fit", "standard error", "of its size"), errors)
        guess = sheet.Prose(EXPECTED.format(guess=QUICK_FIT))
        sections.append(sheet.Section("Expected standard errors", (guess, table)))
    if found.notices:
        sections.append(sheet.Section("Notes", (sheet.Bullets(found.notices),)))
    sections.append(
        sheet.Section(
            "Next", (sheet.Code(shlex.join(following)), sheet.Prose("Made by"), sheet.Code(command))
        )
    )
    lead = WINDOWS_LEAD.format(criterion=criterion, name=NAME)
    return sheet.Sheet("Windows worth fitting", lead, tuple(sections))


def span_of(window: Proposed, found: FoundWindows) -> str:
    """Return start and stop of a window, s, and its flight where there are several."""
    several = len({w.flight for w in found.windows}) > 1
    return f"{window.flight}@" * several + window.span


def percent(share: float) -> str:
    """Return a share in percent."""
    large = "> 1000 %" if math.isfinite(share) else "–"
    return f"{100.0 * share:.1f} %" if share < 10.0 else large


def flight_history(found: FoundWindows, flight: Flight) -> sheet.TimeHistory:
    """Return commands, rates, speed and information over the whole flight, with the windows as shades."""
    own = [(i, w) for i, w in enumerate(found.windows, 1) if w.flight == flight.name]
    shades = [sheet.Shade(w.start, w.stop, str(i), COLORS[w.purpose]) for i, w in own]
    panels = []
    for command in flight.commands():
        known = VARIABLES.get(command.variable)
        combined = "m/s2" if command.axis == "heave" else "rad/s2"  # of several channels
        factor, unit = factor_and_unit(known.unit if known else combined)
        series = sheet.Series("command", flight.time, factor * command.u, role="input")
        panels.append(
            sheet.HistoryPanel(
                f"{command.axis} command", (sheet.Strip("", (series,)),), unit, command.variable
            )
        )
    rates = [name for name in FAMILIES["rates"] if name in flight.names]
    if rates:
        curves = (sheet.Series(n, flight.time, np.degrees(flight.column(n))) for n in rates)
        panels.append(sheet.HistoryPanel("rates", (sheet.Strip("", tuple(curves)),), "deg/s"))
    if set(FAMILIES["velocity"]) <= flight.names:
        speed = np.linalg.norm([flight.column(name) for name in FAMILIES["velocity"]], axis=0)
        series = sheet.Series("speed", flight.time, speed, role="validation")
        panels.append(sheet.HistoryPanel("speed over ground", (sheet.Strip("", (series,)),), "m/s"))
    panels.append(sheet.HistoryPanel("information", (information_strip([w for _, w in own]),)))
    prefix = f"{flight.name}@" if len({w.flight for w in found.windows}) > 1 else ""
    return sheet.TimeHistory(panels, f"--maneuver {prefix}", shades, wide=True)


def information_strip(windows: Sequence[Proposed]) -> sheet.Strip:
    """Return the information of each window as a level over its stretch, and nothing between them."""
    x = np.array([v for w in windows for v in (w.start, w.stop, np.nan)])
    y = np.array([v for w in windows for v in (w.information, w.information, np.nan)])
    return sheet.Strip("", (sheet.Series("information", x, y, role="fit", width=3.0),), zero=True)
