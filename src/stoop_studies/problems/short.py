"""Flights on rotors as a cost over short windows, each of which begins in the state that was measured there.

Open loop a vehicle on rotors falls out of any longer record, with the right numbers as with wrong ones: a simulation
from the first sample says nothing after a second or two. Over a part of a second every candidate stays near enough
to be compared, so the cost J = (Z - Y)' Q (Z - Y) of twelve channels is summed over windows. Nothing but the numbers
sought is unknown; optimizers that know no nuisances search the same problem as those that do.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.estimate.filter_error.linearization import interpolated, unwrapped
from stoop.estimate.shooting.windows import edges
from stoop.problem import Layout, Misfit, Piece, Weights
from stoop.problem.observation import through_air
from stoop.simulate import parameter_rows
from stoop.simulate.delays import first_order_lag
from stoop.simulate.initial import commanded
from stoop.vehicle import Vehicle

RATES = ("p", "q", "r")


def windows(vehicle: Vehicle, piece: Piece, length: float, beside: Mapping[str, FloatArray]) -> list[Piece]:
    """Return the windows of a piece.

    Parameters
    ----------
    vehicle : Vehicle
        Its outputs are those of a vehicle that hovers; there is no wind.
    piece : Piece
    length : float, s
    beside : mapping
        What is known of the state at every sample (n,) beside the readings: ``NAME.lag``, by how much each rotor is off
        its command, in units of x; the altitude ``h``, m.
    """
    read = {c: interpolated(unwrapped(piece.measured[:, i])) for i, c in enumerate(vehicle.outputs)}
    state = through_air({n: read[n] for n in ("vn", "ve", "vd", "phi", "theta", "psi")})
    state |= {n: read[n] for n in RATES} | dict(beside)
    cuts = edges(len(piece.time), max(2, round(length / piece.dt)))
    begins = ({**piece.start, **{n: float(values[a]) for n, values in state.items()}} for a in cuts[:-1])
    return [piece.part(a, b, start) for (a, b), start in zip(pairwise(cuts), begins, strict=True)]


def posed(vehicle: Vehicle, pieces: Sequence[Piece], weights: Weights) -> Misfit:
    """Return the problem: every free number of the vehicle is sought, biases of sensors among them."""
    sought = tuple(p for p in vehicle.parameters if p.free)
    return Misfit(Layout(vehicle, sought, ()), tuple(pieces), weights, (tuple(len(p.time) for p in pieces),))


def motors_behind(vehicle: Vehicle, piece: Piece) -> dict[str, FloatArray]:
    """Return by how much rotors are off their commands (n,), with the lag of the vehicle's file: none is measured."""
    rows = parameter_rows(vehicle, piece.changes)
    every, lag = np.repeat(rows, len(piece.inputs), axis=1), vehicle.value("rotors.lag")
    asked = {r: commanded(vehicle, r, every, piece.inputs.T) for r in vehicle.rotors}
    return {f"{r}.lag": first_order_lag(x, lag, piece.dt) - x for r, x in asked.items()}
