"""Simulated flights of the twin-boom aircraft: what inputs do, which windows are fitted, what modes it has."""

from __future__ import annotations

from functools import cache
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from pictures.registry import picture
from pictures.sketch import BLUE, GREEN, INK, ORANGE, PALE_BLUE, PALE_ORANGE, RED, SOFT, plots
from stoop.flight import Flight
from stoop.simulation import linearize, trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle

DEGREE = np.pi / 180.0


@cache
def aircraft() -> Vehicle:
    """Return the aircraft of these pictures."""
    return load_vehicle("twin-boom")


def flight(
    duration: float, *inputs: tuple[str, str, float, float, float], noise: bool = True, seed: int = 1
) -> Flight:
    """Return the flight of inputs (control, shape, start s, step s, amplitude rad)."""
    tables: list[dict[str, Any]] = [
        {"control": control, "shape": shape, "start": start, "amplitude": amplitude}
        | {"duration" if shape == "pulse" else "step": step}
        for control, shape, start, step, amplitude in inputs
    ]
    plan = Maneuver.model_validate({"duration": duration, "rate": 50.0, "input": tables})
    return simulate_flight(aircraft(), plan, seed, noise)


@picture("timeline")
def timeline() -> Figure:
    """A flight with five maneuvers: elevator, aileron and rudder, then elevator and aileron again.

    The windows that are found begin shortly before each input and end after the free response. The first
    three are fitted; the last two are held back and predicted.
    """
    flown = flight(
        62.0,
        ("elevator", "3-2-1-1", 5.0, 0.35, 0.06),
        ("aileron", "doublet", 19.0, 0.5, 0.06),
        ("rudder", "doublet", 29.0, 0.8, 0.09),
        ("elevator", "doublet", 41.0, 0.6, 0.06),
        ("aileron", "doublet", 52.0, 0.7, -0.05),
    )
    found = flown.find_maneuvers()
    t = flown.time
    figure, axes = plots(4, 1, 4.6, sharex=True, height_ratios=(1.25, 1, 1, 1))
    for control, color in (("elevator", BLUE), ("aileron", ORANGE), ("rudder", GREEN)):
        axes[0].plot(t, flown.column(control) / DEGREE, color=color, linewidth=1.2, label=control)
    axes[0].set(ylabel="deg", ylim=(-6.5, 10.5))
    axes[0].legend(ncols=3, loc="upper right", bbox_to_anchor=(1.0, 1.12))
    for ax, rate in zip(axes[1:], "pqr", strict=True):
        ax.plot(t[::2], flown.column(rate)[::2] / DEGREE, color=INK, linewidth=0.9)
        ax.set(ylabel=f"{rate}, deg/s")
    for i, one in enumerate(found):
        fitted = i < 3
        for ax in axes:
            ax.axvspan(
                one.start, one.stop, color=PALE_BLUE if fitted else PALE_ORANGE, linewidth=0.0, zorder=0.0
            )
        axes[1].text(
            0.5 * (one.start + one.stop), 0.86, "fit" if fitted else "predict", color=BLUE if fitted else ORANGE, ha="center",
            transform=axes[1].get_xaxis_transform(), va="center",
        )  # fmt: skip
    low, high = axes[1].get_ylim()
    axes[1].set(ylim=(low, high + 0.45 * (high - low)))
    axes[3].set(xlabel="time, s", xlim=(0.0, 62.0))
    figure.align_ylabels()
    return figure


@picture("response-pitch")
def response_pitch() -> Figure:
    """A 3-2-1-1 of the elevator and the motion of the twin-boom aircraft.

    Angle of attack and pitch rate follow the short period, while the airspeed hardly changes.
    """
    flown = flight(9.0, ("elevator", "3-2-1-1", 1.0, 0.35, 0.06))
    t = flown.time
    figure, axes = plots(4, 1, 4.4, sharex=True)
    trimmed = trim(aircraft()).deflections["elevator"]
    rows = (
        ("elevator", r"$\delta_e$, deg", 1.0 / DEGREE, trimmed), ("alpha", r"$\alpha$, deg", 1.0 / DEGREE, 0.0),
        ("q", "$q$, deg/s", 1.0 / DEGREE, 0.0), ("V", "$V$, m/s", 1.0, 0.0),
    )  # fmt: skip
    for ax, (name, label, scale, zero), color in zip(axes, rows, (ORANGE, BLUE, BLUE, BLUE), strict=True):
        ax.plot(t, (flown.column(name) - zero) * scale, color=color, linewidth=1.2)
        ax.set(ylabel=label)
    axes[3].set(xlabel="time, s", xlim=(0.0, 9.0), ylim=(31.0, 39.0))
    figure.align_ylabels()
    return figure


@picture("response-lateral")
def response_lateral() -> Figure:
    """Left: a doublet of the rudder excites the Dutch roll, sideslip and yaw rate oscillate.

    Right: a doublet of the ailerons moves the roll rate, which follows within a fraction of a second, and
    the bank angle.
    """
    figure, axes = plots(3, 2, 4.0, sharex="col")
    for column, (control, step, size, names) in enumerate(
        (("rudder", 0.8, 0.09, ("beta", "r")), ("aileron", 0.6, 0.06, ("p", "phi")))
    ):
        flown = flight(10.0, (control, "doublet", 1.0, step, size))
        t = flown.time
        axes[0, column].plot(t, flown.column(control) / DEGREE, color=ORANGE)
        axes[0, column].set(ylabel=f"{control}, deg", ylim=(-7.0, 7.0), xlim=(0.0, 10.0))
        for ax, name in zip(axes[1:, column], names, strict=True):
            ax.plot(t, flown.column(name) / DEGREE, color=BLUE, linewidth=1.2)
            label = {"beta": r"$\beta$, deg", "phi": r"$\phi$, deg"}.get(name, f"${name}$, deg/s")
            ax.set(ylabel=label)
        axes[2, column].set_xlabel("time, s")
    figure.align_ylabels()
    return figure


@picture("response-signs")
def response_signs() -> Figure:
    """What the twin-boom aircraft does in the first second after a step of each control by plus two degrees.

    A positive elevator turns the nose down, a positive aileron the right wing down, a positive rudder the
    nose left.
    """
    figure, axes = plots(1, 3, 2.4)
    rows = (("elevator", "q", "nose down"), ("aileron", "p", "right wing down"), ("rudder", "r", "nose left"))
    for ax, (control, rate, what) in zip(axes, rows, strict=True):
        flown = flight(1.5, (control, "pulse", 0.3, 2.0, 2.0 * DEGREE), noise=False)
        t = flown.time
        ax.plot(t, flown.column(rate) / DEGREE, color=BLUE)
        ax.axhline(0.0, color=SOFT, linewidth=0.9)
        ax.axvline(0.3, color=ORANGE, linewidth=1.0, linestyle=(0, (4, 2)))
        ax.set(xlabel="time, s", xlim=(0.0, 1.5), ylabel=f"${rate}$, deg/s")
        ax.set_title(f"{control} +2 deg:\n{what}", fontsize=9.5)
    return figure


@picture("modes")
def modes() -> Figure:
    """Eigenvalues of the twin-boom aircraft at 35 m/s in the complex plane.

    Short period, Dutch roll and roll to the left, phugoid and spiral near the origin.
    """
    model = linearize(aircraft(), trim(aircraft()))
    figure, axes = plots(1, 1, 3.2)
    axes.axvline(0.0, color=SOFT, linewidth=1.0)
    axes.axhline(0.0, color=SOFT, linewidth=1.0)
    beside = {"phugoid": (-0.15, 0.6, "right"), "spiral": (0.2, -0.6, "left")}
    for mode in model.modes:
        s = mode.eigenvalue
        if mode.name not in ("short period", "phugoid", "Dutch roll", "roll", "spiral"):
            continue
        color = ORANGE if mode.name in ("short period", "phugoid") else BLUE
        for one in {s, s.conjugate()}:
            axes.plot([one.real], [one.imag], "x", color=color, markersize=8.0, markeredgewidth=2.0)
        right, up, side = beside.get(mode.name, (0.2, 0.45, "left"))
        axes.text(s.real + right, abs(s.imag) + up, mode.name, color=color, ha=side, va="center")
    axes.text(-9.7, 5.2, "longitudinal", color=ORANGE)
    axes.text(-9.7, 4.4, "lateral", color=BLUE)
    axes.set(xlabel="real part, 1/s", ylabel="imaginary part, rad/s", xlim=(-10.0, 2.0), ylim=(-6.2, 6.2))
    return figure


@picture("gaps-and-segments")
def gaps() -> Figure:
    """A recorded channel with a dropout inside a window.

    Nothing is drawn across the gap: the window becomes two segments, each with its own initial state.
    """
    flown = flight(9.0, ("elevator", "3-2-1-1", 1.0, 0.35, 0.06))
    t, q = flown.time, flown.column("q") / DEGREE
    lost = (t > 2.3) & (t < 3.4)
    figure, axes = plots(1, 1, 2.5)
    for begin, end in ((0.6, 2.3), (3.4, 6.0)):
        axes.axvspan(begin, end, color=PALE_BLUE, linewidth=0.0, zorder=0.0)
    axes.plot(t[~lost], q[~lost], ".", color=INK, markersize=3.0)
    for begin in (0.6, 3.4):
        k = int(np.searchsorted(t, begin + 0.02))
        axes.plot([t[k]], [q[k]], "o", color=ORANGE, markersize=7.0)
    top = 1.38 * float(np.nanmax(np.abs(q)))
    axes.text(1.45, 0.82 * top, "segment 1", color=BLUE, ha="center")
    axes.text(4.7, 0.82 * top, "segment 2", color=BLUE, ha="center")
    axes.text(2.85, 0.0, "gap", color=RED, ha="center", va="center")
    axes.text(6.2, -0.78 * top, "initial states", color=ORANGE)
    axes.plot([6.05], [-0.74 * top], "o", color=ORANGE, markersize=7.0)
    axes.set(xlabel="time, s", ylabel="$q$, deg/s", xlim=(0.0, 9.0), ylim=(-1.05 * top, 1.05 * top))
    return figure
