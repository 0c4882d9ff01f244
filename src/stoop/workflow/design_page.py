"""The page of a design: what to fly, how the aircraft answers, what it will tell."""

from __future__ import annotations

import math

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.numbers import number
from stoop.design import Design
from stoop.flight import VARIABLES
from stoop.report.plots import Series, Strip, plot, stacked_plots
from stoop.report.sheet import Code, Figure, Prose, Section, Sheet, Table
from stoop.simulate import Maneuver
from stoop.workflow.design import Proposal

LEAD = """\
The input below is the one, of those tried, whose flight makes the error bars of the parameters of {vehicle} smallest \
together (D-optimality), as far as the model is right that it was designed for: {source}. It stays within the amplitude, \
the slew and the envelope that are listed. Compared with it is what the textbook flies: a 3-2-1-1 on one control after the \
other, of the same duration and amplitude."""
TELLS = """\
Standard errors before the flight, after the textbook's flight, and after the designed one. They are predictions: the \
Cramer-Rao bound for the noise of the sensors, with the initial state and the sensor biases unknown. Colored residuals widen \
all of them alike; a model that is wrong in kind is not in them."""
DOUBT = """\
The model is what is to be measured, so it is wrong. Flown with {draws} models drawn from what is known: {outside} left the \
envelope{most}, {untrimmed} did not fly straight at this speed. In those that stayed inside, the mean standard error was \
{low} to {high} of the textbook's."""
KNOWN = "Nothing is known of the parameters, so no other models were drawn: begin with half the amplitude, and watch."


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
            Section("How the aircraft answers", (_answers(proposal), _limits(proposal))),
            Section("What it will tell", (Prose(TELLS), _bars(proposal), _errors(proposal))),
            Section("If the model is wrong", (Prose(_doubt(proposal)),)),
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
    rows = [_family(proposal, one) for one in proposal.designs]
    return Table(
        "The families that were tried", ("family", "information gained", "mean standard error"), tuple(rows)
    )


def _family(proposal: Proposal, one: Design) -> tuple[str, ...]:
    ratio = f"{proposal.ratio(one):.2f} of the textbook's"
    return one.shape, f"{one.gain:.2f} per parameter", ratio


def _answers(proposal: Proposal) -> Figure:
    outputs, time = proposal.setup.vehicle.outputs, proposal.best.maneuver.time
    readings = proposal.best.forecast.readings
    strips = [
        _answer(proposal, c, time, readings[:, outputs.index(c)]) for c in proposal.setup.limits.envelope
    ]
    return Figure(
        "Readings and their limits",
        stacked_plots(strips, "time, s", "Readings of the designed flight between their limits"),
    )


def _answer(proposal: Proposal, channel: str, time: FloatArray, values: FloatArray) -> Strip:
    unit = VARIABLES[channel].unit
    factor, shown = (math.degrees(1.0), unit.replace("rad", "deg")) if "rad" in unit else (1.0, unit)
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
        told = [number(v, 3) if np.isfinite(v) else "unknown" for v in (now, textbook, designed)]
        rows.append((name, number(float(setup.values[i]), 4), *told, f"{designed / textbook:.2f}"))
    head = ("parameter", "believed", "now", "textbook", "designed", "designed over textbook")
    return Table("Standard errors", head, tuple(rows))


def _doubt(proposal: Proposal) -> str:
    told = proposal.robustness
    if not np.any(proposal.setup.known):
        return KNOWN
    if not told.ratios:
        return f"Of {told.draws} models drawn from what is known, none stayed inside: begin with half the amplitude, and watch."
    most = f" (by {100.0 * told.largest_excess:.0f} % of its width at most)" if told.outside else ""
    low, high = (f"{v:.2f}" for v in (min(told.ratios), max(told.ratios)))
    return DOUBT.format(
        draws=told.draws, outside=told.outside, most=most, untrimmed=told.untrimmed, low=low, high=high
    )
