"""Measured and simulated curves of every maneuver, fitted or predicted, with their goodness of fit."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from stoop.assessment.baseline import BaselineManeuver, BaselineSegment, baseline_matches
from stoop.assessment.goodness_of_fit import Match, channel_figures, join, unexplained
from stoop.base.arrays import FloatArray
from stoop.base.variables import VARIABLES, WRAPPED
from stoop.problem import Piece
from stoop.problem.prepare import Prepared
from stoop.results.result import ChannelTrace, ManeuverResult, ManeuverTrace, NoiseCovariance, Role
from stoop.vehicle import Vehicle


@dataclass(frozen=True, eq=False)
class Simulated:
    """Maneuvers of one role with what was simulated for each piece.

    `left_out` are the residuals (n, n_y) of each piece with each second left out of the fit, where that is known;
    `deviations` (n, n_y) the standard deviations of what was simulated, measurement noise included; `innovations` (n, n_y)
    those of a filter over their standard deviations.
    """

    role: Role
    prepared: Prepared
    simulated: Sequence[FloatArray]
    left_out: Sequence[FloatArray] | None = None
    deviations: Sequence[FloatArray] | None = None
    innovations: Sequence[FloatArray] | None = None


def maneuver_curves(
    vehicle: Vehicle,
    groups: Sequence[Simulated],
    fitted: Sequence[BaselineManeuver] = (),
    *,
    noise: NoiseCovariance,
    floors: Mapping[str, float] | None = None,
) -> tuple[tuple[ManeuverResult, ...], tuple[ManeuverTrace, ...]]:
    """Return figures and curves of all maneuvers, each beside the trivial lag.

    The lag also learns from `fitted` maneuvers that are not among the groups. `noise` is that of the fit's measurements;
    `floors` are the noise of channels in fitted maneuvers, by name, where these are not among the groups.
    """
    flown = [(g, i, g.prepared.of_maneuver(i)) for g in groups for i in range(len(g.prepared.windows))]
    rate = 1.0 / flown[0][0].prepared.pieces[0].dt
    shown = [baseline_maneuver(vehicle, g.role, [g.prepared.pieces[i] for i in own]) for g, _, own in flown]
    lags = baseline_matches([*fitted, *shown], vehicle.outputs)[len(fitted) :]
    traces = tuple(_trace(vehicle, g, own, lag) for (g, _, own), lag in zip(flown, lags, strict=True))
    learned = [trace for (g, *_), trace in zip(flown, traces, strict=True) if g.role == "fit"]
    left = floors or {name: _left(name, learned, rate) for name in vehicle.outputs}
    deviations, results = np.sqrt(np.diag(noise.of(vehicle.outputs))).tolist(), []
    for (group, index, own), lag, trace in zip(flown, lags, traces, strict=True):
        window, figures = group.prepared.windows[index], {}
        for i, (name, curve) in enumerate(trace.channels.items()):
            if np.isfinite(curve.measured).any():
                model = Match(curve.simulated, _joined(group.left_out, own, i))
                figures[name] = channel_figures(
                    curve.measured, model, rate, lag.get(name), deviations[i],
                    curve.deviation if group.role == "validation" else None,
                    _joined(group.innovations, own, i), left.get(name, math.nan),
                )  # fmt: skip
        spans = tuple((float(p.time[0]), float(p.time[-1])) for p in (group.prepared.pieces[k] for k in own))
        place = (window.flight, window.start, window.stop, group.role, spans)
        results.append(ManeuverResult(*place, figures, window.loading or ""))
    return tuple(results), traces


def _trace(vehicle: Vehicle, group: Simulated, own: Sequence[int], lag: Mapping[str, Match]) -> ManeuverTrace:
    """Return the curves of the pieces of one maneuver."""
    pieces, channels = [group.prepared.pieces[k] for k in own], {}
    for i, name in enumerate(vehicle.outputs):
        columns = [(p.measured[:, i], group.simulated[k][:, i]) for p, k in zip(pieces, own, strict=True)]
        pairs = [unwrapped(z, y, name in WRAPPED) for z, y in columns]
        band = _joined(group.deviations, own, i)
        channels[name] = ChannelTrace(join([z for z, _ in pairs]), join([y for _, y in pairs]), band)
    inputs = {name: join([p.inputs[:, i] for p in pieces]) for i, name in enumerate(vehicle.recorded)}
    baseline = {name: match.simulated for name, match in lag.items()}
    return ManeuverTrace(join([p.time for p in pieces]), channels, inputs, baseline)


def _left(name: str, fitted: Sequence[ManeuverTrace], rate: float) -> float:
    """Return what the better of model and lag leaves of a channel in the fitted maneuvers; NaN where one is missing."""
    if not fitted or not all(name in trace.baseline for trace in fitted):
        return math.nan
    own = [(trace.channels[name], trace.baseline[name]) for trace in fitted]
    model = unexplained([(curve.measured, curve.simulated) for curve, _ in own], rate)
    return min(model, unexplained([(curve.measured, lag) for curve, lag in own], rate))


def _joined(values: Sequence[FloatArray] | None, own: Sequence[int], column: int) -> FloatArray | None:
    """Return one channel of values (n, n_y) of some pieces as one curve."""
    return None if values is None else join([values[k][:, column] for k in own])


def unwrapped(measured: FloatArray, simulated: FloatArray, angle: bool) -> tuple[FloatArray, FloatArray]:
    """Return measured and simulated curves (n,); an angle is unwrapped, the simulated one beside the measured."""
    z, y = measured.copy(), simulated.copy()
    if angle:
        recorded = np.isfinite(z)
        z[recorded] = np.unwrap(z[recorded])
        y = np.unwrap(y)
        if recorded.any():
            y += 2.0 * np.pi * np.round(float((z - y)[recorded][0]) / (2.0 * np.pi))
    return z, y


def baseline_maneuver(vehicle: Vehicle, role: Role, pieces: Sequence[Piece]) -> BaselineManeuver:
    """Return a maneuver's pieces as the baseline model takes them.

    Rotors also count as what they are commanded to do about each axis, and together: sums by lever and spin.
    """
    controls = dict.fromkeys(c for control in vehicle.controls for c in vehicle.channels_of(control))
    rotors, segments = vehicle.file.rotor, []
    for piece in pieces:
        commands = {name: piece.inputs[:, vehicle.inputs.index(name)] for name in controls}
        if rotors:
            u = np.array([piece.inputs[:, vehicle.inputs.index(r.channel)] for r in rotors.values()])
            at = np.array([[vehicle.value(f"rotor.{name}.position.{a}") for a in "xy"] for name in rotors])
            about = np.array([1.0 if r.spin == "ccw" else -1.0 for r in rotors.values()])
            moments = {"roll": -at[:, 1] @ u, "pitch": at[:, 0] @ u, "yaw": about @ u, "heave": u.sum(axis=0)}
            commands |= {f"rotors_{axis}": x for axis, x in moments.items()}
        measured = {}
        for i, name in enumerate(vehicle.outputs):
            column = piece.measured[:, i]
            measured[name] = unwrapped(column, column, name in WRAPPED)[0]
        segments.append(BaselineSegment(commands, measured))
    return BaselineManeuver(role, tuple(segments), 1.0 / pieces[0].dt)


def channel_units(vehicle: Vehicle) -> dict[str, str]:
    """Return the unit of every output, input and control."""
    names = dict.fromkeys((*vehicle.outputs, *vehicle.coupled_to(()).inputs, *vehicle.controls))
    return {name: VARIABLES[name].unit if name in VARIABLES else "rad" for name in names}
