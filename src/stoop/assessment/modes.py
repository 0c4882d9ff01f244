r"""Natural modes of a fitted model at the flight conditions that were fitted, with intervals from its covariance.

For a simple eigenvalue :math:`\lambda` of A with right and left eigenvectors x and y,

.. math:: \frac{\partial\lambda}{\partial\theta} = \frac{y^H (\partial A/\partial\theta)\, x}{y^H x},

so standard errors follow by the delta method, except where two real modes are about to become an oscillation, or an oscillation
two real modes: there the eigenvalue has no derivative. Parameters are therefore also drawn from their normal distribution, with
the eigenvalues of :math:`A + \sum \delta\theta_i\, \partial A/\partial\theta_i`. Where more than a few draws have another
character, or their spread is not that of the derivatives, the intervals are percentiles of the draws.

References
----------
P. Lancaster, "On eigenvalues of matrices dependent on a parameter", *Numerische Mathematik* 6, 1964, pp. 377-387
(the derivative).
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., 2016, chapter 3 (the modes).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any, Final

import numpy as np

from stoop.assessment.covariance import NORMAL_95
from stoop.base.arrays import BoolArray, ComplexArray, FloatArray
from stoop.base.notices import notice
from stoop.base.packages import hooks
from stoop.base.variables import EULER, RATES
from stoop.errors import SimulationError
from stoop.estimate.estimate import Estimate
from stoop.problem.observation import at_center_of_gravity, observation_model, true_values
from stoop.results.modes import ConditionModes, DerivedValue, MeasuredMode, ModeEstimate, StateEquations
from stoop.simulation import Trim, trim
from stoop.simulation.linearize import LinearModel, Mode, linear_models, oscillates, tracked_modes
from stoop.simulation.trim import Trims
from stoop.vehicle import Vehicle

DRAWS: Final = 1000
OTHER_CHARACTER: Final = 0.025  #: of the draws: an end of the 95 % interval may lie among them
SPREAD_RATIO: Final = 1.25  #: by which the draws may spread more or less than the derivatives say
STEP: Final = 1e-4  #: of a parameter's scale, for central differences of A: error of the order 1e-8
#: of an eigenvalue: an unknown parameter that may change it by less (by rounding, by a trim with sideslip) does not matter
MIN_EFFECT: Final = 1e-3
QUANTITIES: Final = ("real", "imag", "frequency", "damping", "time_constant")  #: that describe a mode
SAME_CONDITION: Final = 0.05  #: of airspeed and density, between maneuvers flown at one condition


@dataclass(frozen=True, eq=False)
class Linearized:
    """A and how it depends on the parameters, and B likewise."""

    names: tuple[str, ...]  #: the n states; heading and altitude are left out
    A: FloatArray  #: (n, n)
    derivative: FloatArray  #: (k, n, n), per SI unit of each parameter
    room: FloatArray | float = 1.0  #: (k,), or a number; how far each parameter may sensibly move
    B: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))  #: (n, m)
    B_derivative: FloatArray = field(default_factory=lambda: np.zeros((0, 0, 0)))  #: (k, n, m)

    def gradient(self, eigenvalue: complex) -> ComplexArray:
        """Return the derivative (k,) of one eigenvalue by every parameter."""
        values, right = np.linalg.eig(self.A)
        i, left = int(np.argmin(np.abs(values - eigenvalue))), np.linalg.inv(right)  # rows, y^H x = 1
        return np.asarray(np.einsum("i,kij,j->k", left[i], self.derivative, right[:, i]), dtype=complex)


def differentiated(
    vehicle: Vehicle,
    follow: Callable[[Mapping[str, FloatArray]], Trims],
    values: Mapping[str, float],
    scales: Mapping[str, float],
) -> Linearized:
    """Return A and B with their derivatives by central differences at the parameters' values, SI.

    `follow` returns steady flights for changed parameters, (B,) each; `scales` are how far each may sensibly move.
    """
    # the estimate is the first lane; two follow for each parameter that a motion depends on
    places = [i for i, name in enumerate(values) if not name.startswith("sensors.")]
    room = np.array([scales[name] for name in values])
    changes = {name: np.full(1 + 2 * len(places), value) for name, value in values.items()}
    for lane, i in enumerate(places):
        step, name = STEP * room[i], list(values)[i]
        changes[name][1 + 2 * lane : 3 + 2 * lane] += step, -step
    names, A, B, *_ = linear_models(vehicle, follow(changes))
    keep = [i for i, name in enumerate(names) if name not in LinearModel.INTEGRATORS]
    both, n = np.concatenate([A[:, keep][:, :, keep], B[:, keep]], axis=2), len(keep)
    slopes = np.zeros((len(values), *both.shape[1:]))
    slopes[places] = (both[1::2] - both[2::2]) / (2.0 * (STEP * room[places])[:, None, None])
    kept = tuple(names[i] for i in keep)
    return Linearized(kept, both[0, :, :n], slopes[:, :, :n], room, both[0, :, n:], slopes[:, :, n:])


def state_equation_estimates(
    linearized: Linearized, inputs: tuple[str, ...], covariance: FloatArray
) -> StateEquations:
    """Return A and B with standard errors, to first order in the covariance (k, k), SI.

    A parameter of infinite variance makes an entry unknown that it could change by :data:`MIN_EFFECT` of the largest of its row.
    """
    lost, known = _known(covariance)
    both = np.hstack([linearized.A, linearized.B])
    slopes = np.concatenate([linearized.derivative, linearized.B_derivative], axis=2)
    variance = np.einsum("kij,kl,lij->ij", slopes, known, slopes)
    reach = np.abs(slopes) * np.broadcast_to(linearized.room, len(slopes))[:, None, None]
    unknown = (reach[lost] > MIN_EFFECT * np.abs(both).max(axis=1, keepdims=True)).any(axis=0)
    errors = np.where(unknown, np.nan, np.sqrt(np.maximum(variance, 0.0)))
    n = len(linearized.names)
    parts = (both[:, :n], both[:, n:], errors[:, :n], errors[:, n:])
    return StateEquations(linearized.names, inputs, *(tuple(map(tuple, part.tolist())) for part in parts))


def _known(covariance: FloatArray) -> tuple[BoolArray, FloatArray]:
    """Return which parameters (k,) have no finite variance, and the covariance of the others, zero elsewhere."""
    lost = ~np.isfinite(np.diag(covariance))
    return lost, np.where(lost[:, None] | lost[None, :], 0.0, covariance)


def mode_estimates(
    linearized: Linearized, parameters: tuple[str, ...], covariance: FloatArray
) -> tuple[ModeEstimate, ...]:
    """Return the flight modes, lags of surfaces left out, with their intervals from the covariance (k, k), SI.

    A parameter of infinite variance makes a mode unknown that it could change by :data:`MIN_EFFECT`.
    """
    lost, known = _known(covariance)
    power, basis = np.linalg.eigh(0.5 * (known + known.T))
    spread = basis * np.sqrt(np.maximum(power, 0.0))
    steps = np.random.default_rng(0).standard_normal((DRAWS, len(power))) @ spread.T
    lanes = linearized.A + np.tensordot(steps, linearized.derivative, 1)
    out = []
    for mode, values in tracked_modes(np.concatenate([linearized.A[None], lanes]), linearized.names):
        gradient = linearized.gradient(mode.eigenvalue)
        matters = np.abs(gradient) * linearized.room > MIN_EFFECT * abs(mode.eigenvalue)
        unknown = tuple(n for n, both in zip(parameters, matters & lost, strict=True) if both)
        if unknown:
            remark = notice("mode-depends-on-unknown", mode.name, parameters=unknown)
            found: dict[str, Any] = {name: DerivedValue(value) for name, value in _quantities(mode).items()}
            out.append(ModeEstimate(mode.name, **found, remark=(remark,)))
            continue
        out.append(_estimated(mode, gradient, known, values[1:]))
    return tuple(out)


def _quantities(mode: Mode) -> dict[str, float]:
    numbers = (mode.eigenvalue.real, mode.eigenvalue.imag, mode.frequency, mode.damping, mode.time_constant)
    return dict(zip(QUANTITIES, numbers, strict=True))


def _estimated(
    mode: Mode, gradient: ComplexArray, covariance: FloatArray, drawn: ComplexArray
) -> ModeEstimate:
    """Return one mode from its gradient (k,) and the draws (d, 1 or 2) of its eigenvalue or pair."""
    s, size = mode.eigenvalue, abs(mode.eigenvalue) or math.nan
    of_size = (s.real * gradient.real + s.imag * gradient.imag) / size
    slopes = {
        "real": gradient.real,
        "imag": gradient.imag,
        "frequency": of_size,
        "damping": -gradient.real / size + s.real * of_size / size**2,
        "time_constant": gradient.real / (s.real**2 or math.nan),
    }
    errors = {n: math.sqrt(max(0.0, float(g @ covariance @ g))) for n, g in slopes.items()}
    # the quantities of every draw; of a pair that became two real modes those of their product
    middle = drawn.mean(axis=1).real
    product = np.prod(drawn, axis=1).real if drawn.shape[1] == 2 else np.abs(drawn[:, 0]) ** 2
    frequency = np.sqrt(np.maximum(product, 0.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        damping = -middle / frequency
    samples = {"real": middle, "imag": np.abs(drawn[:, 0].imag), "frequency": frequency, "damping": damping}
    pair, spread = drawn.shape[1] == 2, float(np.std(middle))
    other = float(np.mean(oscillates(drawn[:, 0]) != pair))
    unlike = errors["real"] > 0.0 and not 1.0 / SPREAD_RATIO < spread / errors["real"] < SPREAD_RATIO
    sampled, spans, values = other > OTHER_CHARACTER or unlike, {}, _quantities(mode)
    for name, draws in samples.items():
        spans[name] = (values[name] - NORMAL_95 * errors[name], values[name] + NORMAL_95 * errors[name])
        if sampled:
            finite = draws[np.isfinite(draws)]
            low, high = np.quantile(finite, [0.025, 0.975]) if finite.size else (math.nan, math.nan)
            spans[name] = (float(low), float(high))
    if not pair:
        errors |= {"imag": math.nan, "damping": math.nan}  # of a real mode these are what they are
    code = "mode-becomes-real" if pair else "mode-becomes-oscillation"
    remarks = [notice(code, mode.name, share=other)] if other > OTHER_CHARACTER else []
    if spans["real"][0] < 0.0 < spans["real"][1]:
        spans["time_constant"] = (math.nan, math.nan)
        remarks.append(notice("mode-stability-unknown", mode.name))
    else:
        low, high = sorted(-1.0 / end if end else math.inf for end in spans["real"])
        spans["time_constant"] = (low, high)
    found: dict[str, Any] = {n: DerivedValue(values[n], errors[n], *spans[n]) for n in values}
    method = "sampled" if sampled else "delta"
    return ModeEstimate(mode.name, **found, method=method, other_character=other, remark=tuple(remarks))


@dataclass(frozen=True, eq=False)
class Condition:
    """The mean of some maneuvers: what was flown there."""

    maneuvers: tuple[int, ...]
    loading: Mapping[str, float]  #: numbers of the vehicle that differ there
    start: Mapping[str, float]  #: mean state, SI and rad
    inputs: FloatArray  #: (n_u,); mean of the recorded channels
    samples: int

    def is_like(self, other: Condition, vehicle: Vehicle) -> bool:
        """Tell whether both were flown at one airspeed and density, in one loading."""
        pairs = [(self.start["V"], other.start["V"])]
        if "density" in vehicle.inputs:
            i = vehicle.inputs.index("density")
            pairs.append((float(self.inputs[i]), float(other.inputs[i])))
        near = all(abs(one - another) <= SAME_CONDITION * abs(one) for one, another in pairs)
        return near and dict(self.loading) == dict(other.loading)

    def joined(self, other: Condition) -> Condition:
        """Return the mean over both."""
        n, m = self.samples, other.samples
        start = {k: (n * v + m * other.start[k]) / (n + m) for k, v in self.start.items()}
        inputs = (n * self.inputs + m * other.inputs) / (n + m)
        return Condition((*self.maneuvers, *other.maneuvers), self.loading, start, inputs, n + m)


def conditions(fit: Estimate) -> list[Condition]:
    """Return the flight conditions of the fitted maneuvers, those alike taken together.

    They are means of what the model flew, without errors of instruments and wind; what it does not read stays as it began.
    """
    layout, identified, out = fit.problem.layout, fit.identified_vehicle, list[Condition]()
    vehicle = layout.vehicle
    for maneuver in range(len(fit.prepared.windows)):
        indices = fit.prepared.of_maneuver(maneuver)
        pieces = [fit.prepared.pieces[i] for i in indices]
        flown = np.concatenate([fit.readings[i] for i in indices])
        numbers = identified.values.copy()
        for n, e in zip(layout.nuisances, fit.z[layout.dimension :].tolist(), strict=True):
            if n.is_bias and n.maneuver == pieces[0].maneuver:
                numbers[identified.rows[n.name]] = n.center + n.scale * e
        start, read = dict[str, float](), dict[str, float]()
        for name in ("V", "alpha", "beta", *RATES, *EULER, "h"):
            if name not in vehicle.outputs:
                start[name] = float(np.mean([piece.start.get(name, 0.0) for piece in pieces]))
                continue
            column = flown[:, vehicle.outputs.index(name)]
            read[name] = float(np.angle(np.mean(np.exp(1j * column))) if name in EULER else np.mean(column))
        start = at_center_of_gravity(identified, start | true_values(identified, read, numbers))
        inputs = np.concatenate([piece.inputs for piece in pieces]).mean(axis=0)
        found = Condition((maneuver,), pieces[0].changes, start, inputs, sum(len(p.time) for p in pieces))
        same = next((i for i, c in enumerate(out) if c.is_like(found, vehicle)), None)
        if same is None:
            out.append(found)
        else:
            out[same] = out[same].joined(found)
    return out


def modes(fit: Estimate, parameters: tuple[str, ...], covariance: FloatArray) -> tuple[ConditionModes, ...]:
    """Return the modes at every fitted flight condition, from the covariance (k, k), SI, of the parameters named.

    None of a vehicle that no autopilot leaves to itself.
    """
    own = conditions(fit) if observation_model(fit.problem.layout.vehicle).open_loop else []
    return tuple(_at(fit, condition, parameters, covariance) for condition in own)


def _at(
    fit: Estimate, condition: Condition, parameters: tuple[str, ...], covariance: FloatArray
) -> ConditionModes:
    vehicle, start = fit.identified_vehicle.coupled_to(()), condition.start
    if condition.loading:
        vehicle = vehicle.with_numbers({name: {"value": value} for name, value in condition.loading.items()})
    place = (start["V"], start["h"], start["alpha"])
    nothing = ConditionModes(condition.maneuvers, "", *place, (), notice("linear-model-not-finite"))
    if not np.isfinite([*start.values(), *condition.inputs]).all():
        return nothing
    channels = condition.inputs[: len(vehicle.inputs)]
    # kg/m3, recorded where the vehicle takes it from the log
    density = dict(zip(vehicle.inputs, channels.tolist(), strict=True)).get("density")
    try:
        point, about, remark = trim(vehicle, start["V"], start["h"], density=density), "trim", None
    except SimulationError:
        point, about = Trim(dict(start), {}, {}, channels, {}, math.nan), "mean state"
        remark = notice("modes-about-mean-state")
    free = fit.problem.layout.parameters
    values, widths = {p.name: vehicle.value(p.name) for p in free}, {p.name: p.upper - p.lower for p in free}
    try:
        # the trim follows changed numbers, a mean state stays
        follow = point.neighbors() if about == "trim" else partial(point.lanes, vehicle)
        linearized = differentiated(vehicle, follow, values, widths)
        if not (np.isfinite(linearized.A).all() and np.isfinite(linearized.derivative).all()):
            return nothing
        found = mode_estimates(linearized, parameters, covariance)
        linear = state_equation_estimates(linearized, vehicle.model_inputs(), covariance)
    except (SimulationError, np.linalg.LinAlgError):
        return nothing
    measure = hooks("measured_modes", list[MeasuredMode])
    at = fit, condition.maneuvers, condition.start["V"]
    pairs = ((m, (y for f in measure for y in f(*at, m.name, m.frequency.estimate))) for m in found)
    recorded = (replace(m, measured=tuple(values)) for m, values in pairs)
    known = replace(nothing, about=about, alpha=point.start["alpha"], remark=remark, linear=linear)
    return replace(known, modes=tuple(recorded))
