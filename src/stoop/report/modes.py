"""Natural modes of the fitted model, and repeatability over maneuvers."""

from __future__ import annotations

import math
from typing import Final

from stoop.base.numbers import NOTHING, number, readable_unit, rounded_to_error, window
from stoop.report.charts import repeatability_panel
from stoop.report.estimates import label
from stoop.report.sheet import Bullets, Heading, Panel, Panels, Part, Prose, Section, Table
from stoop.results.modes import Estimate, MeasuredMode, ModeEstimate
from stoop.results.result import Identification

MAX_DEVIATION: Final = 3.0  #: standard errors; of some twenty numbers on a page one is beyond two by chance
MODES_LEAD: Final = (
    "Of the fitted model, with 95 % intervals from the covariance of the parameters; beside them what a damped "
    "oscillation fitted to the record after the input shows, without any model of the aircraft; its error (±, one standard "
    "error) counts noise, what is no single oscillation, and that the response was flown about other airspeeds."
)
MODES_HEAD: Final = ("Mode", "rad/s", "95 %", "Damping", "95 %", "Time constant, s", "95 %", "In the record")
REPEATABILITY_LEAD: Final = (
    "Each fit has the same free parameters, bounds and priors; then each estimate’s own prior is taken out, so that it is "
    "the maneuver’s alone. A dash: not identifiable from that maneuver. Blue: one maneuver, 95 %; band: their weighted "
    "mean; black: the joint fit."
)
VERDICTS: Final = {"agree": "✓ agree", "scatter": "▲ scatter", "": NOTHING}


def modes_section(identification: Identification) -> Section | None:
    """Return the tables of all flight conditions; None without modes."""
    parts: list[Part] = [Prose(MODES_LEAD, muted=True)]
    for condition in identification.result.modes:
        flown = ", ".join(filter(None, (_window(identification, i) for i in condition.maneuvers)))
        about = "steady straight flight" if condition.about == "trim" else "the mean state"
        place = f"{number(condition.airspeed, 3)} m/s, {number(condition.altitude, 3)} m, flown in {flown}"
        title = f"About {about} at {place}"
        parts.append(Heading(title))
        parts += [Prose(str(condition.remark), muted=True)] if condition.remark else []
        rows = tuple(_mode(identification, mode) for mode in condition.modes)
        kinds = ("", *("n",) * 6, "wrap")
        parts += [Table("", MODES_HEAD, rows, kinds, label=title)] if rows else []
    return Section("Natural modes", parts, "Modes") if identification.result.modes else None


def _window(identification: Identification, maneuver: int) -> str:
    maneuvers = identification.result.maneuvers
    return window(maneuvers[maneuver].start, maneuvers[maneuver].stop) if maneuver < len(maneuvers) else ""


def _mode(identification: Identification, mode: ModeEstimate) -> tuple[str, ...]:
    oscillates = mode.imag.estimate > 0.0
    remarks = [_measured(identification, mode, one) for one in mode.measured if oscillates]
    remarks += [str(mode.remark), "intervals sampled" if mode.method == "sampled" else ""]
    oscillation = (*_pair(mode.frequency), *_pair(mode.damping)) if oscillates else (NOTHING, "") * 2
    return mode.name, *oscillation, *_pair(mode.time_constant), "; ".join(filter(None, remarks))


def _pair(one: Estimate) -> tuple[str, str]:
    """Return an estimate and its interval."""
    value = rounded_to_error(one.estimate, one.std_error)[0]
    if not (math.isfinite(one.ci95_lower) and math.isfinite(one.ci95_upper)):
        return value, NOTHING
    width = 0.25 * (one.ci95_upper - one.ci95_lower)
    return value, " … ".join(rounded_to_error(end, width)[0] for end in (one.ci95_lower, one.ci95_upper))


def _measured(identification: Identification, mode: ModeEstimate, one: MeasuredMode) -> str:
    """Return a mode as the record shows it, compared with the model in units of both standard errors."""
    if math.isnan(one.frequency.estimate):
        return f"{_window(identification, one.maneuver)}: {one.remark}"
    pairs = ((mode.frequency, one.frequency), (mode.damping, one.damping))
    errors = [math.hypot(a.std_error, b.std_error) for a, b in pairs]
    off = [abs(a.estimate - b.estimate) / e for (a, b), e in zip(pairs, errors, strict=True) if e > 0.0]
    agreement = "agrees with the model"
    if not off or not all(map(math.isfinite, off)):
        agreement = "no interval to compare with"
    elif max(off) > MAX_DEVIATION:
        agreement = f"{max(off):.1f} standard errors from the model"
    found = (one.frequency, one.damping)
    frequency, damping = (" ± ".join(rounded_to_error(e.estimate, e.std_error)) for e in found)
    where = f"{', '.join(one.channels)} in {window(one.start, one.stop)}"
    return f"{frequency} rad/s, damping {damping} ({where}): {agreement}"


def repeatability_section(identification: Identification) -> Section | None:
    """Return plots and table of the maneuvers fitted alone; None where that was not asked for."""
    found, result = identification.result.repeatability, identification.result
    if not found.maneuvers:
        return None
    titles = tuple(_window(identification, i) for i in found.maneuvers)
    listed = [f"{i}: {title}" for i, title in enumerate(titles, 1)] + list(map(str, found.remarks))
    lead = Prose(f"{found.summary()} {REPEATABILITY_LEAD}", muted=True)
    parts: list[Part] = [lead, Bullets(listed)]
    panels, rows = [], []
    for name, one in found.parameters.items():
        if not any(single.counted for single in one.singles):
            continue
        joint = result.parameters[name]
        verdict = VERDICTS[one.verdict] + (f" (p = {number(one.p_value, 2)})" if one.verdict else "")
        shown, unit = label(identification, name), readable_unit(joint.unit)
        panels.append(Panel(shown, repeatability_panel(name, one, joint), unit, note=verdict))
        singles = (_with_error(s.estimate, s.std_error) if s.counted else NOTHING for s in one.singles)
        mean, whole = _with_error(one.mean, one.std_error), _with_error(joint.estimate, joint.std_error)
        chi = f"{number(one.chi_square, 3)} / {one.degrees}" if one.verdict else NOTHING
        rows.append((shown, *singles, mean, whole, unit, chi, verdict))
    if rows:
        head = ("Parameter", *titles, "Weighted mean", "Joint fit", "Unit", "χ² / degrees", "Scatter")
        kinds = ("", *("n" for _ in titles), "n", "n", "", "n", "")
        parts += [Panels(panels), Table("", head, tuple(rows), kinds, label="Repeatability")]
    return Section("Repeatability: each maneuver fitted alone", parts, "Repeatability")


def _with_error(value: float, error: float) -> str:
    return " ± ".join(rounded_to_error(value, error)) if math.isfinite(error) else number(value)
