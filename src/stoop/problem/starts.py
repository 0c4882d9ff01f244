"""Kernel parameters and initial states of the pieces of a problem, all pieces and all vectors of unknowns at once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from stoop.base.arrays import FloatArray, IntArray
from stoop.problem.layout import Layout, Nuisance
from stoop.vehicle.channels import rigid_states

if TYPE_CHECKING:
    from stoop.problem.misfit import Piece


@dataclass(frozen=True, eq=False)
class Starts:
    """How each of p pieces starts where its nuisances are at their centers, and what its nuisances change.

    The nuisances of one name, one in each piece, are a row of m: value = center + scale * z[place], with a scale of zero where
    a piece has none.
    """

    layout: Layout
    rows: FloatArray  #: (n_p, p), parameters of the kernel
    states: Mapping[str, FloatArray]  #: (p,) each, initial states by name
    rigid: Mapping[str, FloatArray]  #: (p,) each, states of the rigid body
    inputs: FloatArray  #: (n_u, p), at the first sample
    names: tuple[str, ...]  #: of the m rows
    biases: tuple[int | None, ...]  #: row of the kernel's parameters, None for an initial state; m of them
    center: FloatArray  #: (m, p), SI
    scale: FloatArray  #: (m, p), SI
    place: IntArray  #: (m, p), in the vector of unknowns

    @classmethod
    def of(
        cls, layout: Layout, pieces: Sequence[Piece], own: Sequence[Sequence[tuple[int, Nuisance]]]
    ) -> Starts:
        """Return the starts of pieces, each with its nuisances and their places in the vector."""
        vehicle = layout.vehicle
        rows = np.concatenate([vehicle.parameter_rows(piece.changes) for piece in pieces], axis=1)
        known = dict.fromkeys(name for piece in pieces for name in piece.start)
        states = {name: np.array([float(piece.start.get(name, 0.0)) for piece in pieces]) for name in known}
        is_bias = {n.name: n.is_bias for each in own for _, n in each}
        biases = [vehicle.rows[name] if bias else None for name, bias in is_bias.items()]
        center = np.zeros((len(is_bias), len(pieces)))
        scale, place = np.zeros_like(center), np.full(center.shape, layout.dimension)
        for k, (name, row) in enumerate(zip(is_bias, biases, strict=True)):
            center[k] = states.get(name, 0.0) if row is None else rows[row]
            for i, each in enumerate(own):
                for j, n in each:
                    if n.name == name:
                        place[k, i], center[k, i], scale[k, i] = j, n.center, n.scale
            if row is None:
                states[name] = center[k]
        inputs = np.stack([piece.inputs[0] for piece in pieces], axis=1)
        rigid = rigid_states(states, vehicle)
        return cls(layout, rows, states, rigid, inputs, tuple(is_bias), tuple(biases), center, scale, place)

    def candidates(self, Z: FloatArray, pieces: IntArray) -> tuple[FloatArray, FloatArray]:
        """Return kernel parameters (n_p, P B) and initial states (n_x, P B) of P pieces, one piece after the other.

        `Z` is (B, D + E), or (B, D) with all nuisances at their start.
        """
        layout, count = self.layout, len(Z)
        rows = np.repeat(self.rows[:, pieces, None], count, axis=2)
        rows[layout.rows] = layout.physical(Z).T[:, None]
        start = {name: np.repeat(values[pieces], count) for name, values in self.states.items()}
        rigid: Mapping[str, FloatArray] | None = None
        values = self.center[:, pieces, None]
        if Z.shape[1] > layout.dimension:
            values = values + self.scale[:, pieces, None] * Z.T[self.place[:, pieces]]
            states = [k for k, row in enumerate(self.biases) if row is None]
            start |= {self.names[k]: values[k].ravel() for k in states}
        else:
            rigid = {name: np.repeat(own[pieces], count) for name, own in self.rigid.items()}
        for row, own in zip(self.biases, values, strict=True):
            if row is not None:
                rows[row] = own
        known = rows.reshape(len(rows), -1)
        inputs = np.repeat(self.inputs[:, pieces], count, axis=1)
        return known, layout.vehicle.initial_states(start, known, inputs, rigid)
