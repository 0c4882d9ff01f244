"""What stands between a command and a deflection, by the functions that simulate it."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pictures.registry import picture
from pictures.sketch import BLUE, GREEN, INK, ORANGE, SOFT, plots
from stoop.simulation.maneuver import Steps
from stoop.vehicle.delays import delayed, first_order_lag, play, rate_limited

DT = 0.002  #: s


@picture("servo-response")
def response() -> Figure:
    """A doublet of a command, and what a servo makes of it.

    A delay shifts it, a first-order lag rounds it, and a rate limit turns its steps into ramps.
    """
    t = np.arange(0.0, 1.4, DT)
    table = {"control": "elevator", "shape": "doublet", "start": 0.2, "step": 0.45, "amplitude": 0.2}
    command = Steps.model_validate(table).signal(t)
    figure, axes = plots(1, 1, 2.8)
    axes.plot(t, command, color=INK, linewidth=1.2, label="command")
    axes.plot(
        t, delayed(command, 0.03 / DT), color=SOFT, linewidth=1.3, linestyle=(0, (4, 2)), label="delay 0.03 s"
    )
    axes.plot(t, first_order_lag(command, 0.05, DT), color=BLUE, label="lag 0.05 s")
    axes.plot(t, rate_limited(command, 1.5 * DT), color=ORANGE, label="rate limit 1.5 rad/s")
    axes.plot(
        t, first_order_lag(delayed(rate_limited(command, 1.5 * DT), 0.03 / DT), 0.05, DT), color=GREEN, label="all three"
    )  # fmt: skip
    axes.set(xlabel="time, s", ylabel="deflection, rad", xlim=(0.1, 1.4), ylim=(-0.25, 0.36))
    axes.legend(ncols=3, loc="upper center")
    return figure


@picture("servo-dead-zone")
def dead_zone() -> Figure:
    """A servo with a dead zone.

    Left: a slow sine of the command and the surface, which stays where it is until the command has
    reversed by the dead zone. Right: the same as a loop, with the width of the dead zone, hysteresis.
    """
    t = np.arange(0.0, 6.0, 0.01)
    command, width = 0.1 * np.sin(1.3 * t), 0.06
    surface = play(command, width)
    figure, (left, right) = plots(1, 2, 2.6, width_ratios=(1.7, 1.0))
    left.plot(t, command, color=INK, linewidth=1.2, label="command")
    left.plot(t, surface, color=BLUE, label="surface")
    left.set(xlabel="time, s", ylabel="rad", xlim=(0.0, 6.0), ylim=(-0.13, 0.16))
    left.legend(ncols=2, loc="upper right")
    late = t > 1.3
    right.plot(command[late], surface[late], color=BLUE)
    style = {"arrowstyle": "<|-|>", "color": ORANGE, "shrinkA": 0, "shrinkB": 0}
    right.annotate("", (0.5 * width, 0.0), (-0.5 * width, 0.0), arrowprops=style)
    right.text(-0.07, 0.05, "dead\nzone", color=ORANGE, ha="center", va="center", fontsize=9.0)
    right.set(xlabel="command, rad", ylabel="surface, rad", xlim=(-0.12, 0.12), ylim=(-0.1, 0.1))
    return figure


@picture("servo-bandwidth")
def bandwidth() -> Figure:
    """Gain and phase of a first-order lag and of a delay.

    Below 1 Hz they are nearly the same, so slow inputs do not tell them apart.
    """
    f = np.logspace(-1.0, 1.3, 200)
    s = 2j * np.pi * f
    figure, (left, right) = plots(1, 2, 2.6)
    for name, H, color in (
        ("lag 0.05 s", 1.0 / (1.0 + 0.05 * s), BLUE),
        ("delay 0.05 s", np.exp(-0.05 * s), ORANGE),
    ):
        left.semilogx(f, np.abs(H), color=color, label=name)
        right.semilogx(f, np.degrees(np.unwrap(np.angle(H))), color=color)
    left.set(xlabel="frequency, Hz", ylabel="gain", ylim=(0.0, 1.12), xlim=(0.1, 20.0))
    right.set(xlabel="frequency, Hz", ylabel="phase, deg", ylim=(-200.0, 5.0), xlim=(0.1, 20.0))
    for axes in (left, right):
        axes.set_xticks([0.1, 1.0, 10.0], ["0.1", "1", "10"])
        axes.minorticks_off()
    left.legend(loc="lower left")
    return figure
