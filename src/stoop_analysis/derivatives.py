"""Stability and control derivatives of a vehicle about a steady flight: forces and moments by velocities, rates and controls.

With F the forces (X, Y, Z) and moments (L, M, N) without gravity, about the center of gravity and along body axes, and
v = (u, v, w, p, q, r), the equations of motion give

    (X, Y, Z) = m (V' + omega x V - g),   (L, M, N) = I omega' + omega x I omega,

whose derivatives dF/dv and dF/d(control) are exact (dual numbers). Stability axes are body axes turned about y by the angle
of attack of the steady flight: with T = diag(R, R), dF/dv becomes T dF/dv T', and I becomes R I R'.

Three forms are given: dimensional (dX/du, N s/m; Etkin and Reid, sections 4.2 and 4.9), divided by mass or by the moment of
inertia about the axis of the moment (Xu, 1/s, as in McRuer, Ashkenas and Graham, section 4.3; Nelson, table 3.5), and
nondimensional. Of these C_i = F_i / (rho V^2 S l_i / 2) with l_i = 1, b or c, by u/V0, v/V0, w/V0, p b/2V0, q c/2V0, r b/2V0
and controls in rad (Etkin and Reid, section 4.10, tables 4.1 and 4.4), so that in stability axes

    C_Xu = Xu / (rho V0 S / 2) - 2 C_X0,   C_Zw = C_Z by alpha = -(C_Lalpha + C_D),   C_Yv = C_Y by beta.

Loads have no derivatives by accelerations (w', v') here: the equations have none.

References
----------
B. Etkin and L. D. Reid, *Dynamics of Flight: Stability and Control*, 3rd ed., Wiley, 1996.
D. McRuer, I. Ashkenas, D. Graham, *Aircraft Dynamics and Automatic Control*, Princeton University Press, 1973.
R. C. Nelson, *Flight Stability and Automatic Control*, 2nd ed., McGraw-Hill, 1998.
B. L. Stevens, F. L. Lewis, E. N. Johnson, *Aircraft Control and Simulation*, 3rd ed., Wiley, 2016, section 2.3 (axes), 2.6.
V. Klein and E. A. Morelli, *Aircraft System Identification*, AIAA, 2006, section 3.6.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final

import numpy as np

from stoop import Vehicle
from stoop.extend import motion
from stoop.extend.arrays import BoolArray, Dual, FloatArray
from stoop.extend.errors import SimulationError
from stoop.extend.text import without_rounding
from stoop.extend.variables import VARIABLES

LOADS: Final = ("X", "Y", "Z", "L", "M", "N")
MOTIONS: Final = ("u", "v", "w", "p", "q", "r")
AXES: Final = ("body", "stability")
FORMS: Final = ("dimensional", "specific", "nondimensional")
NEGLIGIBLE: Final = 1e-7  #: of the largest sensitivity to a parameter; smaller ones are rounding
_COEFFICIENTS: Final = ("CX", "CY", "CZ", "Cl", "Cm", "Cn")


@dataclass(frozen=True, eq=False)
class ParameterCovariance:
    """Covariance (k, k) of the named parameters, SI; the variance of one that the data do not determine is infinite or NaN."""

    names: tuple[str, ...] = ()
    covariance: FloatArray = field(default_factory=lambda: np.zeros((0, 0)))

    @property
    def not_identified(self) -> tuple[str, ...]:
        """Names of parameters that the data do not determine."""
        return tuple(
            n for n, s in zip(self.names, np.diag(self.covariance), strict=True) if not np.isfinite(s)
        )


@dataclass(frozen=True, eq=False)
class Derivatives:
    """Derivatives of forces and moments about a steady flight, with what they depend on.

    Attributes
    ----------
    axes : str
        Of :data:`AXES`.
    alpha : float, rad
        Angle of attack of the steady flight: from the body's x axis to the stability axes'.
    controls : mapping of str to str
        Deflections and channels of thrust or rotors, with their units.
    velocity : (3,) array, m/s
        Of the steady flight through the air, along the axes.
    reference : mapping of str to float
        ``density``, kg/m3, ``area``, m2, ``span`` and ``chord``, m; empty for a vehicle without wings.
    values : (n,) array
        Mass, kg; inertia tensor (9), kg m2; steady loads (6), N and N m; derivatives (6, 6 + n_controls), SI.
    sensitivity : (n, k) array
        Of the values to the parameters.
    known : ParameterCovariance
        Of these parameters.
    """

    axes: str
    alpha: float
    controls: dict[str, str]
    velocity: FloatArray
    reference: dict[str, float]
    values: FloatArray
    sensitivity: FloatArray
    known: ParameterCovariance

    @property
    def matrix(self) -> FloatArray:
        """Derivatives (6, 6 + n_controls) of X, Y, Z, L, M, N by u, v, w, p, q, r and controls, SI."""
        return self.values[16:].reshape(6, -1)

    @property
    def loads(self) -> FloatArray:
        """Steady forces and moments (6,) without gravity, N and N m."""
        return without_rounding(self.values[10:16], abs(self.values[10:16]).max())

    def along(self, axes: str) -> Derivatives:
        """Return the derivatives along other axes; values, and by the same Jacobian their sensitivities, are transformed."""
        if axes == self.axes:
            return self
        angle = self.alpha if axes == "stability" else -self.alpha
        c, s = math.cos(angle), math.sin(angle)
        R = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
        T = np.kron(np.eye(2), R)
        columns = np.eye(6 + len(self.controls))
        columns[:6, :6] = T
        blocks = (np.eye(1), np.kron(R, R), T, np.kron(T, columns))
        J = np.zeros((len(self.values),) * 2)
        at = 0
        for block in blocks:
            J[at : at + len(block), at : at + len(block)] = block
            at += len(block)
        values, sensitivity = J @ self.values, J @ self.sensitivity
        return replace(self, axes=axes, velocity=R @ self.velocity, values=values, sensitivity=sensitivity)

    def table(self, form: str = "nondimensional") -> Table:
        """Return the derivatives in one of :data:`FORMS`, with standard errors and covariance.

        Raises
        ------
        SimulationError
            Nondimensional derivatives of a vehicle that has no wings or does not move through the air.
        """
        J = _JACOBIANS[form](self)
        values = J[:, 10:] @ self.values[10:]  # linear in loads and derivatives; mass and inertia divide
        rows = values.reshape(len(LOADS), -1)
        values = without_rounding(rows, abs(rows).max(axis=1, keepdims=True)).ravel()
        return Table(self.axes, form, *_names_and_units(self, form), values, J @ self.sensitivity, self.known)


@dataclass(frozen=True, eq=False)
class Table:
    """Derivatives in one form along one set of axes.

    Attributes
    ----------
    axes, form : str
    names, units : tuple of str
        Such as ``X_u``, ``N s/m``; ``CX_u``, ``1``.
    values : (n,) array
    sensitivity : (n, k) array
        To the parameters.
    known : ParameterCovariance
        Of the parameters.
    """

    axes: str
    form: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    values: FloatArray
    sensitivity: FloatArray
    known: ParameterCovariance

    @property
    def identified(self) -> BoolArray:
        """Which (n,) depend only on parameters that are known or that the data determine."""
        lost = self.sensitivity[:, ~_certain(self.known)]
        floor = NEGLIGIBLE * np.max(np.abs(self.sensitivity), axis=0, initial=0.0)[~_certain(self.known)]
        return np.asarray(~np.any(np.abs(lost) > floor, axis=1))

    @property
    def covariance(self) -> FloatArray:
        """Covariance (n, n) to first order, J S J'; infinite variances and NaN covariances where not identified."""
        certain = _certain(self.known)
        J = self.sensitivity[:, certain]
        out = J @ self.known.covariance[np.ix_(certain, certain)] @ J.T
        lost = ~self.identified
        out[lost] = np.nan
        out[:, lost] = np.nan
        out[lost, lost] = np.inf
        return np.asarray(out)

    @property
    def std_errors(self) -> FloatArray:
        """Standard errors (n,); infinite where not identified, NaN where no covariance is known."""
        if not self.known.names:
            return np.full(len(self.values), np.nan)
        return np.asarray(np.sqrt(np.maximum(np.diag(self.covariance), 0.0)))


def _certain(known: ParameterCovariance) -> BoolArray:
    return np.isfinite(np.diag(known.covariance))


def derivatives(
    vehicle: Vehicle, point: motion.Trim, known: ParameterCovariance | None = None
) -> Derivatives:
    """Return the derivatives of a vehicle about a steady flight, along body axes.

    Parameters
    ----------
    vehicle : Vehicle
        With the full equations.
    point : Trim
        As of :func:`stoop.trim`.
    known : ParameterCovariance, optional
        Of the vehicle's parameters. The steady flight is held: its own dependence on them is no part of the errors.

    Returns
    -------
    Derivatives

    Raises
    ------
    SimulationError
        A reduced vehicle.
    """
    if vehicle.reduce != "full" or vehicle.motion:
        raise SimulationError(f"{vehicle.where}: derivatives need the full equations; remove the reduction")
    known = ParameterCovariance() if known is None else known
    states = vehicle.initial_states(point.start, vehicle.parameter_rows(point.changes), point.inputs)[:, 0]
    velocity = np.array([states[vehicle.states.index(n)] for n in "uvw"])
    values = _values(vehicle, point, states)
    columns = []
    variances = np.diag(known.covariance).tolist()
    for name, variance in zip(known.names, variances, strict=True):
        # As for the standard errors of a linear model: 1e-3 standard errors, or 1e-4 of the value of an unknown one.
        value = vehicle.value(name)
        step = (
            1e-3 * math.sqrt(variance)
            if math.isfinite(variance) and variance > 0.0
            else 1e-4 * (abs(value) or 1.0)
        )
        up, down = (
            _values(vehicle.with_numbers({name: {"value": value + s}}), point, states) for s in (step, -step)
        )
        columns.append((up - down) / (2.0 * step))
    sensitivity = np.stack(columns, axis=1) if columns else np.zeros((len(values), 0))
    reference = {}
    if vehicle.file.reference is not None:
        reference = {n: vehicle.value(f"reference.{n}") for n in ("area", "span", "chord")}
        reference["density"] = point.density(vehicle)
    alpha = math.atan2(velocity[2], velocity[0]) if float(velocity @ velocity) > 0.0 else 0.0
    units = {n: "rad" if n in vehicle.controls else VARIABLES[n].unit for n in vehicle.model_inputs()}
    controls = {n: "unit" if u == "1" else u for n, u in units.items()}
    return Derivatives("body", alpha, controls, velocity, reference, values, sensitivity, known)


def _values(vehicle: Vehicle, point: motion.Trim, states: FloatArray) -> FloatArray:
    """Return what `Derivatives.values` holds, at given states (n_x,)."""
    rows = vehicle.parameter_rows(point.changes)
    seeds = _seeds(vehicle, rows, point.inputs)
    n = len(states)
    both = [Dual(x, s) for x, s in zip([*states, *point.inputs], seeds, strict=True)]
    equations = vehicle.array_equations()
    rates = equations.values(both[:n], both[n:], equations.constants(rows[:, 0]))[:n]
    at = {name: i for i, name in enumerate(vehicle.states)}
    V, omega = ([both[at[a]] for a in axes] for axes in ("uvw", "pqr"))
    V_rate, omega_rate = ([rates[at[a]] for a in axes] for axes in ("uvw", "pqr"))
    mass = vehicle.value("mass.mass")
    inertia = vehicle.inertia_tensor().tolist()
    e0, e1, e2, e3 = (float(states[at[f"e{i}"]]) for i in range(4))
    down = (2.0 * (e1 * e3 - e0 * e2), 2.0 * (e2 * e3 + e0 * e1), e0**2 - e1**2 - e2**2 + e3**2)
    gravity = vehicle.value("environment.gravity")
    turned = _cross(omega, V)
    forces = [mass * (a + b - gravity * d) for a, b, d in zip(V_rate, turned, down, strict=True)]
    momentum = [_dot(row, omega) for row in inertia]
    moments = [_dot(row, omega_rate) + b for row, b in zip(inertia, _cross(omega, momentum), strict=True)]
    loads = [*forces, *moments]
    slopes = [np.asarray(f.slope, dtype=float) + np.zeros(seeds.shape[1]) for f in loads]
    return np.concatenate([[mass], np.ravel(inertia), [float(f.value) for f in loads], *slopes])


def _dot(a: Sequence[Any], b: Sequence[Any]) -> Any:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Sequence[Any], b: Sequence[Any]) -> list[Any]:
    return [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]


def _seeds(vehicle: Vehicle, rows: FloatArray, inputs: FloatArray) -> FloatArray:
    """Return how states and inputs (n_x + n_u, 6 + n_controls) move with each motion and control, lags settled."""
    controls, mixing = vehicle.model_inputs(), vehicle.model_mixing(vehicle.parameter_rows())[0]
    n = len(vehicle.states)
    out = np.zeros((n + len(inputs), 6 + len(controls)))
    for j, state in enumerate(MOTIONS):
        out[vehicle.states.index(state), j] = 1.0
    out[n : n + len(mixing), 6:] = mixing
    for state in vehicle.states:
        if state.endswith(".lag"):
            own = state.removesuffix(".lag")
            step = 1e-3 * mixing
            moved = [
                float(
                    (vehicle.commanded(own, rows, inputs + s) - vehicle.commanded(own, rows, inputs - s))[0]
                )
                for s in step.T
            ]
            out[vehicle.states.index(state), 6:] = np.array(moved) / 2e-3
    return out


def _dimensional(d: Derivatives) -> FloatArray:
    return np.eye(len(d.values))[16:]


def _specific(d: Derivatives) -> FloatArray:
    """Return the Jacobian of derivatives over mass or moment of inertia, at the values."""
    J, width = _dimensional(d), d.matrix.shape[1]
    divisors = np.repeat([d.values[0]] * 3 + [d.values[1 + 4 * i] for i in range(3)], width)
    places = np.repeat([0] * 3 + [1 + 4 * i for i in range(3)], width)
    out = J / divisors[:, None]
    out[np.arange(len(out)), places] -= d.matrix.ravel() / divisors**2
    return np.asarray(out)


def _nondimensional(d: Derivatives) -> FloatArray:
    """Return the Jacobian of nondimensional derivatives, which are linear in loads and derivatives."""
    speed = float(np.linalg.norm(d.velocity))
    if not d.reference or speed == 0.0:
        raise SimulationError(
            "nondimensional derivatives need wings and an airspeed; give --airspeed, or ask for --dimensional"
        )
    span, chord = d.reference["span"], d.reference["chord"]
    force = 0.5 * d.reference["density"] * speed**2 * d.reference["area"]
    arms = np.array([1.0, 1.0, 1.0, span, chord, span])
    scales = np.concatenate([[speed] * 3, 2.0 * speed / arms[3:], np.ones(len(d.controls))])
    J = _dimensional(d)
    along = np.concatenate([d.velocity / speed, np.zeros(len(scales) - 3)])
    for i in range(6):
        for j in range(len(scales)):
            row = J[i * len(scales) + j]
            row[10 + i] = -2.0 * along[j] / speed  # the dynamic pressure grows with the speed
            row *= scales[j] / (force * arms[i])
    return J


_JACOBIANS: Final = {"dimensional": _dimensional, "specific": _specific, "nondimensional": _nondimensional}


def _names_and_units(d: Derivatives, form: str) -> tuple[tuple[str, ...], tuple[str, ...]]:
    motions = MOTIONS
    if form == "nondimensional" and d.axes == "stability":
        motions = ("u", "beta", "alpha", "p", "q", "r")
    loads = _COEFFICIENTS if form == "nondimensional" else LOADS
    names = tuple(f"{load}_{by}" for load in loads for by in (*motions, *d.controls))
    if form == "nondimensional":
        return names, ("1",) * len(names)
    kinds = [("N", "N m"), ("m/s2", "1/s2")][form == "specific"]
    by = ["m/s"] * 3 + ["rad/s"] * 3 + [*d.controls.values()]
    simple = {"m/s2/(m/s)": "1/s", "m/s2/(rad/s)": "m/s", "1/s2/(m/s)": "1/(m s)", "1/s2/(rad/s)": "1/s"}
    written = [f"{kinds[i > 2]}/({u})" if "/" in u else f"{kinds[i > 2]}/{u}" for i in range(6) for u in by]
    return names, tuple(simple.get(u, u) for u in written)
