"""A quadrotor from motion capture: a prediction of its pose, and draws of its thrust."""

from __future__ import annotations

import tempfile
from functools import cache
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from pictures.registry import picture
from pictures.sketch import BLUE, FAINT, ORANGE, SOFT, plots
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.identification import fit
from stoop_studies.verify import capture as room

SEED = 18  #: of the study's quadrotors
FIT = ("15.4:20.9", "50:58")
HELD_BACK = "21.5:24.5"
DRAWS = 400


@cache
def model() -> FittedModel:
    """Fit a made-up quadrotor to its pose by the defaults; its commands are recorded 0.24 s early."""
    with tempfile.TemporaryDirectory() as name:
        flown, _ = room.fly("rotors", SEED, Path(name))
        flight, vehicle = room.drafted(flown)
        return fit(vehicle, [flight], FIT, (HELD_BACK,))


@picture("capture")
def capture() -> Figure:
    """A window that was not fitted: bank and position east and down of a quadrotor, by motion capture and by the model.

    Dots are every fourth reading. Each second the prediction begins anew, and follows them within a few millimeters.
    """
    fitted = model()
    index = next(i for i, m in enumerate(fitted.result.maneuvers) if m.role == "validation")
    trace = fitted.traces[index]
    figure, several = plots(1, 3, 2.4)
    shown = (
        ("phi", "bank, deg", np.degrees),
        ("pe", "east, m", np.asarray),
        ("pd", "down, m", np.asarray),
    )
    for axes, (channel, label, unit) in zip(several, shown, strict=True):
        own = trace.channels[channel]
        axes.plot(
            trace.time[::4], unit(own.measured[::4]), ".", color=ORANGE, markersize=3.5, label="measured"
        )
        axes.plot(trace.time, unit(own.simulated), color=BLUE, label="model")
        axes.set(xlabel="time, s", ylabel=label)
    several[0].legend(loc="best")
    return figure


@picture("draws")
def draws() -> Figure:
    """Four hundred draws of the linear and the quadratic term of a rotor's thrust, which lie on a narrow slanted ellipse.

    The box is what independent ranges of both would draw from: most of it is outside the ellipse.
    """
    fitted = model()
    names = list(fitted.result.covariance.names)
    at = [names.index(f"rotors.T{k}") for k in (1, 2)]
    mean = np.array([fitted.result.parameters[f"rotors.T{k}"].estimate for k in (1, 2)])
    covariance = np.asarray(fitted.result.covariance.matrix)[np.ix_(at, at)]
    drawn = np.random.default_rng(0).multivariate_normal(mean, covariance, DRAWS)
    half = 2.0 * np.sqrt(np.diag(covariance))
    figure, axes = plots(1, 1, 3.0, 4.6)
    axes.add_patch(Rectangle(mean - half, *(2.0 * half), facecolor=FAINT, zorder=0))
    axes.plot(*drawn.T, ".", color=BLUE, markersize=3.0)
    axes.text(*(mean + 0.9 * half), "independent ranges", color=SOFT, ha="right", va="top", fontsize=9.0)
    axes.set(xlabel="T1, N", ylabel="T2, N")
    return figure
