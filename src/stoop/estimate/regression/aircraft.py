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

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from typing import Any, ClassVar, Final, Self

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from stoop.base.arrays import BoolArray, FloatArray, IntArray, runs
from stoop.base.variables import POSITION, RATES, SPECIFIC_FORCE
from stoop.estimate.regression.least_squares import Equations, Rows
from stoop.flight.flight import MIN_SEGMENT
from stoop.problem import Layout, Piece
from stoop.problem.observation import at_center_of_gravity, recorded_motion, true_values
from stoop.simulation import START_NAMES
from stoop.vehicle import Vehicle, terms
from stoop.vehicle.channels import rigid_states
from stoop.vehicle.delays import first_order_lag
from stoop.vehicle.schema import Term

NOT_NEEDED: Final = ("psi", *POSITION)  #: no force depends on them
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
        rows = vehicle.parameter_rows(piece.changes, len(samples))
        late, deflections = piece.received(vehicle, rows[:, :1]), {}
        for c in vehicle.controls:
            angle = vehicle.commanded(c, np.repeat(rows[:, :1], len(late), axis=1), late.T)
            if vehicle.file.controls[c].lag is not None:
                angle = first_order_lag(angle, float(rows[vehicle.rows[f"controls.{c}.lag"], 0]), piece.dt)
            deflections[c] = angle[samples]
        readings = {c: piece.whole[samples, i] for i, c in enumerate(vehicle.outputs)}
        states = states_of(vehicle, piece.start, readings, late[samples].T)
        felt = {c: v for c, v in readings.items() if c in SPECIFIC_FORCE}
        out = cls(samples, states, felt, np.ascontiguousarray(late[samples].T), deflections, rows)
        rates, _ = vehicle.kernel().evaluate(rows, out.kernel_states(vehicle), out.inputs)
        climb, start = rates[vehicle.states.index("h")], states["h"][:1]  # in steady air
        height = np.concatenate([start, start + cumulative_trapezoid(climb, piece.time[samples])])
        return replace(out, states={**states, "h": height})

    def kernel_states(self, vehicle: Vehicle) -> FloatArray:
        """Return the kernel's states (n_x, n)."""
        out = vehicle.initial_states({}, self.rows, self.inputs, rigid_states(self.states, vehicle))
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
    return np.asarray(np.isfinite(piece.whole[:, needed]).all(axis=1))


def states_of(
    vehicle: Vehicle, start: Mapping[str, Any], readings: Mapping[str, FloatArray], inputs: FloatArray
) -> dict[str, FloatArray]:
    """Return the states at the center of gravity.

    Those that a reduced model does not observe are in the inputs (n_u, n) where the record supplies them, else as at the start.
    """
    count = len(next(iter(readings.values())))
    out = {n: np.full(count, float(start.get(n, 0.0))) for n in START_NAMES}
    out |= {n: np.zeros(count) for n in {"beta", "p", "q", "r", "phi", "psi"} - set(vehicle.outputs)}
    read = {c: np.nan_to_num(v) for c, v in readings.items() if c in START_NAMES}
    out |= true_values(vehicle, read)
    if not vehicle.motion:
        return at_center_of_gravity(vehicle, out)
    moving = at_center_of_gravity(vehicle, out | recorded_motion(vehicle, inputs, out))
    return moving | recorded_motion(vehicle, inputs, moving)


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
        parsed = _parsed(term, frozenset(self.variables))
        return np.full(len(self.time), terms.convert(parsed, self.variables), dtype=float)

    @staticmethod
    def of(
        vehicle: Vehicle, piece: Piece, motion_of: Callable[[Vehicle, Piece], Motion] = Motion.of
    ) -> tuple[History, ...]:
        """Return the coefficient histories of every complete stretch of a piece that is long enough."""
        present = complete(vehicle, piece)
        if not present.any():
            return ()
        motion = motion_of(vehicle, piece)
        shortest, edges = max(MIN_SAMPLES, round(0.5 * MIN_SEGMENT / piece.dt)), np.cumsum([0, *present])
        stretches = [slice(edges[a], edges[b]) for a, b in runs(present) if b - a >= shortest]
        rates, time = [motion.states[c] for c in RATES if c in vehicle.outputs], piece.time[motion.samples]
        angular = np.full((len(rates), len(time)), np.nan)
        for s in stretches:
            angular[:, s] = [CubicSpline(time[s], rate[s])(time[s], 1) for rate in rates]
        found, variables = coefficients(vehicle, motion, angular), motion.variables(vehicle)
        each = [[{n: v[s] for n, v in columns.items()} for columns in (found, variables)] for s in stretches]
        pairs = zip(stretches, each, strict=True)
        return tuple(History(piece.maneuver, time[s], piece.dt, *own) for s, own in pairs)


@lru_cache(maxsize=1000)
def _parsed(term: str, names: frozenset[str]) -> Any:
    return terms.parse(term, names, "term")


def coefficients(vehicle: Vehicle, motion: Motion, angular: FloatArray) -> dict[str, FloatArray]:
    """Return the coefficients (n,) that explain measured accelerations.

    `angular` (r, n), rad/s2, are the angular accelerations about the axes that the vehicle observes.
    """
    base, gains = balance(vehicle, motion)
    felt = [motion.readings[c] for c in SPECIFIC_FORCE if c in vehicle.outputs]
    wanted = (np.concatenate([angular, felt]) - base).T
    gains, solved = gains.transpose(2, 0, 1), np.full_like(wanted, np.nan)
    # where the air has no pressure, no coefficient explains anything
    known = np.asarray(np.isfinite(wanted).all(axis=1) & np.isfinite(gains).all(axis=(1, 2)))
    known[known] = np.linalg.det(gains[known]) != 0.0
    solved[known] = np.linalg.solve(gains[known], wanted[known, :, None])[:, :, 0]
    return dict(zip(AircraftEquations.COEFFICIENTS[vehicle.reduce], solved.T, strict=True))


def balance(vehicle: Vehicle, motion: Motion) -> tuple[FloatArray, FloatArray]:
    """Return the accelerations (a, n) without aerodynamics, and what a unit of each coefficient adds (a, c, n)."""
    estimated = AircraftEquations.COEFFICIENTS[vehicle.reduce]
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
    there = {c: motion.inputs[i] for i, c in enumerate(vehicle.inputs)}
    inputs = np.array([there.get(c, np.zeros(count)) for c in probed.inputs])
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
    every = AircraftEquations.COEFFICIENTS["full"]
    targets = [q.tie for c in every for q in getattr(vehicle.file.aerodynamics, c).values()]
    out = []
    for c in AircraftEquations.COEFFICIENTS[vehicle.reduce]:
        group: Mapping[str, Term] = getattr(vehicle.file.aerodynamics, c)
        alone = [n for n, t in group.items() if t.term.strip() == "1" and t.tie is None and n not in targets]
        out += alone[:1]
    return out


@dataclass(frozen=True, eq=False)
class AircraftEquations(Equations):
    """The coefficients of an aircraft as a linear regression on its free terms; other free numbers keep the file's values."""

    #: estimated, by the vehicle's reduction; as many as there are accelerations
    COEFFICIENTS: ClassVar = {
        "full": ("CL", "CD", "CQ", "Cl", "Cm", "Cn"), "longitudinal": ("CL", "CD", "Cm"), "lateral": ("CQ", "Cl", "Cn"),
    }  # fmt: skip
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
    def of(cls, layout: Layout, pieces: Sequence[Piece]) -> Self:
        """Return the equations of measured maneuvers."""
        if not any("." not in p.name for p in layout.parameters):
            return cls(layout, ())
        return cls(layout, tuple(h for piece in pieces for h in History.of(layout.vehicle, piece)))

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
        return [row for history in self.histories for row in self.regressors(history)]

    def regressors(self, history: History) -> list[Rows]:
        """Return response and regressors of each coefficient of a stretch; terms that are not free are subtracted."""
        vehicle = self.layout.vehicle
        column = {vehicle.rows[name]: k for k, name in enumerate(self.names)}
        out = []
        for coefficient in AircraftEquations.COEFFICIENTS[vehicle.reduce]:
            y = history.coefficients[coefficient].copy()
            X = np.zeros((len(y), len(self.places)))
            for name, text in vehicle.terms[coefficient].items():
                row, values = vehicle.rows[name], history.regressor(text)
                if row in column:
                    X[:, column[row]] += values
                else:
                    y -= vehicle.values[row] * values
            out.append(Rows(coefficient, y, X, history.dt, history.maneuver))
        return out

    @property
    def constants(self) -> dict[str, int]:
        """Which of the k parameters is the constant of which coefficient."""
        names = {name: k for k, name in enumerate(self.names)}
        every = ((c, n, t) for c, group in self.layout.vehicle.terms.items() for n, t in group.items())
        return {c: names[n] for c, n, t in every if n in names and t.strip() == "1"}
