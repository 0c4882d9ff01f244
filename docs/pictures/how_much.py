"""How standard errors fall with the kind, the number and the length of maneuvers, by the information of simulated flights.

The page `how-much-flight.md` shows these numbers as tables too; a test compares them.
"""

from __future__ import annotations

from functools import cache
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pictures.registry import picture
from pictures.sketch import (
    BLUE,
    CYCLE,
    GREEN,
    INK,
    ORANGE,
    PALE_BLUE,
    PALE_GRAY,
    PALE_GREEN,
    PALE_ORANGE,
    RED,
    SOFT,
    plots,
)  # fmt: skip
from stoop.base.arrays import FloatArray
from stoop.simulation import trim
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle.builtin import load_vehicle
from stoop_plan.input_design.information import Forecast, Knowledge, Limits, Setup
from stoop_plan.input_design.sensitivity import sensor_noise

#: what is flown: control, shape, step (of a pulse its duration), s, and amplitude, rad
MANEUVERS: Final = {
    "elevator 3-2-1-1": ("elevator", "3-2-1-1", 0.35, 0.06),
    "elevator doublet": ("elevator", "doublet", 0.35, 0.06),
    "aileron doublet": ("aileron", "doublet", 0.6, 0.06),
    "rudder doublet": ("rudder", "doublet", 0.8, 0.09),
}
ONE_OF_EACH: Final = ("elevator 3-2-1-1", "aileron doublet", "rudder doublet")
SECONDS: Final = 10.0  #: of record of a maneuver
LEAD: Final = 1.0  #: s of steady flight before the input
SHOWN: Final = (
    "CLalpha", "CLq", "CLelevator", "CD0", "Cmalpha", "Cmq", "Cmelevator", "CQbeta", "CQr", "Clbeta", "Clp", "Clr",
    "Claileron", "Cnbeta", "Cnp", "Cnr", "Cnrudder",
)  # fmt: skip
GOOD, USABLE, POOR = 5.0, 20.0, 100.0  #: %, of the value; beyond, a flight says nothing of a parameter


@cache
def setup() -> Setup:
    """Return the twin-boom aircraft in steady flight, nothing known of its 32 coefficients, noise as its file says."""
    vehicle = load_vehicle("twin-boom")
    point = trim(vehicle)
    return Setup(vehicle, point, Limits.about(vehicle, point), Knowledge.none(), sensor_noise(vehicle))


@cache
def forecast(name: str, seconds: float = SECONDS, share: float = 1.0) -> Forecast:
    """Return the information of a maneuver recorded for some seconds, with a share of its amplitude."""
    control, shape, step, amplitude = MANEUVERS[name]
    table: dict[str, Any] = {
        "control": control, "shape": shape, "start": LEAD, "step": step, "amplitude": share * amplitude,
    }  # fmt: skip
    plan = Maneuver.model_validate({"duration": seconds, "rate": 50.0, "input": [table]})
    return setup().forecast(plan)


def errors(*forecasts: Forecast) -> dict[str, float]:
    """Return the standard errors that flights leave, in % of the true values, by parameter."""
    std: FloatArray = setup().std(*forecasts)
    with np.errstate(divide="ignore"):
        relative = 100.0 * std / np.abs(setup().values)
    return dict(zip(setup().names, relative.tolist(), strict=True))


def by_maneuver() -> dict[str, dict[str, float]]:
    """Return the errors of each maneuver alone, and of one of each control together."""
    alone = {name: errors(forecast(name)) for name in MANEUVERS}
    return alone | {"one of each": errors(*(forecast(n) for n in ONE_OF_EACH))}


def text_of(error: float) -> str:
    """Return an error as the tables of the page show it."""
    return "\N{EN DASH}" if error > POOR else f"{error:.2g}" if error < 10.0 else f"{error:.0f}"


@picture("how-much-which")
def which() -> Figure:
    """Which maneuver identifies what.

    Standard errors in percent of the true value of seventeen coefficients after one elevator 3-2-1-1, one
    elevator doublet, one aileron doublet, one rudder doublet, and one of each. The elevator tells lift,
    drag and pitching moment, aileron and rudder tell side force, rolling and yawing moment.
    """
    table = by_maneuver()
    columns = list(table)
    figure, axes = plots(1, 1, 5.6)
    for j, column in enumerate(columns):
        for i, name in enumerate(SHOWN):
            error = table[column][name]
            color, ink = (
                (PALE_GREEN, GREEN) if error <= GOOD
                else (PALE_BLUE, BLUE) if error <= USABLE
                else (PALE_ORANGE, ORANGE) if error <= POOR
                else (PALE_GRAY, SOFT)
            )  # fmt: skip
            axes.add_patch(Rectangle((j - 0.48, i - 0.45), 0.96, 0.9, facecolor=color, edgecolor="none"))
            axes.text(j, i, text_of(error), ha="center", va="center", color=ink, fontsize=9.5)
    axes.set(xlim=(-0.5, len(columns) - 0.5), ylim=(len(SHOWN) - 0.5, -0.5))
    axes.set_xticks(range(len(columns)), [c.replace(" ", "\n", 1) for c in columns])
    axes.set_yticks(range(len(SHOWN)), SHOWN)
    axes.xaxis.tick_top()
    axes.tick_params(length=0.0)
    axes.grid(visible=False)
    for spine in axes.spines.values():
        spine.set_visible(False)
    return figure


@picture("how-much-number")
def number() -> Figure:
    """Standard errors over the number of sets of maneuvers, one set being one of each control.

    All fall with the root of the number; four times as many maneuvers halve an error, as maneuvers of
    twice the amplitude do.
    """
    one = tuple(forecast(n) for n in ONE_OF_EACH)
    doubled = errors(*(forecast(n, SECONDS, 1.5) for n in ONE_OF_EACH))
    sets = np.array([1, 2, 3, 4, 6, 8, 12, 16])
    rows = [errors(*(one * int(n))) for n in sets]
    figure, axes = plots(1, 1, 3.2)
    for name, color in (("CD0", RED), ("CLq", ORANGE), ("Cnp", GREEN), ("Cmq", BLUE), ("Cnr", INK)):
        axes.loglog(sets, [row[name] for row in rows], "o-", color=color, markersize=4.0)
        axes.text(17.2, rows[-1][name], name, color=color, va="center")
        axes.plot([1], [doubled[name]], "o", color=color, markerfacecolor="none", markersize=7.0)
    axes.text(1.1, 0.32, "rings: one set at 1.5 times the amplitude", color=SOFT, fontsize=9.5)
    axes.axhline(10.0, color=SOFT, linewidth=1.0, linestyle=(0, (4, 2)))
    axes.set(
        xlabel="sets of maneuvers",
        ylabel="standard error, % of the value",
        xlim=(0.92, 24.0),
        ylim=(0.2, 90.0),
    )
    axes.set_xticks(sets, [str(n) for n in sets])
    axes.set_yticks([0.3, 1.0, 3.0, 10.0, 30.0], ["0.3", "1", "3", "10", "30"])
    axes.minorticks_off()
    return figure


@picture("how-much-length")
def length() -> Figure:
    """Standard errors over the length of the record.

    Standard errors over the length of the record, after an elevator 3-2-1-1 and after a rudder doublet
    with the aileron doublet before it. They fall steeply while the input lasts and the mode decays, and
    hardly afterwards.
    """
    seconds = np.array([3.0, 3.5, 4.0, 4.5, 5.0, 6.0, 7.0, 8.0, 10.0, 12.0, 15.0])
    aileron = forecast("aileron doublet")
    figure, both = plots(1, 2, 3.0, sharey=True)
    for axes, name, others, shown in (
        (both[0], "elevator 3-2-1-1", (), ("CD0", "CLq", "Cmq", "CLalpha", "Cmalpha")),
        (both[1], "rudder doublet", (aileron,), ("CQr", "Cnp", "Clr", "Cnr", "Cnrudder")),
    ):
        steps = {"3-2-1-1": 7.0, "doublet": 2.0}[MANEUVERS[name][1]]
        axes.axvspan(LEAD, LEAD + steps * MANEUVERS[name][2], color=PALE_ORANGE, linewidth=0.0, zorder=0.0)
        rows = [errors(*others, forecast(name, float(x))) for x in seconds]
        for parameter, color in zip(shown, CYCLE, strict=False):
            axes.semilogy(
                seconds, [row[parameter] for row in rows], "o-", color=color, markersize=3.0, label=parameter
            )
        axes.set_title(name)
        axes.set(xlabel="record, s", xlim=(0.0, 15.5), ylim=(0.4, 1500.0))
        axes.set_yticks([1.0, 10.0, 100.0, 1000.0], ["1", "10", "100", "1000"])
        axes.minorticks_off()
        axes.legend(loc="upper right", ncols=2, columnspacing=1.0, handlelength=1.2)
    both[0].set_ylabel("standard error, %")
    return figure
