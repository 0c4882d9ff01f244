"""The page of an experiment design: the maneuver, the response, and the expected standard errors."""

from __future__ import annotations

import math

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.numbers import factor_and_unit, number
from stoop.base.variables import VARIABLES
from stoop.input_design.optimization import Proposal
from stoop.report.plots import Series, Strip, plot, stacked_plots
from stoop.report.sheet import Code, Figure, Prose, Section, Sheet, Table
from stoop.simulation import Maneuver

LEAD = """\
The input below is the one, of those tried, whose flight makes the error bars of the parameters of {vehicle} smallest \
together (D-optimality), as far as the model is right that it was designed for: {source}. It stays within the amplitude, \
the slew and the envelope that are listed. Compared with it is what the textbook flies: a 3-2-1-1 on one control after the \
other, of the same duration and amplitude."""
EXPECTED = """\
Standard errors before the flight, after the textbook's flight, and after the designed one. They are predictions: the \
Cramer-Rao bound for the noise of the sensors, with the initial state and the sensor biases unknown. Colored residuals widen \
all of them alike; a model that is wrong in kind is not in them."""
ROBUSTNESS = """\
The model is what is to be measured, so it is wrong. Flown with {draws} models drawn from what is known: {outside} left the \
envelope{most}, {untrimmed} did not fly straight at this speed. In those that stayed inside, the mean standard error was \
{low} to {high} of the textbook's."""
NOTHING_KNOWN = "Nothing is known of the parameters, so no other models were drawn: begin with half the amplitude, and watch."


def design_sheet(proposal: Proposal, command: str) -> Sheet:
    """Return the page of a proposal."""
    best = proposal.best
    lead = LEAD.format(vehicle=proposal.setup.vehicle.name, source=proposal.source)
    files = "maneuver.toml is what stoop simulate flies; maneuver.csv has the deflections from the trim, in rad, against time."
    return Sheet(
        f"What to fly next: {proposal.setup.vehicle.name}",
        lead,
        (
            Section("What to fly", (_inputs(best.maneuver), Prose(files), _families(proposal))),
            Section("Response", (_responses(proposal), _limits(proposal))),
            Section("Expected standard errors", (Prose(EXPECTED), _bars(proposal), _errors(proposal))),
            Section("If the model is wrong", (Prose(_robustness(proposal)),)),
            Section("Made by", (Code(command),)),
        ),
    )


def _inputs(maneuver: Maneuver) -> Figure:
    strips = [
        Strip(f"{control}, deg", (Series(control, maneuver.time, np.degrees(move)),))
        for control, move in maneuver.deflections().items()
    ]
    return Figure(
        "Deflections from the trim", stacked_plots(strips, "time, s", "Deflection of every control")
    )


def _families(proposal: Proposal) -> Table:
    rows = [
        (one.shape, f"{one.gain:.2f} per parameter", f"{proposal.ratio(one):.2f} of the textbook's")
        for one in proposal.designs
    ]
    head = ("family", "information gained", "mean standard error")
    return Table("The families that were tried", head, tuple(rows))


def _responses(proposal: Proposal) -> Figure:
    outputs, time = proposal.setup.vehicle.outputs, proposal.best.maneuver.time
    readings = proposal.best.forecast.readings
    strips = [
        _response(proposal, c, time, readings[:, outputs.index(c)]) for c in proposal.setup.limits.envelope
    ]
    return Figure(
        "Readings and their limits",
        stacked_plots(strips, "time, s", "Readings of the designed flight between their limits"),
    )


def _response(proposal: Proposal, channel: str, time: FloatArray, values: FloatArray) -> Strip:
    factor, shown = factor_and_unit(VARIABLES[channel].unit)
    ends = time[[0, -1]]
    limits = [
        Series("limits", ends, np.full(2, factor * edge)) for edge in proposal.setup.limits.envelope[channel]
    ]
    return Strip(f"{channel}, {shown}", (Series("reading", time, factor * values), *limits))


def _limits(proposal: Proposal) -> Table:
    limits = proposal.setup.limits
    rows = [
        (c, f"±{math.degrees(a):.3g} deg", f"{math.degrees(limits.slew):.3g} deg/s")
        for c, a in limits.amplitude.items()
    ]
    return Table("Limits of the controls", ("control", "amplitude", "slew"), tuple(rows))


def _bars(proposal: Proposal) -> Figure:
    """Draw the standard errors over the textbook's, by parameter."""
    setup = proposal.setup
    base = setup.std(proposal.expected)
    place = np.arange(1.0, len(base) + 1.0)
    with np.errstate(invalid="ignore"):
        series = [
            Series(one.shape, place, setup.std(one.forecast) / base, "points") for one in proposal.designs
        ]
    edge = Series("textbook", np.array([0.5, len(base) + 0.5]), np.ones(2))
    drawing = plot(
        [*series, edge],
        "parameter, in the order of the table",
        "standard error over the textbook's",
        "Standard errors of every parameter over the textbook's",
    )
    return Figure("Below one is better than the textbook", drawing)


def _errors(proposal: Proposal) -> Table:
    setup, best = proposal.setup, proposal.best
    columns = (proposal.now, setup.std(proposal.expected), setup.std(best.forecast))
    rows = []
    for i, name in enumerate(setup.names):
        now, textbook, designed = (float(c[i]) for c in columns)
        shown = [number(v, 3) if np.isfinite(v) else "unknown" for v in (now, textbook, designed)]
        rows.append((name, number(float(setup.values[i]), 4), *shown, f"{designed / textbook:.2f}"))
    head = ("parameter", "believed", "now", "textbook", "designed", "designed over textbook")
    return Table("Standard errors", head, tuple(rows))


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
