"""The modes of a fitted model at the flight conditions that were fitted."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from stoop.assess.free_response import FreeResponse, free_response, measured_mode
from stoop.assess.modes import Linearized, differentiated, mode_estimates
from stoop.base.arrays import FloatArray
from stoop.errors import SimulationError
from stoop.estimate.fit import Fit
from stoop.estimate.predict import identified_vehicle
from stoop.problem import Piece
from stoop.results.modes import ConditionModes, ModeEstimate
from stoop.simulate import Trim, trim
from stoop.simulate.linearize import state_matrix
from stoop.simulate.trim import neighbors
from stoop.vehicle import Vehicle

ALIKE = 0.05  #: of airspeed and density: maneuvers flown at one condition
ANGLES = ("phi", "theta", "psi")
UNTOLD = "the linear model is not finite there"


@dataclass(frozen=True, eq=False)
class Condition:
    """The mean of some maneuvers: what was flown there.

    Attributes
    ----------
    maneuvers : tuple of int
    loading : mapping of str to float
        Numbers of the vehicle that differ there.
    start : mapping of str to float
        Mean state, SI and rad.
    inputs : (n_u,)
        Mean of the recorded channels.
    samples : int
    """

    maneuvers: tuple[int, ...]
    loading: Mapping[str, float]
    start: Mapping[str, float]
    inputs: FloatArray
    samples: int

    def density(self, vehicle: Vehicle) -> float | None:
        """Return the recorded density, kg/m3, where the vehicle takes it from the log."""
        column = _column(vehicle, "density")
        return None if column is None else float(self.inputs[column])

    def joined(self, other: Condition) -> Condition:
        """Return the mean over both."""
        n, m = self.samples, other.samples
        start = {k: (n * v + m * other.start[k]) / (n + m) for k, v in self.start.items()}
        inputs = (n * self.inputs + m * other.inputs) / (n + m)
        return Condition((*self.maneuvers, *other.maneuvers), self.loading, start, inputs, n + m)


def conditions(fit: Fit) -> list[Condition]:
    """Return the flight conditions of the fitted maneuvers, those alike taken together."""
    density = _column(fit.problem.layout.vehicle, "density")
    out: list[Condition] = []
    for maneuver in range(len(fit.prepared.windows)):
        found = _condition(fit, maneuver)
        same = next((i for i, c in enumerate(out) if _alike(c, found, density)), None)
        if same is None:
            out.append(found)
        else:
            out[same] = out[same].joined(found)
    return out


def modes(fit: Fit, parameters: tuple[str, ...], covariance: FloatArray) -> tuple[ConditionModes, ...]:
    """Return the modes at every fitted flight condition.

    Parameters
    ----------
    fit : Fit
    parameters : tuple of str
        Names of the k free parameters.
    covariance : (k, k), SI
    """
    if fit.problem.layout.vehicle.hovers:
        return ()  # what a hovering vehicle does by itself no autopilot lets it do: there is nothing to measure
    return tuple(_at(fit, condition, parameters, covariance) for condition in conditions(fit))


def _at(
    fit: Fit, condition: Condition, parameters: tuple[str, ...], covariance: FloatArray
) -> ConditionModes:
    vehicle = _loaded(identified_vehicle(fit), condition.loading)
    start = condition.start
    nothing = ConditionModes(condition.maneuvers, "", start["V"], start["h"], start["alpha"], (), UNTOLD)
    if not np.isfinite([*start.values(), *condition.inputs]).all():
        return nothing
    point, about, remark = _point(vehicle, condition)
    try:
        linearized = _linearized(vehicle, condition, point, about, fit)
        found = mode_estimates(linearized, parameters, covariance)
    except (SimulationError, np.linalg.LinAlgError):
        return nothing
    seen = tuple(_measured(fit, condition, mode) for mode in found)
    return replace(nothing, about=about, alpha=point.start["alpha"], modes=seen, remark=remark)


def _measured(fit: Fit, condition: Condition, mode: ModeEstimate) -> ModeEstimate:
    """Return a mode with what the records of its maneuvers show of it."""
    expected = mode.frequency.estimate
    V = condition.start["V"]
    seen = [measured_mode(mode.name, m, _free(fit, m), expected, V) for m in condition.maneuvers]
    return replace(mode, measured=tuple(seen))


def _free(fit: Fit, maneuver: int) -> FreeResponse:
    """Return what followed the last move of the controls in the last piece of a maneuver."""
    vehicle = fit.problem.layout.vehicle
    piece = fit.prepared.pieces[fit.prepared.of_maneuver(maneuver)[-1]]
    names = dict.fromkeys(c for control in vehicle.controls for c in vehicle.channels_of(control))
    controls = piece.inputs[:, [vehicle.inputs.index(c) for c in names]]
    return free_response(piece.time, controls, dict(zip(vehicle.outputs, piece.measured.T, strict=True)))


def _point(vehicle: Vehicle, condition: Condition) -> tuple[Trim, str, str]:
    """Return the trim at this condition; where there is none, the mean state, and why."""
    try:
        V, h = condition.start["V"], condition.start["h"]
        return trim(vehicle, V, h, density=condition.density(vehicle)), "trim", ""
    except SimulationError as error:
        mean = Trim(dict(condition.start), {}, {}, condition.inputs, {}, math.nan)
        return mean, "mean state", f"about the mean state of the maneuvers, for {_reason(error)}"


def _reason(error: SimulationError) -> str:
    """Return what the trim says, without the file's name and the advice."""
    return str(error).rpartition(": ")[2].partition(";")[0]


def _linearized(vehicle: Vehicle, condition: Condition, point: Trim, about: str, fit: Fit) -> Linearized:
    """Return A with its derivatives; the trim follows the parameters, a mean state stays."""
    follow = neighbors(vehicle, point, density=condition.density(vehicle)) if about == "trim" else None

    def matrix(numbers: Mapping[str, float]) -> tuple[tuple[str, ...], FloatArray]:
        if not numbers:
            return state_matrix(vehicle, point)
        return state_matrix(vehicle, follow(numbers) if follow else replace(point, changes=dict(numbers)))

    parameters = fit.problem.layout.parameters
    values = {p.name: fit.estimates[p.name] for p in parameters}
    found = differentiated(matrix, values, {p.name: p.upper - p.lower for p in parameters})
    if not (np.isfinite(found.A).all() and np.isfinite(found.derivative).all()):
        raise SimulationError(UNTOLD)
    return found


def _loaded(vehicle: Vehicle, numbers: Mapping[str, float]) -> Vehicle:
    return (
        vehicle.with_numbers({name: {"value": value} for name, value in numbers.items()})
        if numbers
        else vehicle
    )


def _condition(fit: Fit, maneuver: int) -> Condition:
    indices = fit.prepared.of_maneuver(maneuver)
    pieces = [fit.prepared.pieces[i] for i in indices]
    inputs = np.concatenate([piece.inputs for piece in pieces]).mean(axis=0)
    changes = pieces[0].changes
    return Condition(
        (maneuver,), changes, _mean_state(fit, indices), inputs, sum(len(p.time) for p in pieces)
    )


def _mean_state(fit: Fit, indices: Sequence[int]) -> dict[str, float]:
    """Return the mean of what the model flew, biases taken off; a state that it does not read stays as it began."""
    outputs = fit.problem.layout.vehicle.outputs
    pieces = [fit.prepared.pieces[i] for i in indices]
    flown = np.concatenate([fit.problem.outputs(fit.z, i) for i in indices])
    biases = _biases(fit, pieces[0].maneuver)
    means = {name: float(np.mean(column)) for name, column in zip(outputs, flown.T, strict=True)}
    means |= {name: _mean_angle(flown[:, outputs.index(name)]) for name in ANGLES if name in outputs}
    return {
        name: _start(pieces, means, biases, name)
        for name in ("V", "alpha", "beta", "p", "q", "r", *ANGLES, "h")
    }


def _start(
    pieces: Sequence[Piece], means: Mapping[str, float], biases: Mapping[str, float], name: str
) -> float:
    if name in means:
        return means[name] - biases.get(f"sensors.{name}.bias", 0.0)
    return float(np.mean([piece.start.get(name, 0.0) for piece in pieces]))


def _biases(fit: Fit, maneuver: int) -> dict[str, float]:
    entries = zip(fit.problem.layout.nuisances, fit.z[fit.problem.dimension :], strict=True)
    return {n.name: n.center + n.scale * float(e) for n, e in entries if n.is_bias and n.maneuver == maneuver}


def _mean_angle(values: FloatArray) -> float:
    return float(np.angle(np.mean(np.exp(1j * values))))


def _alike(a: Condition, b: Condition, density: int | None) -> bool:
    """Tell whether two maneuvers were flown at one condition."""
    pairs = [(a.start["V"], b.start["V"])]
    if density is not None:
        pairs.append((float(a.inputs[density]), float(b.inputs[density])))
    near = all(abs(one - other) <= ALIKE * abs(one) for one, other in pairs)
    return near and dict(a.loading) == dict(b.loading)


def _column(vehicle: Vehicle, channel: str) -> int | None:
    return vehicle.inputs.index(channel) if channel in vehicle.inputs else None
