"""Deflections of control surfaces -> the recorded channels that give them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.simulation.initial import commanded, parameter_rows
from stoop.vehicle import Vehicle


def mixed_inputs(vehicle: Vehicle, deflections: Mapping[str, float], base: FloatArray) -> FloatArray:
    """Return recorded channels that give the deflections: the smallest change of ``base`` that does.

    Parameters
    ----------
    deflections : mapping
        Control -> rad.
    base : (n_u,) array
        Channels to start from; those that drive no control stay.
    """
    rows = parameter_rows(vehicle)
    names = list(vehicle.controls)
    now = np.array([commanded(vehicle, c, rows, base)[0] for c in names])
    wanted = np.array([deflections.get(c, n) for c, n in zip(names, now, strict=True)])
    gains = np.zeros((len(names), len(base)))
    for i, control in enumerate(names):
        for channel in vehicle.channels_of(control):
            gain = (
                vehicle.value(f"controls.{control}.mix.{channel}")
                if f"controls.{control}.mix.{channel}" in vehicle.rows
                else 1.0
            )
            gains[i, vehicle.inputs.index(channel)] = gain
    return base + np.linalg.pinv(gains) @ (wanted - now) if names else base
