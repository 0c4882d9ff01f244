"""Decisions that an estimator takes while it prepares its data and estimates its noise."""

from __future__ import annotations

from collections.abc import Callable
from typing import Final

from stoop.base.notices import Notice, paragraph
from stoop.checks.excitation import MASS, with_mass_held
from stoop.estimate.estimate import Estimate
from stoop.strategy.decision import Decision, Setup


def _noticed(*codes: str) -> Callable[[Setup, Estimate], str]:
    """Return a function that gives the notices of a fit with one of some codes, as sentences."""

    def found(setup: Setup, fit: Estimate) -> str:
        notices: tuple[Notice, ...] = (*fit.prepared.notices, *fit.notices)
        return paragraph(one for one in notices if one.code in codes)

    return found


def _recorded_motion(setup: Setup, fit: Estimate) -> str:
    """Return the channels from which a reduced model takes the motion that it leaves out."""
    channels = ", ".join(fit.problem.layout.vehicle.measured)
    return f"{channels} recorded, which the reduced model leaves out" if channels else ""


def _held_numbers(setup: Setup, fit: Estimate) -> str:
    """Return that the mass could be anything."""
    held = with_mass_held(setup.vehicle) is not setup.vehicle
    return "neither mass nor inertia nor a force is known" if held else ""


RECORDED_MOTION: Final = Decision(
    "recorded-motion",
    "Does the record hold the motion that a reduced model leaves out?",
    treatment="recorded_motion",
    within=_recorded_motion,
    done="taken from the record",
)
HELD_NUMBERS: Final = Decision(
    "held-numbers",
    "Are there numbers that the data determine as ratios only?",
    treatment="held_numbers",
    within=_held_numbers,
    done=f"{MASS} fixed at the file's value",
)
STUCK_CHANNELS: Final = Decision(
    "stuck-channels",
    "Does a channel never change, or hold spikes only?",
    treatment="stuck_channels",
    within=_noticed("stuck-channel", "outliers-left-out"),
    done="treated as not measured",
)
NOISE_SHAPE: Final = Decision(
    "noise-shape",
    "Do residuals have outliers?",
    treatment="noise_shape",
    within=_noticed("outliers", "outliers-missing"),
    done="outliers weighted less or left out",
)
MANEUVER_NOISE: Final = Decision(
    "maneuver-noise",
    "Does the noise differ between maneuvers?",
    treatment="maneuver_noise",
    within=_noticed("maneuver-noise", "maneuver-noise-unknown"),
    done="a variance for each maneuver",
)
