"""Measured and simulated curves of every maneuver, fitted or predicted, with their goodness of fit."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stoop.assess.baseline import BaselineManeuver, BaselineSegment, baseline_matches
from stoop.assess.goodness_of_fit import Match, channel_figures, join
from stoop.base.arrays import FloatArray
from stoop.base.variables import VARIABLES, WRAPPED
from stoop.problem import Piece
from stoop.problem.prepare import Prepared
from stoop.results.result import ChannelTrace, GoodnessOfFit, ManeuverResult, ManeuverTrace, Role
from stoop.vehicle import Vehicle


@dataclass(frozen=True, eq=False)
class Simulated:
    """Maneuvers of one role with what was simulated for each piece.

    `left_out` are the residuals (n, n_y) of each piece with each second left out of the fit, where that is known.
    """

    role: Role
    prepared: Prepared
    simulated: Sequence[FloatArray]
    left_out: Sequence[FloatArray] | None = None

    def of(self, maneuver: int) -> list[tuple[Piece, FloatArray]]:
        """Return pieces and simulated readings of a maneuver."""
        return [(self.prepared.pieces[i], self.simulated[i]) for i in self.prepared.of_maneuver(maneuver)]


def maneuver_curves(
    vehicle: Vehicle, groups: Sequence[Simulated], fitted: Sequence[BaselineManeuver] = ()
) -> tuple[tuple[ManeuverResult, ...], tuple[ManeuverTrace, ...]]:
    """Return figures and curves of all maneuvers, each beside the trivial lag.

    Parameters
    ----------
    vehicle : Vehicle
    groups : sequence of Simulated
    fitted : sequence of BaselineManeuver
        Fitted maneuvers that are not among the groups; the lag learns from them.
    """
    flown = [(group, index) for group in groups for index in range(len(group.prepared.windows))]
    rate = 1.0 / flown[0][0].prepared.pieces[0].dt
    shown = [baseline_maneuver(vehicle, g.role, [p for p, _ in g.of(i)]) for g, i in flown]
    lags = baseline_matches([*fitted, *shown], vehicle.outputs)[len(fitted) :]
    traces = [_trace(vehicle, g, i, lag) for (g, i), lag in zip(flown, lags, strict=True)]
    figures = [
        _figures(trace, _left_out(vehicle, g, i), lag, rate)
        for (g, i), trace, lag in zip(flown, traces, lags, strict=True)
    ]
    return tuple(_result(g, i, found) for (g, i), found in zip(flown, figures, strict=True)), tuple(traces)


def _unwrapped(
    piece: Piece, simulated: FloatArray, channel: int, angle: bool
) -> tuple[FloatArray, FloatArray]:
    """Return measured and simulated curves; an angle is unwrapped, the simulated one beside the measured."""
    z, y = piece.measured[:, channel].copy(), simulated[:, channel].copy()
    if angle:
        seen = np.isfinite(z)
        z[seen] = np.unwrap(z[seen])
        y = np.unwrap(y)
        near = z - y
        if seen.any():
            y += 2.0 * np.pi * np.round(float(near[seen][0]) / (2.0 * np.pi))
    return z, y


def _trace(vehicle: Vehicle, group: Simulated, index: int, lag: Mapping[str, Match]) -> ManeuverTrace:
    pieces = group.of(index)
    channels = {}
    for i, name in enumerate(vehicle.outputs):
        pairs = [_unwrapped(p, y, i, name in WRAPPED) for p, y in pieces]
        channels[name] = ChannelTrace(join([z for z, _ in pairs]), join([y for _, y in pairs]))
    inputs = {name: join([p.inputs[:, i] for p, _ in pieces]) for i, name in enumerate(vehicle.recorded)}
    return ManeuverTrace(
        join([p.time for p, _ in pieces]), channels, inputs, {c: m.simulated for c, m in lag.items()}
    )


def _left_out(vehicle: Vehicle, group: Simulated, index: int) -> dict[str, FloatArray]:
    """Return the left-out residuals of a maneuver by channel, segments joined as its curves are."""
    if group.left_out is None:
        return {}
    pieces = [group.left_out[i] for i in group.prepared.of_maneuver(index)]
    return {name: join([piece[:, i] for piece in pieces]) for i, name in enumerate(vehicle.outputs)}


def _figures(
    trace: ManeuverTrace, left_out: Mapping[str, FloatArray], lag: Mapping[str, Match], rate: float
) -> dict[str, GoodnessOfFit]:
    return {
        name: channel_figures(curve.measured, Match(curve.simulated, left_out.get(name)), rate, lag.get(name))
        for name, curve in trace.channels.items()
        if np.isfinite(curve.measured).any()
    }


def _result(group: Simulated, index: int, figures: Mapping[str, GoodnessOfFit]) -> ManeuverResult:
    window = group.prepared.windows[index]
    spans = tuple((float(p.time[0]), float(p.time[-1])) for p, _ in group.of(index))
    loading = window.loading or ""
    return ManeuverResult(window.flight, window.start, window.stop, group.role, spans, figures, loading)


def baseline_maneuver(vehicle: Vehicle, role: Role, pieces: Sequence[Piece]) -> BaselineManeuver:
    """Return a maneuver's pieces as the trivial model sees them."""
    controls = dict.fromkeys(c for control in vehicle.controls for c in vehicle.channels_of(control))
    columns = [(name, vehicle.inputs.index(name)) for name in controls]
    segments = []
    for piece in pieces:
        mixed = mixed_rotors(vehicle, piece)
        measured = {
            name: _unwrapped(piece, piece.measured, i, name in WRAPPED)[0]
            for i, name in enumerate(vehicle.outputs)
        }
        commands = {name: piece.inputs[:, i] for name, i in columns}
        segments.append(BaselineSegment(commands | mixed, measured))
    return BaselineManeuver(role, tuple(segments), 1.0 / pieces[0].dt)


def mixed_rotors(vehicle: Vehicle, piece: Piece) -> dict[str, FloatArray]:
    """Return what rotors are commanded to do about each axis, and together, (n,) each: sums by lever and spin."""
    rotors = vehicle.file.rotor
    if not rotors:
        return {}
    u = np.array([piece.inputs[:, vehicle.inputs.index(r.channel)] for r in rotors.values()])
    at = np.array([[vehicle.value(f"rotor.{name}.position.{a}") for a in "xy"] for name in rotors])
    about = np.array([1.0 if r.spin == "ccw" else -1.0 for r in rotors.values()])
    return {
        "rotors_roll": -at[:, 1] @ u,
        "rotors_pitch": at[:, 0] @ u,
        "rotors_yaw": about @ u,
        "rotors_heave": u.sum(axis=0),
    }


def channel_units(vehicle: Vehicle) -> dict[str, str]:
    """Return the unit of every output, input and control."""
    names = dict.fromkeys((*vehicle.outputs, *vehicle.inputs, *vehicle.controls))
    return {name: VARIABLES[name].unit if name in VARIABLES else "rad" for name in names}
