"""Equation error of vehicles with rotors: what the equations say of measured accelerations, and the numbers in them.

The measured motion goes into the vehicle's own equations sample by sample, commands through the delay and lag of the
rotors, and angular accelerations and specific forces come out. They are linear in most coefficients of thrust, torque
and drag; arms, inertia, lag, delay, wind and factors make them mildly nonlinear. So the regression is solved a few
times, linearized about what the last one found (Gauss-Newton). Nothing is integrated, and no start is too far for it.

Axes: k = sample, i = acceleration (p', q', r', ax, ay, az), j = unknown, b = candidate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.interpolate import CubicSpline

from stoop.base.arrays import FloatArray
from stoop.estimate.regression.domain import Domain
from stoop.estimate.regression.least_squares import Block, Priors, Solved, solve
from stoop.estimate.regression.measured import FORCES, RATES
from stoop.flight.segments import SHORTEST, runs
from stoop.problem import Layout, Nuisance, Piece
from stoop.problem.observation import through_air
from stoop.simulate import parameter_rows
from stoop.simulate.delays import at_samples, lagged, late_inputs
from stoop.simulate.initial import commanded, kernel_states, rigid_states
from stoop.vehicle import Vehicle
from stoop.vehicle.schema import WIND

ROUNDS: Final = 8
STEP: Final = 1e-5  #: of a bound's width, or of a bias' scale
RESTED: Final = 1e-3  #: of the same, below which another round changes nothing
NAMES: Final = (
    "roll",
    "pitch",
    "yaw",
    "forward",
    "sideways",
    "vertical",
)  #: accelerations, in the order of i
MOMENTS: Final = NAMES[:3]
LEAST: Final = (
    0.25  #: of a moment, that recorded commands must explain; below, they teach only how noise attenuates
)
_SPUN: Final = tuple(f"rotors.{n}" for n in ("lag", "delay", "gain", "idle", "nominal_voltage"))
_MOTION: Final = (*WIND, *RATES, "phi", "theta", "psi")


@dataclass(frozen=True, eq=False)
class Unknowns:
    """What is estimated: free numbers, then the biases (wind among them) of every maneuver.

    Attributes
    ----------
    layout : Layout
    biases : tuple of Nuisance
    """

    layout: Layout
    biases: tuple[Nuisance, ...]

    @classmethod
    def of(cls, layout: Layout) -> Unknowns:
        """Take all biases of a layout."""
        return cls(layout, tuple(n for n in layout.nuisances if n.is_bias))

    @property
    def start(self) -> FloatArray:
        """The file's values (j,), SI."""
        return np.array([p.value for p in self.layout.parameters] + [n.center for n in self.biases])

    @property
    def scales(self) -> FloatArray:
        """What counts as much of each (j,), SI."""
        return np.concatenate([self.layout.width, [n.scale for n in self.biases]])

    @property
    def priors(self) -> Priors:
        """What is known before."""
        sigma = [p.prior or np.inf for p in self.layout.parameters] + [n.scale for n in self.biases]
        return Priors(self.start, np.array(sigma))

    def bounds(self, within: tuple[FloatArray, FloatArray]) -> tuple[FloatArray, FloatArray]:
        """Return the bounds of the free numbers, and none of the biases."""
        wide = np.full(len(self.biases), np.inf)
        return np.concatenate([within[0], -wide]), np.concatenate([within[1], wide])

    def rows(self, piece: Piece, values: FloatArray) -> FloatArray:
        """Return kernel parameters (n_p, 1) of a piece for values (j,)."""
        vehicle, d = self.layout.vehicle, self.layout.dimension
        out = parameter_rows(vehicle, piece.changes)
        out[self.layout.rows, 0] = values[:d]
        for bias, value in zip(self.biases, values[d:], strict=True):
            if bias.maneuver == piece.maneuver:
                out[vehicle.rows[bias.name], 0] = value
        return out


@dataclass(frozen=True, eq=False)
class Stretch:
    """Samples of a piece without a hole.

    Attributes
    ----------
    piece : Piece
    samples : slice
    measured : (n, i), rad/s2 and m/s2
    """

    piece: Piece
    samples: slice
    measured: FloatArray

    def foreseen(self, unknowns: Unknowns, values: FloatArray, seen: dict[bytes, FloatArray]) -> FloatArray:
        """Return what the equations say of the accelerations (n, i); `seen` holds spins that were worked out before."""
        vehicle = unknowns.layout.vehicle
        rows = unknowns.rows(self.piece, values)
        own = slice(None), self.samples
        late = at_samples(vehicle, late_inputs(vehicle, self.piece.inputs, rows, self.piece.dt))
        inputs = np.ascontiguousarray(late.T[own])
        every = np.repeat(rows, inputs.shape[1], axis=1)
        states = kernel_states(vehicle, rigid_states(self._motion(vehicle, rows[:, 0])), {}, every, inputs)
        for i, name in enumerate(vehicle.states):
            if name.endswith(".lag"):
                states[i] = spin(vehicle, self.piece, name.removesuffix(".lag"), rows, seen)[self.samples]
        rates, outputs = vehicle.kernel().evaluate(every, states, inputs)
        turning = rates[[vehicle.states.index(c) for c in RATES]].T
        felt = outputs[[vehicle.outputs.index(c) for c in FORCES]].T
        lever = np.cross(
            self.measured[:, :3] - turning, _arm(vehicle, rows[:, 0])
        )  # turning as it was, not as foreseen
        return np.concatenate([turning, felt + lever], axis=1)

    def _motion(self, vehicle: Vehicle, rows: FloatArray) -> dict[str, FloatArray]:
        """Return u ... psi and h, (n,) each: biases undone, relative to the wind."""
        out = {}
        for channel in _MOTION:
            reading = self.piece.measured[self.samples, vehicle.outputs.index(channel)]
            scale = f"sensors.{channel}.scale"
            factor = rows[vehicle.rows[scale]] if scale in vehicle.rows else 1.0
            out[channel] = (reading - rows[vehicle.rows[f"sensors.{channel}.bias"]]) / (factor or 1.0)
        sunk = cumulative_trapezoid(
            self.piece.measured[self.samples, vehicle.outputs.index("vd")], dx=self.piece.dt, initial=0
        )
        return through_air(out) | {"h": float(self.piece.start.get("h", 0.0)) - sunk}


def _arm(vehicle: Vehicle, rows: FloatArray) -> FloatArray:
    """Return where the accelerometers are (3,), from the center of gravity, m."""
    names = ("sensors.accelerometer_position", "mass.center_of_gravity")
    sensor, center = (
        [rows[vehicle.rows[f"{n}.{c}"]] if f"{n}.{c}" in vehicle.rows else 0.0 for c in "xyz"] for n in names
    )
    return np.subtract(sensor, center) if f"{names[0]}.x" in vehicle.rows else np.zeros(3)


def spin(
    vehicle: Vehicle, piece: Piece, name: str, rows: FloatArray, seen: dict[bytes, FloatArray]
) -> FloatArray:
    """Return the lagged x of a rotor, or deflection of a surface, along a whole piece (n,); as commanded without a lag."""
    prefix = "rotors" if name in vehicle.rotors else f"controls.{name}"
    made_of = _SPUN if name in vehicle.rotors else tuple(n for n in vehicle.rows if n.startswith(prefix))
    involved = [vehicle.rows[number] for number in made_of if number in vehicle.rows]
    key = b"".join((name.encode(), id(piece).to_bytes(8, "little"), rows[involved, 0].tobytes()))
    if key not in seen:
        late = late_inputs(vehicle, piece.inputs, rows, piece.dt)
        command = commanded(vehicle, name, np.repeat(rows, len(late), axis=1), late.T)
        lag = vehicle.rows.get(f"{prefix}.lag")
        seen[key] = command if lag is None else lagged(command, float(rows[lag, 0]), piece.dt)
    return seen[key]


def stretches(vehicle: Vehicle, piece: Piece) -> list[Stretch]:
    """Return the stretches of a piece in which the motion was measured whole, with its accelerations."""
    needed = [vehicle.outputs.index(c) for c in (*_MOTION, *FORCES)]
    there = np.asarray(np.isfinite(piece.measured[:, needed]).all(axis=1))
    least = max(8, round(SHORTEST / piece.dt))
    out = []
    for run in runs(there):
        if run.stop - run.start >= least:
            time = piece.time[run]
            rates = [piece.measured[run, vehicle.outputs.index(c)] for c in RATES]
            turning = [CubicSpline(time, rate)(time, 1) for rate in rates]
            felt = [piece.measured[run, vehicle.outputs.index(c)] for c in FORCES]
            out.append(Stretch(piece, run, np.array([*turning, *felt]).T))
    return out


def fitted(
    layout: Layout,
    pieces: Sequence[Piece],
    domain: Domain,
    within: tuple[FloatArray, FloatArray],
) -> tuple[Unknowns, Solved] | None:
    """Estimate all free numbers and biases; None where the motion was nowhere measured whole.

    Parameters
    ----------
    within : lower, upper (D,)
        Bounds of the free numbers.
    """
    unknowns = Unknowns.of(layout)
    found = [s for piece in pieces for s in stretches(layout.vehicle, piece)]
    solved = _rounds(unknowns, found, domain, within, NAMES)
    if solved is None:
        return None
    kept = [n for n in NAMES if n not in MOMENTS or solved.r2.get(n, 1.0) > LEAST]
    if len(kept) < len(NAMES):
        solved = _rounds(unknowns, found, domain, within, kept) or solved
    return unknowns, solved


def _rounds(
    unknowns: Unknowns,
    found: Sequence[Stretch],
    domain: Domain,
    within: tuple[FloatArray, FloatArray],
    kept: Sequence[str],
) -> Solved | None:
    """Solve until nothing moves, by some of the accelerations."""
    values, bounds, solved = unknowns.start, unknowns.bounds(within), None
    for _ in range(ROUNDS):
        blocks = [b for s in found for b in _blocks(unknowns, s, values, domain) if b.coefficient in kept]
        if not blocks:
            return None
        solved = solve(blocks, bounds, unknowns.priors, domain)
        before, values = values, solved.values
        if not np.isfinite(values).all():
            return None
        if np.max(np.abs(values - before) / unknowns.scales) < RESTED:
            break
    return solved and replace(solved, r2=_shares(unknowns, found, solved.values, domain, kept))


def _shares(
    unknowns: Unknowns, found: Sequence[Stretch], values: FloatArray, domain: Domain, kept: Sequence[str]
) -> dict[str, float]:
    """Return the share of each acceleration's motion, about its mean over all stretches, that the equations explain.

    The rows that are solved are no measure of it: they contain what the equations say where they are linearized.
    """
    off = [s.measured - s.foreseen(unknowns, values, {}) for s in found]
    left, seen = (
        np.concatenate([domain.rows(x, s.piece.dt) for s, x in zip(found, each, strict=True)])
        for each in (off, [s.measured for s in found])
    )
    about = np.sum((seen - seen.mean(axis=0)) ** 2, axis=0)
    share = 1.0 - np.sum(left**2, axis=0) / np.where(about > 0.0, about, np.nan)
    return {n: float(share[i]) for i, n in enumerate(NAMES) if n in kept}


def _blocks(unknowns: Unknowns, stretch: Stretch, values: FloatArray, domain: Domain) -> list[Block]:
    """Return the rows of each acceleration, linear about some values."""
    seen: dict[bytes, FloatArray] = {}
    there = stretch.foreseen(unknowns, values, seen)
    slopes = np.zeros((*there.shape, len(values)))
    d = unknowns.layout.dimension
    for j, step in enumerate(STEP * unknowns.scales):
        if j >= d and unknowns.biases[j - d].maneuver != stretch.piece.maneuver:
            continue
        moved = values.copy()
        moved[j] += step
        slopes[:, :, j] = (stretch.foreseen(unknowns, moved, seen) - there) / step
    wanted = stretch.measured - there + slopes @ values
    dt, out = stretch.piece.dt, []
    for i, name in enumerate(NAMES):
        both = domain.rows(np.column_stack([wanted[:, i], slopes[:, i]]), dt)
        if both.size:
            out.append(Block(name, both[:, 0], both[:, 1:], dt))
    return out
