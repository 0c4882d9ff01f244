"""Linear models about a steady flight, by exact differentiation of the vehicle's own equations.

The kernel's states are body velocities and a quaternion. With z = g(x) the minimal state (airspeed, angles, rates) and
x' = f(x, u), z' = G(x) f(x, u) with G = dg/dx, so A = d(G f)/dx dx/dz, where dx/dz is the right inverse of G on the
unit sphere of quaternions. As objects of python-control and SciPy, its delays are Padé approximations in series.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from math import factorial
from typing import Any, ClassVar, Final

import numpy as np
from numpy.typing import ArrayLike

from stoop.base.arrays import BoolArray, ComplexArray, FloatArray
from stoop.base.dual import Dual
from stoop.base.extras import install
from stoop.base.notices import Notice, notice
from stoop.base.numbers import without_rounding
from stoop.base.text import Summarized
from stoop.base.variables import EULER
from stoop.errors import SimulationError, StoopError
from stoop.simulation.trim import Trim, Trims
from stoop.vehicle import Vehicle
from stoop.vehicle.arrays import euler_angles, flow_angles
from stoop.vehicle.delays import output_delays

System = tuple[FloatArray, FloatArray, FloatArray, FloatArray]
REAL: Final = 1e-9  #: 1/s; a smaller imaginary part is rounding
_MINIMAL = {
    "full": ("V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "h"),
    "longitudinal": ("V", "alpha", "q", "theta", "h"),
    "lateral": ("beta", "p", "r", "phi", "psi"),
}


@dataclass(frozen=True)
class Mode:
    """One eigenvalue (of a pair, the upper half)."""

    name: str  #: short period, phugoid, Dutch roll, roll, spiral, or the states that take part in it
    eigenvalue: complex  #: 1/s
    frequency: float  #: undamped natural frequency, rad/s
    damping: float  #: damping ratio
    time_constant: float  #: minus one over the real part, s


def left_out(vehicle: Vehicle) -> tuple[Notice, ...]:
    """Return what of a vehicle x' = A x + B u, y = C x + D u cannot express, with the numbers."""
    servos, delays = vehicle.held_numbers(("rate_limit", "dead_zone")), vehicle.held_numbers(("delay",))
    found = [notice("linear-model-without-limits", numbers=servos)] if servos else []
    found += [notice("linear-model-without-delays", numbers=delays)] if delays else []
    found += [notice("linear-model-without-spin-up", channels=vehicle.sloped)] if vehicle.sloped else []
    return tuple(found)


@dataclass(frozen=True, repr=False)
class LinearModel(Summarized):
    """x' = A x + B u, y = C x + D u about a steady flight, with delays in series; SI and rad."""

    INTEGRATORS: ClassVar = ("psi", "h")  #: states that nothing depends on, or next to nothing
    left_out = staticmethod(left_out)

    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    A: FloatArray
    B: FloatArray
    C: FloatArray
    D: FloatArray
    modes: tuple[Mode, ...]
    input_delays: FloatArray  #: (n_u,), s, with which the inputs come before B and D
    output_delays: FloatArray  #: (n_y,), s, with which the readings are delivered

    @classmethod
    def of_lanes(cls, vehicle: Vehicle, points: Trims) -> list[LinearModel]:
        """Return the linear model of each lane."""
        inputs, shown = vehicle.model_inputs(), len(vehicle.outputs) - len(vehicle.positions)
        names, *matrices = linear_models(vehicle, points)
        out = []
        for values, A, B, C, D in zip(points.rows.T, *matrices, strict=True):
            late, arrival = _delays(vehicle, inputs, values)
            modes = modes_of(A, names)
            A, B, C, D = (without_rounding(M, abs(M).max(initial=0.0)) for M in (A, B, C, D))
            read = vehicle.outputs[:shown], A, B, C[:shown], D[:shown]
            out.append(cls(names, inputs, *read, modes, late, arrival[:shown]))
        return out

    def to_control(self, pade: int | None = None) -> Any:
        """Return a ``control.StateSpace`` of python-control, with names; dots in them become underscores.

        Parameters
        ----------
        pade : int, optional
            Order of the Padé approximations of delays; 0 leaves them out. Needed for a model that has delays.

        Raises
        ------
        StoopError
            python-control is not installed.
        SimulationError
            The model has delays and no order is given.
        """
        return control_system(self, pade)

    def to_scipy(self, pade: int | None = None) -> Any:
        """Return a ``scipy.signal.StateSpace``, continuous in time; `pade` as of :meth:`to_control`.

        Raises
        ------
        SimulationError
            The model has delays and no order is given.
        """
        from scipy.signal import StateSpace

        return StateSpace(*with_delays(self, pade)[0])


def linearize(vehicle: Vehicle, point: Trim) -> LinearModel:
    """Return A, B, C, D and the modes of a vehicle at a trim point: :func:`stoop.linearize`."""
    return LinearModel.of_lanes(vehicle, point.lanes(vehicle))[0]


def _delays(vehicle: Vehicle, inputs: tuple[str, ...], values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the delays of the inputs of a linear model and of the readings, s, by the numbers (n_p,) of the vehicle."""
    by_channel = {vehicle.inputs[column]: values[row] for column, row in vehicle.input_delays()}
    channels = (vehicle.channels_of(n)[0] if n in vehicle.controls else n for n in inputs)
    late = [by_channel.get(channel, 0.0) for channel in channels]
    readings = np.zeros(len(vehicle.outputs))
    for column, row in output_delays(vehicle):
        readings[column] = values[row]
    return np.array(late), readings


def modes_of(A: FloatArray, names: tuple[str, ...]) -> tuple[Mode, ...]:
    """Name the modes by the states that take part in them."""
    keep = [i for i, n in enumerate(names) if n not in LinearModel.INTEGRATORS]
    values, vectors = np.linalg.eig(A[np.ix_(keep, keep)])
    try:
        left = np.linalg.inv(vectors)
    except np.linalg.LinAlgError:  # a vehicle without drag is a chain of integrators: too few eigenvectors
        left = np.linalg.pinv(vectors, rcond=1e-9)
    found = []
    for i, s in enumerate(values):
        if s.imag < 0.0:
            continue
        share = np.abs(vectors[:, i] * left[i])
        weights = dict(zip([names[k] for k in keep], share / share.sum(), strict=True))
        frequency = float(abs(s))
        damping = float(-s.real / frequency) if frequency else 1.0
        constant = float(-1.0 / s.real) if s.real else np.inf
        found.append(Mode(_mode_name(weights, bool(oscillates(s))), complex(s), frequency, damping, constant))
    return tuple(sorted(found, key=lambda m: -m.frequency))


def oscillates(eigenvalue: ArrayLike) -> BoolArray:
    """Return whether eigenvalues are of oscillations, beyond rounding."""
    return np.asarray(np.abs(np.imag(eigenvalue)) > REAL)


def tracked_modes(A: FloatArray, names: tuple[str, ...]) -> list[tuple[Mode, ComplexArray]]:
    """Return the modes of the first of matrices (B, n, n), lags left out, each with its eigenvalue or pair (B, 1 or 2) in all.

    The eigenvalues of each matrix are assigned to the nearest of the first; those of one that is not finite are NaN. There are
    no modes where the first is not finite.
    """
    from scipy.optimize import linear_sum_assignment

    keep = [i for i, n in enumerate(names) if n not in LinearModel.INTEGRATORS]
    matrices = A[:, keep][:, :, keep]
    values = np.full(matrices.shape[:2], np.nan, dtype=complex)
    finite = np.flatnonzero(np.isfinite(matrices).all(axis=(1, 2)))
    if not finite.size or finite[0] != 0:
        return []
    values[finite] = np.linalg.eigvals(matrices[finite])
    for i in finite:
        values[i] = values[i][linear_sum_assignment(np.abs(values[0][:, None] - values[i]))[1]]
    out = []
    for mode in (m for m in modes_of(A[0], names) if not m.name.endswith(".lag")):
        s = mode.eigenvalue
        ends = [s, s.conjugate()] if oscillates(s) else [s]
        out.append((mode, values[:, [int(np.argmin(np.abs(values[0] - one))) for one in ends]]))
    return out


def _mode_name(weights: dict[str, float], oscillates: bool) -> str:
    """Name a mode by the participation of its states."""
    lags = [n for n in weights if n.endswith(".lag")]

    def share(*names: str) -> float:
        return sum(weights.get(n, 0.0) for n in names)

    # on rotors tilt drives speed, speed drives the rates (the hovering cubic of helicopters)
    if "w" in weights:
        motions = {"pitch": ("u", "q", "theta"), "roll": ("v", "p", "phi"), "yaw": ("r",), "heave": ("w",)}
        found = {name: share(*states) for name, states in (motions | {"lag": tuple(lags)}).items()}
        kind = max(found, key=lambda name: found[name])
        return f"{kind} and speed" if oscillates and kind in ("pitch", "roll") else kind
    lag = max(lags, key=lambda n: weights[n], default=None)
    if lag is not None and weights[lag] > 0.5:
        return lag
    if share("V", "alpha", "q", "theta") > 0.5:
        kind = "short period" if share("alpha", "q") > share("V", "theta") else "phugoid"
        return kind if oscillates else f"{kind} (aperiodic)"
    if oscillates:
        return "Dutch roll" if share("beta", "r") > share("p", "phi") else "lateral phugoid"
    return "roll" if share("p") > share("phi", "r", "beta") else "spiral"


def state_names(vehicle: Vehicle, start: Collection[str]) -> tuple[str, ...]:
    """Return the states of the linear model about a start that names V, or velocities along the body axes."""
    rigid = _MINIMAL[vehicle.reduce] if "V" in start else ("u", "v", "w", *_MINIMAL["full"][3:])
    return (*rigid, *(s for s in vehicle.states if s.endswith(".lag")))


def linear_models(
    vehicle: Vehicle, points: Trims
) -> tuple[tuple[str, ...], FloatArray, FloatArray, FloatArray, FloatArray]:
    """Return the names of the states, and A, B, C, D about B steady flights: (B, n_x, n_x), (B, n_x, m) and so on.

    Inputs are those of :meth:`Vehicle.model_inputs`. Flow angles have no meaning in a hover.
    """
    names = state_names(vehicle, points.start)
    inputs = points.inputs[: len(vehicle.inputs)]  # a lateral model lacks noise, zero, of its trim's gusts
    values = [*vehicle.initial_states(points.start, points.rows, inputs), *inputs]
    n, count = len(vehicle.states), len(values)
    variables = [Dual(x, e) for x, e in zip(values, np.eye(count)[:, :, None], strict=True)]
    equations = vehicle.array_equations()
    found = equations.values(variables[:n], variables[n:], equations.constants(points.rows))

    def minimal(states: Sequence[Any]) -> list[Any]:
        named: dict[str, Any] = dict.fromkeys(("v", "p", "r", "e1", "e3"), 0.0)
        named |= dict(zip(vehicle.states, states, strict=True))
        named |= dict(zip(EULER, euler_angles([named[e] for e in ("e0", "e1", "e2", "e3")]), strict=True))
        if "V" in points.start:
            named |= dict(zip(("V", "alpha", "beta"), flow_angles([named[a] for a in "uvw"]), strict=True))
        return [named[name] for name in names]

    def slopes(of: Iterable[Any]) -> FloatArray:
        """Return derivatives (lanes, rows, n_x + n_u)."""
        shape = (count, points.rows.shape[1])
        found = [np.broadcast_to(x.slope if isinstance(x, Dual) else 0.0, shape) for x in of]
        return np.array(found).transpose(2, 0, 1)

    moving = [Dual(x, f) for x, f in zip(variables[:n], found[:n], strict=True)]
    turned = (z.slope for z in minimal(moving))
    G, rates, outputs = (slopes(of) for of in (minimal(variables[:n]), turned, found[n:]))
    right = np.linalg.pinv(G[:, :, :n])
    mixing = vehicle.model_mixing(points.rows)
    A, C = (J[:, :, :n] @ right for J in (rates, outputs))
    B, D = (J[:, :, n:] @ mixing for J in (rates, outputs))
    return names, A, B, C, D


def pade(delay: float, order: int) -> System:
    """Return A, B, C, D of the Padé approximation of a delay, s: an all-pass of equal degrees above and below.

    exp(-sT) = P(-sT) / P(sT) with P(z) = sum of (2n - k)! n! / ((2n)! k! (n - k)!) z^k (Golub and Van Loan, *Matrix
    Computations*, 4th ed., section 9.3.1).
    """
    from scipy.signal import tf2ss

    n = order
    divisors = [factorial(2 * n) * factorial(k) * factorial(n - k) for k in range(n + 1)]
    weights = [factorial(2 * n - k) * factorial(n) / divisors[k] for k in range(n + 1)]
    below = np.array([w * delay**k for k, w in enumerate(weights)])
    above = below * (-1.0) ** np.arange(n + 1)
    A, B, C, D = tf2ss(above[::-1], below[::-1])
    return A, B, C, D


def series(first: System, then: System) -> System:
    """Return the system in which the outputs of the first are the inputs of the other; its states come after."""
    A1, B1, C1, D1 = first
    A2, B2, C2, D2 = then
    A = np.block([[A1, np.zeros((len(A1), len(A2)))], [B2 @ C1, A2]])
    return A, np.vstack([B1, B2 @ D1]), np.hstack([D2 @ C1, C2]), D2 @ D1


def side_by_side(delays: FloatArray, order: int) -> System:
    """Return the system of signals that do not act on each other, each late by its delay, s."""
    from scipy.linalg import block_diag

    through = np.zeros((0, 0)), np.zeros((0, 1)), np.zeros((1, 0)), np.ones((1, 1))
    parts = [pade(delay, order) if delay > 0.0 else through for delay in delays.tolist()]
    A, B, C, D = (np.asarray(block_diag(*matrices)) for matrices in zip(*parts, strict=True))
    return A, B, C, D


def with_delays(model: LinearModel, order: int | None) -> tuple[System, tuple[str, ...]]:
    """Return A, B, C, D of a model with its delays, and the names of the states.

    Raises
    ------
    SimulationError
        There are delays and no order is given, or one is negative.
    """
    system = model.A, model.B, model.C, model.D
    delays = [*model.input_delays.tolist(), *model.output_delays.tolist()]
    if not any(delays) or order == 0:
        return system, model.states
    if order is None or min(delays) < 0.0:
        raise SimulationError(
            f"the model has delays of up to {max(delays, key=abs):g} s: give pade=N, the order of their approximation, or "
            "pade=0 to leave them out"
        )
    system = series(side_by_side(model.input_delays, order), system)
    before = len(system[0]) - len(model.states)
    system = series(system, side_by_side(model.output_delays, order))
    after = len(system[0]) - before - len(model.states)
    names = [f"input_delay_{i}" for i in range(before)], [f"output_delay_{i}" for i in range(after)]
    return system, (*names[0], *model.states, *names[1])


def control_system(model: LinearModel, order: int | None = None) -> Any:
    """Return a ``control.StateSpace`` with the names of states, inputs and outputs.

    Raises
    ------
    StoopError
        python-control is not installed, or as of :func:`with_delays`.
    """
    try:
        import control
    except ModuleNotFoundError:
        raise StoopError(f"python-control: the package is not installed; {install('control')}") from None
    matrices, states = with_delays(model, order)
    # Names of python-control may not hold dots, of which it makes those of subsystems.
    signals = {"states": states, "inputs": model.inputs, "outputs": model.outputs}
    labels = {key: [name.replace(".", "_") for name in names] for key, names in signals.items()}
    return control.StateSpace(*matrices, remove_useless_states=False, **labels)
