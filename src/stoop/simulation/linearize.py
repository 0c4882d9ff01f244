"""Linear models about a steady flight, by exact differentiation of the vehicle's own equations.

The kernel's states are body velocities and a quaternion; engineers want airspeed, angles and rates. With
z = g(x) the minimal state and x' = f(x, u), z' = G(x) f(x, u) with G = dg/dx, so A = d(G f)/dx dx/dz,
where dx/dz is the right inverse of G on the unit sphere of quaternions.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.simulation.initial import initial_states, parameter_rows
from stoop.simulation.mixing import mixed_inputs
from stoop.simulation.steady import Trim
from stoop.simulation.trim import neutral_inputs
from stoop.vehicle import Vehicle

_MINIMAL = {
    "full": ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h"),
    "longitudinal": ("V", "alpha", "q", "theta", "h"),
    "lateral": ("beta", "p", "r", "phi", "psi"),
}
_ON_ROTORS = ("u", "v", "w", *_MINIMAL["full"][3:])  #: angles of the air have no meaning in a hover


@dataclass(frozen=True)
class Mode:
    """One eigenvalue (of a pair, the upper half).

    Attributes
    ----------
    name : str
        Short period, phugoid, Dutch roll, roll, spiral, or the states that take part in it.
    eigenvalue : complex, 1/s
    frequency : float
        Undamped natural frequency, rad/s.
    damping : float
        Damping ratio.
    time_constant : float, s
        Minus one over the real part.
    """

    name: str
    eigenvalue: complex
    frequency: float
    damping: float
    time_constant: float


@dataclass(frozen=True)
class LinearModel:
    """x' = A x + B u, y = C x + D u about a steady flight; SI and rad."""

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    modes: tuple[Mode, ...]


def linearize(vehicle: Vehicle, point: Trim) -> LinearModel:
    """Return A, B, C, D and the modes of a vehicle at a trim point.

    Inputs are control deflections in rad (the mixer is undone) and, where there are any, the channels of thrust and
    rotors. On rotors the states are velocities along the body axes in place of airspeed and angles of the air.
    """
    return _assemble(vehicle, _names(vehicle, point), _evaluate(vehicle, point))


def left_out(vehicle: Vehicle) -> tuple[str, ...]:
    """Say what a linear model x' = A x + B u does not have of a vehicle; nothing where it has all."""
    if not vehicle.sloped:
        return ()
    return (
        "Left out of A, B, C and D: that the body turns as rotors spin up, which the slopes of "
        f"{', '.join(vehicle.sloped)} say; with rotors.lag it is in.",
    )


def state_matrix(vehicle: Vehicle, point: Trim) -> tuple[tuple[str, ...], FloatArray]:
    """Return the names of the states of the linear model, and A alone."""
    G, rates, *_ = _evaluate(vehicle, point)
    return _names(vehicle, point), rates @ np.linalg.pinv(G)


def _minimal(vehicle: Vehicle, point: Trim) -> tuple[str, ...]:
    return _MINIMAL[vehicle.reduce] if "V" in point.start else _ON_ROTORS


def _names(vehicle: Vehicle, point: Trim) -> tuple[str, ...]:
    return (*_minimal(vehicle, point), *(s for s in vehicle.states if s.endswith(".lag")))


_FUNCTIONS: dict[
    tuple[str, ...], Any
] = {}  #: by structure: numbers do not enter, and making one takes a second


def _function(vehicle: Vehicle, minimal: tuple[str, ...]) -> Any:
    """Return the function of states, inputs and parameters that gives G, and the derivatives of G f and the readings."""
    import sympy as sp

    from stoop.vehicle.symbolic.assemble import build_model

    key = (vehicle.structure, *minimal)
    if key not in _FUNCTIONS:
        model = build_model(vehicle)
        x = list(model.states)
        lags = [x[i] for i, s in enumerate(vehicle.states) if s.endswith(".lag")]
        G = sp.Matrix([*_minimal_expressions(vehicle, minimal, model, sp), *lags]).jacobian(x)
        rates, outputs = G * sp.Matrix(model.derivatives), sp.Matrix(model.outputs)
        blocks = [G, *(of.jacobian(by) for of in (rates, outputs) for by in (x, model.inputs))]
        smooth = {"DiracDelta": np.zeros_like}  # the second derivative of abs(), away from its kink
        arguments = [*model.states, *model.inputs, *model.parameters]
        _FUNCTIONS[key] = sp.lambdify(arguments, blocks, [smooth, "numpy"], cse=True)
    return _FUNCTIONS[key]


def _minimal_expressions(vehicle: Vehicle, minimal: tuple[str, ...], model: Any, sp: Any) -> list[Any]:
    """Return the minimal state as expressions of the kernel's state."""
    from stoop.vehicle.symbolic.frames import air, attitude

    symbols = dict(zip(vehicle.states, model.states, strict=True))

    def get(name: str) -> Any:
        return symbols.get(name, sp.Integer(0))

    wind = air((get("u"), get("v"), get("w")))
    turned = attitude((get("e0"), get("e1"), get("e2"), get("e3")))
    table = {
        "V": wind.V, "alpha": wind.alpha, "beta": wind.beta, "phi": turned.phi, "theta": turned.theta,
        "psi": turned.psi, **{n: get(n) for n in ("u", "v", "w", "p", "q", "r", "h")},
    }  # fmt: skip
    return [table[name] for name in minimal]


def _evaluate(vehicle: Vehicle, point: Trim) -> list[FloatArray]:
    rows = parameter_rows(vehicle, point.changes)
    states = initial_states(vehicle, point.start, rows, point.inputs)
    values = _function(vehicle, _minimal(vehicle, point))(*states[:, 0], *point.inputs, *rows[:, 0])
    return [np.atleast_2d(np.asarray(v, dtype=float)) for v in values]


def _mixing(vehicle: Vehicle) -> tuple[tuple[str, ...], FloatArray]:
    """Return the names of the linear model's inputs and the channels (n_u, m) that one unit of each moves."""
    base = neutral_inputs(vehicle)
    now = mixed_inputs(vehicle, dict.fromkeys(vehicle.controls, 0.0), base)
    columns = [
        mixed_inputs(vehicle, {**dict.fromkeys(vehicle.controls, 0.0), c: 1.0}, base) - now
        for c in vehicle.controls
    ]
    names = list(vehicle.controls)
    propulsion = vehicle.file.propulsion
    if propulsion is not None and propulsion.kind != "constant":
        names.append(propulsion.channel)
        columns.append(np.eye(len(base))[vehicle.inputs.index(propulsion.channel)])
    for rotor in vehicle.file.rotor.values():
        if rotor.channel not in names:
            names.append(rotor.channel)
            columns.append(np.eye(len(base))[vehicle.inputs.index(rotor.channel)])
    return tuple(names), np.array(columns).T if columns else np.zeros((len(base), 0))


def _assemble(vehicle: Vehicle, names: tuple[str, ...], numbers: list[FloatArray]) -> LinearModel:
    G, Fx, Fu, Hx, Hu = numbers
    right = np.linalg.pinv(G)
    inputs, mixing = _mixing(vehicle)
    A = Fx @ right
    modes = modes_of(A, names)
    return LinearModel(names, inputs, vehicle.outputs, A, Fu @ mixing, Hx @ right, Hu @ mixing, modes)


def modes_of(A: FloatArray, names: tuple[str, ...]) -> tuple[Mode, ...]:
    """Name the modes by the states that take part in them."""
    keep = [i for i, n in enumerate(names) if n not in ("psi", "h")]  # pure integrators of the rest
    values, vectors = np.linalg.eig(A[np.ix_(keep, keep)])
    left = _inverse(vectors)
    kept = [names[i] for i in keep]
    found = []
    for i, s in enumerate(values):
        if s.imag < 0.0:
            continue
        share = np.abs(vectors[:, i] * left[i])
        weights = dict(zip(kept, share / share.sum(), strict=True))
        frequency = abs(s)
        constant = -1.0 / s.real if s.real else np.inf
        found.append(
            Mode(
                _mode_name(weights, s),
                complex(s),
                float(frequency),
                float(-s.real / frequency) if frequency else 1.0,
                float(constant),
            )
        )
    return tuple(sorted(found, key=lambda m: -m.frequency))


def _inverse(vectors: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return left eigenvectors; a vehicle without drag is a chain of integrators, which has too few of its own."""
    try:
        return np.asarray(np.linalg.inv(vectors))
    except np.linalg.LinAlgError:
        return np.asarray(np.linalg.pinv(vectors, rcond=1e-9))


def _mode_on_rotors(share: Callable[..., float], lags: list[str], oscillates: bool) -> str:
    """Name a mode of a hover: tilt drives speed, speed drives the rates (the hovering cubic of helicopters)."""
    found = {
        "pitch": share("u", "q", "theta"),
        "roll": share("v", "p", "phi"),
        "yaw": share("r"),
        "heave": share("w"),
        "lag": share(*lags),
    }
    kind = max(found, key=lambda name: found[name])
    if kind not in ("pitch", "roll"):
        return kind
    return f"{kind} and speed" if oscillates else kind


def _mode_name(weights: dict[str, float], s: complex) -> str:
    def share(*names: str) -> float:
        return sum(weights.get(n, 0.0) for n in names)

    if "w" in weights:
        return _mode_on_rotors(share, [n for n in weights if n.endswith(".lag")], abs(s.imag) > 1e-9)
    lag = max((n for n in weights if n.endswith(".lag")), key=lambda n: weights[n], default=None)
    if lag is not None and weights[lag] > 0.5:
        return lag
    oscillates = abs(s.imag) > 1e-9
    if share("V", "alpha", "q", "theta") > 0.5:
        kind = "short period" if share("alpha", "q") > share("V", "theta") else "phugoid"
        return kind if oscillates else f"{kind} (aperiodic)"
    if oscillates:
        return "Dutch roll" if share("beta", "r") > share("p", "phi") else "lateral phugoid"
    return "roll" if share("p") > share("phi", "r", "beta") else "spiral"
