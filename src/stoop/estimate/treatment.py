"""What an estimator may decide by itself about its data and its noise."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Treatment:
    """Decisions that an estimator takes by itself; each may be switched off.

    Attributes
    ----------
    recorded_motion : bool
        A reduced model takes the states that it leaves out from the record.
    held_numbers : bool
        The mass is fixed where nothing determines it.
    stuck_channels : bool
        A channel that never changes, or is all spikes, is treated as not measured.
    noise_shape : bool
        Residuals with outliers have the density of a mixture; a filter leaves outliers out.
    maneuver_noise : bool
        Each maneuver has a noise of its own where they differ.
    noise_color : bool
        Residuals that repeat themselves weigh by the prediction errors of an autoregression.
    gives_up : bool
        A filter ends after its first searches where gusts do not explain its innovations; no decision of a strategy.
    """

    recorded_motion: bool = True
    held_numbers: bool = True
    stuck_channels: bool = True
    noise_shape: bool = True
    maneuver_noise: bool = True
    noise_color: bool = True
    gives_up: bool = False


DEFAULT = Treatment()
