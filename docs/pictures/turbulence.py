"""Gusts: their spectra by the equations of the model, what they look like in time, and how they depend on height."""

from __future__ import annotations

from functools import cache

import numpy as np
from matplotlib.figure import Figure
from scipy.linalg import expm, solve_continuous_lyapunov

from pictures.registry import picture
from pictures.sketch import BLUE, GREEN, ORANGE, SOFT, VIOLET, plots
from stoop.base.arrays import FloatArray
from stoop.simulation.steady_flight import trim
from stoop.vehicle.builtin import builtin_text
from stoop.vehicle.channels import GUST_STATES, noise_input
from stoop.vehicle.load import parse_vehicle

SIGMA, LENGTH = 1.5, 200.0  #: m/s, m
ROOT3 = np.sqrt(3.0)
#: how the states of a gust add up to it (docstring of stoop.vehicle.symbolic.frames)
SUM = {"u": np.array([1.0]), "w": np.array([ROOT3, 1.0 - ROOT3])}


@cache
def filters() -> tuple[float, dict[str, tuple[FloatArray, FloatArray]]]:
    """Return V* and, for u and w, A (n, n) and b (n,) of the states of the gust: x' = A x + b n, from the vehicle's equations."""
    table = "\n[turbulence]\n" + "".join(
        f"{a} = {{ intensity = {SIGMA}, length = {LENGTH} }}\n" for a in "uvw"
    )
    vehicle = parse_vehicle(builtin_text("twin-boom") + table, "gusty")
    point = trim(vehicle)
    names = {axis: GUST_STATES[axis] for axis in SUM}
    still = {**point.start, **{n: 0.0 for axis in vehicle.gusts for n in GUST_STATES[axis]}}

    def rates(changed: dict[str, float], noise: dict[str, float]) -> dict[str, float]:
        inputs = point.inputs.copy()
        for axis, value in noise.items():
            inputs[vehicle.inputs.index(noise_input(axis))] = value
        rows = vehicle.parameter_rows(point.changes)
        states = vehicle.initial_states(still | changed, rows, inputs)
        found, _ = vehicle.array_equations()(rows, states, inputs[:, None])
        return dict(zip(vehicle.states, found[: len(vehicle.states), 0].tolist(), strict=True))

    out = {}
    for axis, states in names.items():
        A = np.array([[rates({k: 1.0}, {})[n] for k in states] for n in states])
        out[axis] = A, np.array([rates({}, {axis: 1.0})[n] for n in states])
    return vehicle.value("reference.airspeed"), out


def dryden(axis: str, omega: FloatArray) -> FloatArray:
    """Return the one-sided spectrum over the spatial frequency, rad/m (MIL-F-8785C, 3.7.1.2), in (m/s)2 m/rad."""
    x = (LENGTH * omega) ** 2
    if axis == "u":
        return SIGMA**2 * 2.0 * LENGTH / np.pi / (1.0 + x)
    return SIGMA**2 * LENGTH / np.pi * (1.0 + 3.0 * x) / (1.0 + x) ** 2


@picture("dryden-spectra")
def spectra() -> Figure:
    """Spectra of Dryden gusts along and across the path, by the equations of the model and by the formulas of MIL-F-8785C.

    They agree. Both fall with the square of the frequency above one over the scale length.
    """
    speed, found = filters()
    figure, axes = plots(1, 1, 2.9)
    fine, coarse = np.logspace(-4.0, 0.0, 200), np.logspace(-3.9, -0.1, 20)
    for axis, color, name in (("u", BLUE, "along, u"), ("w", ORANGE, "across, v and w")):
        A, b = found[axis]
        n = len(b)
        # white noise of unit intensity has a two-sided density of one over circular frequency: one-sided, over 2 pi, doubled
        H = np.array([SUM[axis] @ np.linalg.solve(1j * speed * o * np.eye(n) - A, b) for o in fine])
        axes.loglog(
            fine, np.abs(H) ** 2 * speed / np.pi, color=color, label=f"{name}: equations of the model"
        )
        axes.loglog(coarse, dryden(axis, coarse), "o", color=color, markersize=4.0, markerfacecolor="none")
    axes.plot([], [], "o", color=SOFT, markersize=4.0, markerfacecolor="none", label="MIL-F-8785C")
    axes.axvline(1.0 / LENGTH, color=SOFT, linewidth=0.9, linestyle=(0, (4, 2)))
    axes.text(1.15 / LENGTH, 1500.0, "1 / L", color=SOFT)
    axes.set(
        xlabel=r"spatial frequency $\Omega$, rad/m",
        ylabel=r"$\Phi$, (m/s)$^2$ m",
        ylim=(1e-3, 1e4),
        xlim=(1e-4, 1.0),
    )
    axes.minorticks_off()
    axes.legend(loc="lower left")
    return figure


@picture("dryden-time")
def in_time() -> Figure:
    """A minute of gusts along the path and downward.

    Their intensity is 1.5 m/s, their scale length 200 m, the speed 35 m/s.
    """
    _, found = filters()
    rng = np.random.default_rng(3)
    dt, count = 0.02, 3000
    figure, axes = plots(1, 1, 2.4)
    t = dt * np.arange(count)
    for axis, color in (("u", BLUE), ("w", ORANGE)):
        A, b = found[axis]
        n = len(b)
        P = solve_continuous_lyapunov(A, -np.outer(b, b))
        step = expm(A * dt)
        drawn = np.linalg.cholesky(P - step @ P @ step.T + 1e-12 * np.eye(n)) @ rng.standard_normal(
            (n, count)
        )
        x = np.linalg.cholesky(P) @ rng.standard_normal(n)
        gust = np.empty(count)
        for k in range(count):
            gust[k] = SUM[axis] @ x
            x = step @ x + drawn[:, k]
        axes.plot(
            t,
            gust,
            color=color,
            linewidth=1.1,
            label=f"{axis}, rms {np.sqrt(SUM[axis] @ P @ SUM[axis]):.1f} m/s",
        )
    axes.set(xlabel="time, s", ylabel="gust, m/s", xlim=(0.0, 60.0), ylim=(-5.5, 7.0))
    axes.legend(ncols=2, loc="upper right")
    return figure


@picture("dryden-height")
def height() -> Figure:
    """Scale lengths and intensities of gusts near the ground after MIL-F-8785C.

    They are drawn over the height from 10 to 300 m, for light, moderate and severe turbulence.
    """
    foot, knot = 0.3048, 1852.0 / 3600.0
    h = np.linspace(10.0, 304.8, 200)
    feet = h / foot
    figure, (left, right) = plots(1, 2, 2.6)
    left.plot(h, h, color=ORANGE, label="$L_w$")
    left.plot(h, foot * feet / (0.177 + 0.000823 * feet) ** 1.2, color=BLUE, label="$L_u = L_v$")
    left.set(xlabel="height, m", ylabel="scale length, m", xlim=(0.0, 305.0), ylim=(0.0, 620.0))
    left.legend(loc="upper left")
    for wind, color, name in ((15.0, GREEN, "light"), (30.0, BLUE, "moderate"), (45.0, VIOLET, "severe")):
        sigma = 0.1 * wind * knot
        along = sigma / (0.177 + 0.000823 * feet) ** 0.4
        right.plot(h, along, color=color)
        right.plot(h, np.full_like(h, sigma), color=color, linewidth=1.2, linestyle=(0, (4, 2)))
        right.text(298.0, along[-1] + 0.24, name, color=color, ha="right", fontsize=9.0)
    right.plot([], [], color=SOFT, label=r"$\sigma_u = \sigma_v$")
    right.plot([], [], color=SOFT, linewidth=1.2, linestyle=(0, (4, 2)), label=r"$\sigma_w$")
    right.set(xlabel="height, m", ylabel="intensity, m/s", xlim=(0.0, 305.0), ylim=(0.0, 5.6))
    right.legend(loc="upper right", ncols=2)
    return figure
