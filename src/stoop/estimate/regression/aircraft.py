"""Equations of aircraft: nondimensional coefficients from measured accelerations, linear in the aerodynamic terms.

Specific force and angular acceleration of the compiled vehicle are linear in the coefficients. What a unit of each
coefficient adds to them, and what they are without any, is found by evaluating the equations; solving at every sample
gives the history of the coefficients (Klein and Morelli, section 5.1, where the equations are solved by hand).

Rates are differentiated by a cubic spline through every sample, which smooths nothing: a filter would delay or flatten
one side of the equation. The derivative is exact to (omega dt)^4 / 180. The domain smooths both sides alike.

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification: Theory and Practice*, 2nd ed., Sunflyte, 2016.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Final

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from stoop.base.arrays import BoolArray, FloatArray, IntArray, runs
from stoop.base.variables import RATES, SPECIFIC_FORCE
from stoop.estimate.regression.least_squares import Equations, Rows
from stoop.flight.flight import MIN_SEGMENT
from stoop.problem import Layout, Piece
from stoop.problem.observation import at_center_of_gravity, true_value
from stoop.simulation import START_NAMES, parameter_rows
from stoop.simulation.delays import first_order_lag, late_inputs
from stoop.simulation.initial import commanded, initial_states, rigid_states
from stoop.vehicle import Vehicle, terms
from stoop.vehicle.schema import Term

COEFFICIENTS: Final = {
    "full": ("CL", "CD", "CQ", "Cl", "Cm", "Cn"), "longitudinal": ("CL", "CD", "Cm"), "lateral": ("CQ", "Cl", "Cn"),
}  #: estimated, by the vehicle's reduction; as many as there are accelerations  # fmt: skip
NOT_NEEDED: Final = ("psi",)  #: no force depends on it
MIN_SAMPLES: Final = 8  #: of a stretch


@dataclass(frozen=True, eq=False)
class Motion:
    """The n complete samples of one piece, with bias, scale and position of the instruments removed; SI."""

    samples: IntArray  #: their indices in the piece (n,)
    states: Mapping[str, FloatArray]  #: ``V`` ... ``psi``, ``h`` -> (n,), at the center of gravity
    readings: Mapping[str, FloatArray]  #: ``ax``, ``ay``, ``az`` -> (n,), m/s2, as read
    inputs: FloatArray  #: (n_u, n), as the surfaces receive them
    deflections: Mapping[str, FloatArray]  #: control -> (n,), rad; lags applied
    rows: FloatArray  #: kernel parameters (n_p, n): the file's values and the maneuver's loading

    @classmethod
    def of(cls, vehicle: Vehicle, piece: Piece) -> Motion:
        """Return the motion of a piece; delays and lags are those of the vehicle file."""
        samples = np.flatnonzero(complete(vehicle, piece))
        rows = parameter_rows(vehicle, piece.changes, len(samples))
        late, deflections = late_inputs(vehicle, piece.inputs, rows[:, :1], piece.dt), {}
        for c in vehicle.controls:
            angle = commanded(vehicle, c, np.repeat(rows[:, :1], len(late), axis=1), late.T)
            if vehicle.file.controls[c].lag is not None:
                angle = first_order_lag(angle, float(rows[vehicle.rows[f"controls.{c}.lag"], 0]), piece.dt)
            deflections[c] = angle[samples]
        readings = {c: piece.measured[samples, i] for i, c in enumerate(vehicle.outputs)}
        states = states_of(vehicle, piece.start, readings)
        felt = {c: v for c, v in readings.items() if c in SPECIFIC_FORCE}
        out = cls(samples, states, felt, np.ascontiguousarray(late[samples].T), deflections, rows)
        rates, _ = vehicle.kernel().evaluate(rows, out.kernel_states(vehicle), out.inputs)
        climb, start = rates[vehicle.states.index("h")], states["h"][:1]  # in steady air
        height = np.concatenate([start, start + cumulative_trapezoid(climb, piece.time[samples])])
        return replace(out, states={**states, "h": height})

    def kernel_states(self, vehicle: Vehicle) -> FloatArray:
        """Return the kernel's states (n_x, n)."""
        out = initial_states(vehicle, {}, self.rows, self.inputs, rigid_states(self.states))
        for i, name in enumerate(vehicle.states):
            if name.endswith(".lag"):
                out[i] = self.deflections[name.removesuffix(".lag")]
        return out

    def variables(self, vehicle: Vehicle) -> dict[str, FloatArray]:
        """Return the variables of aerodynamic terms -> (n,)."""
        s, rates = self.states, (self.states["p"], self.states["q"], self.states["r"])

        def number(name: str) -> FloatArray:
            return np.asarray(self.rows[vehicle.rows[name]])

        values = terms.values(number, vehicle.actual_rates, s["V"], s["alpha"], s["beta"], rates)
        return {**values, **self.deflections}


def complete(vehicle: Vehicle, piece: Piece) -> BoolArray:
    """Return the samples (n,) at which every quantity of the equations was measured."""
    needed = [i for i, c in enumerate(vehicle.outputs) if c not in NOT_NEEDED]
    return np.asarray(np.isfinite(piece.measured[:, needed]).all(axis=1))


def states_of(
    vehicle: Vehicle, start: Mapping[str, Any], readings: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return the states at the center of gravity; those that a reduced model does not observe stay at the start."""
    count = len(next(iter(readings.values())))
    out = {n: np.full(count, float(start.get(n, 0.0))) for n in START_NAMES}
    out |= {n: np.zeros(count) for n in {"beta", "p", "q", "r", "phi", "psi"} - set(vehicle.outputs)}
    out |= {c: np.nan_to_num(true_value(vehicle, c, v)) for c, v in readings.items() if c in START_NAMES}
    return at_center_of_gravity(vehicle, out)


@dataclass(frozen=True, eq=False)
class History:
    """Coefficients of one stretch of a maneuver without a hole, n samples."""

    maneuver: int
    time: FloatArray  #: (n,), s, the log's own clock
    dt: float  #: s
    coefficients: Mapping[str, FloatArray]  #: ``CL`` ... -> (n,)
    #: of terms (:data:`stoop.vehicle.terms.STATE_VARIABLES`, controls) -> (n,)
    variables: Mapping[str, FloatArray]

    def regressor(self, term: str) -> FloatArray:
        """Return the values (n,) of a term."""
        return _term_values(term, self.variables, len(self.time))


def _term_values(term: str, variables: Mapping[str, FloatArray], count: int) -> FloatArray:
    return np.full(count, terms.convert(_parsed(term, frozenset(variables)), variables), dtype=float)


@lru_cache(maxsize=1000)
def _parsed(term: str, names: frozenset[str]) -> Any:
    return terms.parse(term, names, "term")


def histories(vehicle: Vehicle, piece: Piece) -> tuple[History, ...]:
    """Return the coefficient histories of every complete stretch of a piece that is long enough."""
    present = complete(vehicle, piece)
    if not present.any():
        return ()
    motion = Motion.of(vehicle, piece)
    base, gains = balance(vehicle, motion)
    variables = motion.variables(vehicle)
    shortest = max(MIN_SAMPLES, round(0.5 * MIN_SEGMENT / piece.dt))
    position = np.cumsum(present) - 1
    out = []
    for start, stop in runs(present):
        if stop - start < shortest:
            continue
        s = slice(position[start], position[stop - 1] + 1)
        time = piece.time[motion.samples[s]]
        rates = [motion.states[c][s] for c in RATES if c in vehicle.outputs]
        angular = np.array([CubicSpline(time, rate)(time, 1) for rate in rates])
        felt = {c: v[s] for c, v in motion.readings.items()}
        found = coefficients(vehicle, base[:, s], gains[:, :, s], angular, felt)
        out.append(History(piece.maneuver, time, piece.dt, found, {n: v[s] for n, v in variables.items()}))
    return tuple(out)


def coefficients(
    vehicle: Vehicle, base: FloatArray, gains: FloatArray, angular: FloatArray, felt: Mapping[str, FloatArray]
) -> dict[str, FloatArray]:
    """Return the coefficients that explain measured accelerations.

    `base` (a, n) and `gains` (a, c, n) are those of :func:`balance`, `angular` (r, n), rad/s2, the angular accelerations about
    the axes that the vehicle observes, `felt` the readings ``ax``, ``ay``, ``az`` -> (n,), m/s2.
    """
    wanted = np.concatenate([angular, [felt[c] for c in SPECIFIC_FORCE if c in vehicle.outputs]]) - base
    solved = np.linalg.solve(gains.transpose(2, 0, 1), wanted.T[:, :, None])[:, :, 0]
    return dict(zip(COEFFICIENTS[vehicle.reduce], solved.T, strict=True))


def balance(vehicle: Vehicle, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Return the accelerations (a, n) without aerodynamics, and what a unit of each coefficient adds (a, c, n)."""
    estimated = COEFFICIENTS[vehicle.reduce]
    constants, probed = _constants(vehicle), vehicle
    if len(constants) < len(estimated):  # a vehicle whose coefficients are constants, and nothing else
        only = {c: {f"{c}0": Term(term="1")} for c in estimated}
        aerodynamics = vehicle.file.aerodynamics.model_copy(update=only)
        probed = replace(vehicle, file=vehicle.file.model_copy(update={"aerodynamics": aerodynamics}))
        constants = _constants(probed)
    count, lanes = len(motion.samples), 1 + len(constants)
    rows = np.repeat(probed.values[:, None], count, axis=1)
    for p in probed.parameters:
        if p.name in vehicle.rows:
            rows[probed.rows[p.name]] = motion.rows[vehicle.rows[p.name]]
    rows[[probed.rows[n] for c in estimated for n in getattr(probed.file.aerodynamics, c)]] = 0.0
    inputs = np.zeros((1, count))
    if probed.inputs != ("none",):
        inputs = np.ascontiguousarray(motion.inputs[[vehicle.inputs.index(c) for c in probed.inputs]])
    x = replace(motion, rows=rows, inputs=inputs).kernel_states(probed)
    rows = np.tile(rows, lanes)  # the first n lanes without aerodynamics, then n with each coefficient at one
    for i, name in enumerate(constants, 1):
        rows[probed.rows[name], i * count : (i + 1) * count] = 1.0
    d, y = probed.kernel().evaluate(rows, np.tile(x, lanes), np.tile(inputs, lanes))
    angular = [probed.states.index(c) for c in RATES if c in probed.outputs]
    felt = [probed.outputs.index(c) for c in SPECIFIC_FORCE if c in probed.outputs]
    cases = np.concatenate([d[angular], y[felt]]).reshape(-1, lanes, count)
    return cases[:, 0], cases[:, 1:] - cases[:, :1]


def _constants(vehicle: Vehicle) -> list[str]:
    """Return a constant term, tied to nothing, of each coefficient that has one."""
    targets = [q.tie for c in COEFFICIENTS["full"] for q in getattr(vehicle.file.aerodynamics, c).values()]
    out = []
    for c in COEFFICIENTS[vehicle.reduce]:
        group: Mapping[str, Term] = getattr(vehicle.file.aerodynamics, c)
        alone = [n for n, t in group.items() if t.term.strip() == "1" and t.tie is None and n not in targets]
        out += alone[:1]
    return out


@dataclass(frozen=True, eq=False)
class AircraftEquations(Equations):
    """The coefficients of an aircraft as a linear regression on its free terms; other free numbers keep the file's values."""

    histories: tuple[History, ...]

    linear = True
    explanations: ClassVar[Mapping[str, str]] = {
        "time": "equation-error-aircraft",
        "frequency": "frequency-domain-aircraft",
    }
    needed = (
        "a term must be free, and airspeed, flow angles, rates, attitude and accelerations measured together for some "
        "seconds; use --method output-error"
    )

    @classmethod
    def not_estimable(cls, vehicle: Vehicle) -> tuple[str, ...]:
        """Return the free numbers that are neither terms nor biases."""
        free = [p.name for p in vehicle.parameters if p.free and "." in p.name]
        return tuple(name for name in free if not name.endswith(".bias"))

    @classmethod
    def of(cls, layout: Layout, pieces: Sequence[Piece]) -> AircraftEquations:
        """Return the equations of measured maneuvers."""
        if not any("." not in p.name for p in layout.parameters):
            return cls(layout, ())
        return cls(layout, tuple(h for piece in pieces for h in histories(layout.vehicle, piece)))

    @cached_property
    def places(self) -> tuple[int, ...]:
        """Where the k free terms stand among the free parameters."""
        return tuple(i for i, p in enumerate(self.layout.parameters) if "." not in p.name)

    @property
    def names(self) -> tuple[str, ...]:
        """The free terms (k,)."""
        return tuple(self.layout.parameters[i].name for i in self.places)

    def rows(self, values: FloatArray) -> list[Rows]:
        """Return the rows of every coefficient and stretch, at all samples; `values` do not matter."""
        names = COEFFICIENTS[self.layout.vehicle.reduce]
        return [
            Rows(name, y, X, h.dt)
            for h in self.histories
            for name, (y, X) in zip(names, self.regressors(h.coefficients, h.variables), strict=True)
        ]

    def regressors(
        self, found: Mapping[str, FloatArray], variables: Mapping[str, FloatArray]
    ) -> list[tuple[FloatArray, FloatArray]]:
        """Return response (n,) and regressors (n, k) of each coefficient; terms that are not free are subtracted."""
        vehicle = self.layout.vehicle
        column = {vehicle.rows[name]: k for k, name in enumerate(self.names)}
        out = []
        for coefficient in COEFFICIENTS[vehicle.reduce]:
            y = found[coefficient].copy()
            X = np.zeros((len(y), len(self.places)))
            for name, text in vehicle.terms[coefficient].items():
                row, values = vehicle.rows[name], _term_values(text, variables, len(y))
                if row in column:
                    X[:, column[row]] += values
                else:
                    y -= vehicle.values[row] * values
            out.append((y, X))
        return out

    @property
    def constants(self) -> dict[str, int]:
        """Which of the k parameters is the constant of which coefficient."""
        names = {name: k for k, name in enumerate(self.names)}
        every = ((c, n, t) for c, group in self.layout.vehicle.terms.items() for n, t in group.items())
        return {c: names[n] for c, n, t in every if n in names and t.strip() == "1"}
