"""The page of `stoop frequency`: Bode plots of flight against model, bandwidths, and low-order equivalent systems."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

from stoop.extend.fits import DerivedValue
from stoop.extend.flights import FrequencyResponse
from stoop.extend.reports import response_panels, sheet
from stoop.extend.text import enumerated, number
from stoop_analysis.frequency import (
    AXES,
    MAX_ERROR,
    MIN_COHERENCE,
    Figures,
    FrequencyAnalysis,
    ModelResponse,
    known,
)
from stoop_analysis.handling import EquivalentSystem

MIN_POINTS: Final = 3  #: known ones, of a response that is drawn
LEGEND: Final = (
    ("swatch flightkey", "flight, with 95 % random error"),
    ("swatch modelkey", "model, with 95 % of its uncertainty"),
    ("swatch coherencekey", "coherence"),
)
LEAD: Final = """\
Responses of {outputs} to {inputs}, {windows}. Each is conditioned: what the other inputs explain is taken off. Drawn is what \
has a coherence of {coherence:g} and more and a random error below {error:.0f} %."""
BANDWIDTH_LEAD: Final = """\
Of the attitude, which is the rate divided by jω, to the deflection; with 95 % intervals. The bandwidth of a response that \
is flown with attitude control is the phase bandwidth, of any other the lower one. What the band does not reach has no value."""
SYSTEM_LEAD: Final = """\
Fitted to magnitude and phase, weighted by coherence; a cost below 50 to 100 is usually taken as a good fit. A parameter \
without an interval is not determined by these frequencies."""
FORMS: Final = {
    "short period": "gain (s + zero) e^(−delay s) / (s² + 2 damping frequency s + frequency²)",
    "roll": "gain e^(−delay s) / (time_constant s + 1)",
    "rotors": "gain e^(−delay s) / (s (time_constant s + 1))",
    "Dutch roll": "gain (s + zero) e^(−delay s) / (s² + 2 damping frequency s + frequency²)",
}
UNITS: Final = {"zero": "1/s", "frequency": "rad/s", "time_constant": "s", "delay": "s"}


def frequency_sheet(found: FrequencyAnalysis, command: str = "") -> sheet.Sheet:
    """Return the page."""
    parts = [w.flight + " " + f"{w.start:g}:{w.stop:g} s" for w in found.windows]
    lead = LEAD.format(
        outputs=enumerated(found.outputs, 8),
        inputs=enumerated(found.inputs, 8),
        windows=enumerated(parts, 8),
        coherence=MIN_COHERENCE,
        error=100.0 * MAX_ERROR,
    )
    condition = condition_text(found)
    sections = [_bode(found, condition)]
    if found.figures:
        bands = [one for one in found.figures if one.bandwidth is not None and one.bandwidth.reached]
        sections += [_bandwidths(bands)] if bands else []
        systems = [one for one in found.figures if one.system is not None]
        sections += [_systems(systems)] if systems else []
    sections += [sheet.Section("Notes", (sheet.Bullets(found.notices, "notes"),))] if found.notices else []
    sections += [sheet.Section("Made by", (sheet.Code(command),))] if command else []
    return sheet.Sheet(f"Frequency responses: {enumerated(found.flights, 8)}", lead, tuple(sections))


def shown_pairs(found: FrequencyAnalysis) -> list[tuple[FrequencyResponse, ModelResponse | None]]:
    """Return the responses that are drawn: those known well enough, and of each rate that to its own control."""
    return [
        (one, found.model.get((one.input, one.output)))
        for one in found.responses
        if one.input in AXES.get(one.output, ()) or int(known(one).sum()) >= MIN_POINTS
    ]


def condition_text(found: FrequencyAnalysis) -> str:
    """Return the flight condition of the model with units."""
    units = {"airspeed": "m/s", "altitude": "m", "density": "kg/m³"}
    return ", ".join(f"{name} {number(value)} {units[name]}" for name, value in found.condition.items())


def _bode(found: FrequencyAnalysis, condition: str) -> sheet.Section:
    pairs = shown_pairs(found)
    if not pairs:
        return sheet.Section("Bode plots", (sheet.Bullets(["no response is known well enough to be drawn"]),))
    parts: list[sheet.Part] = []
    if found.model:
        parts.append(
            sheet.Prose(
                f"The model is linearized about its steady straight flight at {condition}.", muted=True
            )
        )
        parts.append(sheet.Legend(LEGEND))
    parts.append(sheet.Panels(response_panels(pairs, MAX_ERROR, MIN_COHERENCE), "large"))
    return sheet.Section("Bode plots", parts)


def estimates(system: EquivalentSystem) -> dict[str, str]:
    """Return the parameters as text; beside those that have intervals, one without is not determined."""
    known_ones = [one for one in system.parameters.values() if math.isfinite(one.ci95_lower)]
    return {
        name: interval(one)
        if math.isfinite(one.ci95_lower) or not known_ones
        else f"not determined ({number(one.estimate, 3)})"
        for name, one in system.parameters.items()
    }


def interval(one: DerivedValue, digits: int = 3) -> str:
    """Return a number with its 95 % interval, if it has one."""
    if math.isnan(one.estimate):
        return "–"
    value = number(one.estimate, digits)
    if math.isnan(one.ci95_lower):
        return value
    return f"{value} ({number(one.ci95_lower, digits)} to {number(one.ci95_upper, digits)})"


def _bandwidths(figures: Sequence[Figures]) -> sheet.Section:
    rows = []
    for one in figures:
        band = one.bandwidth
        if band is not None:
            cells = (band.phase_bandwidth, band.gain_bandwidth, band.crossover, band.phase_delay)
            rows.append((f"{one.output} over {one.input}", one.source, *map(interval, cells)))
    head = (
        "rate",
        "of",
        "phase bandwidth, rad/s",
        "gain bandwidth, rad/s",
        "180 deg lag, rad/s",
        "phase delay, s",
    )
    table = sheet.Table("", head, tuple(rows), label="Bandwidth and phase delay")
    return sheet.Section(
        "Bandwidth and phase delay", (sheet.Prose(BANDWIDTH_LEAD, muted=True), table), "Bandwidth"
    )


def _systems(figures: Sequence[Figures]) -> sheet.Section:
    rows = []
    for one in figures:
        system = one.system
        if system is not None:
            span = f"{number(system.lowest, 3)} to {number(system.highest, 3)}"
            for name, value in estimates(system).items():
                unit = UNITS.get(name, "")
                rows.append(
                    (
                        f"{system.name}, {one.output} over {one.input}", one.source, f"{name} {unit}".strip(), value,
                        span, number(system.cost, 3),
                    )
                )  # fmt: skip
    head = ("system", "of", "parameter", "estimate (95 % interval)", "rad/s", "cost")
    forms = dict.fromkeys(one.system.name for one in figures if one.system is not None)
    texts = sheet.Bullets([f"{name}: {FORMS[name]}" for name in forms])
    table = sheet.Table("", head, tuple(rows), label="Low-order equivalent systems")
    parts = (sheet.Prose(SYSTEM_LEAD, muted=True), texts, table)
    return sheet.Section("Low-order equivalent systems", parts, "Equivalent systems")
