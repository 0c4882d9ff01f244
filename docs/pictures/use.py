"""What a model is used for, and how far it carries."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from scipy.signal import StateSpace, lsim
from scipy.spatial import ConvexHull

from pictures.flights import DEGREE, aircraft, flight
from pictures.registry import picture
from pictures.sketch import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PALE_BLUE,
    PALE_GREEN,
    PALE_ORANGE,
    PALE_VIOLET,
    RED,
    SOFT,
    VIOLET,
    Sketch,
    plots,
    side_view,
    sketch,
)  # fmt: skip
from stoop.simulation import linearize, trim
from stoop.simulation.maneuver import Steps


@picture("valid-range")
def valid_range() -> Figure:
    """Angle of attack over airspeed as flown in maneuvers about 35 m/s, and the trimmed flight from 26 to 46 m/s.

    Within the flown range the model is supported by data; at the slow end, where the stall waits, and at
    the fast end it extrapolates.
    """
    flown = flight(
        40.0,
        ("elevator", "3-2-1-1", 2.0, 0.5, 0.08),
        ("elevator", "pulse", 12.0, 5.0, -0.06),
        ("elevator", "3-2-1-1", 30.0, 0.3, -0.08),
        noise=False,
    )
    points = np.column_stack([flown.column("V"), flown.column("alpha") / DEGREE])
    hull = points[ConvexHull(points).vertices]
    speeds = np.linspace(26.0, 46.0, 21)
    trims = [trim(aircraft(), float(v)).start["alpha"] / DEGREE for v in speeds]
    figure, axes = plots(1, 1, 2.9)
    axes.fill(*hull.T, color=PALE_GREEN, linewidth=0.0, zorder=0.5)
    axes.plot(*points[::3].T, ".", color=GREEN, markersize=2.5)
    axes.plot(speeds, trims, color=BLUE)
    axes.text(44.2, trims[-3] + 1.0, "trim", color=BLUE)
    axes.text(36.6, 9.6, "flown: supported", color=GREEN)
    axes.text(27.2, 7.0, "extrapolation\ntowards the stall", color=RED, va="center")
    axes.set(xlabel="airspeed, m/s", ylabel=r"$\alpha$, deg", xlim=(26.0, 46.0), ylim=(-1.0, 13.5))
    return figure


@picture("gain-by-hand")
def gain_by_hand() -> Figure:
    """Step responses of the roll rate of the twin-boom aircraft with three gains from roll rate to aileron.

    The servo has a lag of 0.05 s, the loop a delay of 0.03 s: too little gain is slow, too much rings.
    """
    model = linearize(aircraft(), trim(aircraft()))
    i, j = model.states.index("p"), model.inputs.index("aileron")
    Lp, La = float(model.A[i, i]), float(model.B[i, j])
    lag, delay = 0.05, 0.03
    t = np.linspace(0.0, 1.5, 600)
    figure, axes = plots(1, 1, 2.7)
    for share, color in ((0.3, GREEN), (1.0, BLUE), (3.0, ORANGE)):
        k = share * abs(Lp) / La
        feed = k - Lp / La  # of the set-point, so that it is reached
        # delay by Pade's approximation of first order: one state beside servo and roll rate
        A = np.array([[Lp, La, 0.0], [k / lag, -1.0 / lag, 2.0 / lag], [-2.0 * k / delay, 0.0, -2.0 / delay]])
        b = np.array([[0.0], [-feed / lag], [2.0 * feed / delay]])
        _, p, _ = lsim(StateSpace(A, b, [[1.0, 0.0, 0.0]], [[0.0]]), np.ones_like(t), t)
        axes.plot(t, p, color=color, label=f"k = {k:.2f} rad per rad/s")
    axes.axhline(1.0, color=SOFT, linewidth=0.9, linestyle=(0, (4, 2)))
    axes.set(xlabel="time, s", ylabel="roll rate over set-point", xlim=(0.0, 1.5), ylim=(0.0, 1.55))
    axes.legend(loc="upper right", ncols=1)
    return figure


def door() -> tuple[Figure, Sketch]:
    """Return an empty drawing for a card of the first page."""
    return sketch((-4.0, 4.0), (-1.7, 1.7), width=2.6)


@picture("door-log")
def door_log() -> Figure:
    """A recorded signal with two shaded windows."""
    figure, drawing = door()
    t = np.linspace(-3.8, 3.8, 400)
    rng = np.random.default_rng(1)
    burst = np.exp(-((t + 1.9) ** 2) * 2.0) * np.sin(7.0 * t) + 0.9 * np.exp(
        -((t - 1.9) ** 2) * 2.0
    ) * np.sin(8.0 * t)
    for left, fill in ((-2.9, PALE_BLUE), (0.9, PALE_ORANGE)):
        drawing.shape(
            [(left, -1.4), (left + 2.0, -1.4), (left + 2.0, 1.4), (left, 1.4)], fill, "none", above=0.5
        )
    drawing.axes.plot(t, 1.05 * burst + 0.05 * rng.standard_normal(400), color=INK, linewidth=1.1)
    return figure


@picture("door-practice")
def door_practice() -> Figure:
    """An airplane and the steps of an elevator input."""
    figure, drawing = door()
    side_view(drawing, (0.5, 0.45), 10.0, 0.5)
    t = np.linspace(0.0, 9.0, 600)
    table = {"control": "elevator", "shape": "3-2-1-1", "start": 0.8, "step": 1.0, "amplitude": 0.35}
    drawing.axes.plot(t * 0.84 - 3.8, Steps.model_validate(table).signal(t) - 1.05, color=BLUE, linewidth=1.6)
    return figure


@picture("door-compare")
def door_compare() -> Figure:
    """Three curves of cost over evaluations."""
    figure, drawing = door()
    x = np.linspace(0.0, 1.0, 100)
    for rate, color in ((9.0, BLUE), (3.5, ORANGE), (1.8, VIOLET)):
        drawing.axes.plot(-3.4 + 7.0 * x, -1.2 + 2.5 * np.exp(-rate * x), color=color, linewidth=2.0)
    drawing.line([(-3.4, 1.5), (-3.4, -1.3), (3.7, -1.3)], SOFT, 1.2, dashed=False)
    return figure


@picture("door-extend")
def door_extend() -> Figure:
    """Building blocks, one of them new."""
    figure, drawing = door()
    for place in ((-2.4, -0.75), (0.0, -0.75), (2.4, -0.75), (-1.2, 0.6)):
        drawing.box(place, (2.2, 1.15), "", PALE_BLUE, BLUE)
    drawing.box((1.6, 0.75), (2.2, 1.15), "+", PALE_VIOLET, VIOLET, fontsize=16, color=VIOLET)
    return figure
