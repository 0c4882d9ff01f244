"""Loops of an autopilot around linear models, opened at one actuator with the others closed.

With the commands u about the axes, the motion y = P u and the feedback u = -K y, the return difference is F = I + K P. Opened at
actuator i, the others closed, 1 + L_i = det F / det F_ii, where F_ii is F without row and column i. Poles of the closed loops
that grow are counted by the argument of det F (Nyquist).

References
----------
.. [1] S. Skogestad and I. Postlethwaite, Multivariable Feedback Control, 2nd ed., 2005, sections 4.9 and 8.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, cached_property
from typing import Final

import numpy as np

from stoop.extend.arrays import BoolArray, ComplexArray, FloatArray
from stoop_tune.control_laws.filters import PASS
from stoop_tune.control_laws.rate_law import AXES, RATE, SETPOINT, Frequencies, RateLaw

#: axis -> rate, and the attitude that its outer loop holds
MOTION: Final = {"roll": ("p", "phi"), "pitch": ("q", "theta"), "yaw": ("r", "")}
HEADING: Final = (
    "psi"  #: the integral of the yaw rate in hover, for a law of the heading that is more than a gain
)
SLOWEST: Final = 0.1  #: rad/s, from which loops are looked at; below act autothrottle and guidance
#: 1/s; what grows more slowly, such as the speed of an airplane without throttle, is of outer loops
GROWTH: Final = 0.05
POINTS: Final = 600
LANES: Final = 100  #: models at once, whose responses the caches of a processor hold; those of fewer are kept
CONDITION: Final = 1e10  #: of eigenvectors, above which a response is solved for frequency by frequency


#: what was computed on lines of frequencies, which are compared by identity: searches try the same ones over and over
Answers = list[tuple[Frequencies, dict[str, ComplexArray]]]


def _kept(
    known: Answers, frequency: Frequencies, compute: Callable[[Frequencies], dict[str, ComplexArray]]
) -> dict[str, ComplexArray]:
    """Return what is known on a line, or compute and keep it."""
    for line, found in known:
        if line is frequency:
            return found
    known.append((frequency, compute(frequency)))
    return known[-1][1]


def part_of(values: FloatArray | float, lanes: slice) -> FloatArray | float:
    """Return the values (d, 1) of some models, or what is that of all."""
    return values[lanes] if isinstance(values, np.ndarray) and len(values) > 1 else values


@dataclass(frozen=True, eq=False)
class AxisLoop:
    """The loops about an axis: law of the rate, and that of the attitude before it, or its gain, 1/s; zero opens it."""

    law: RateLaw
    attitude: RateLaw | float = 0.0
    #: ratio of trim airspeed to airspeed; (d, 1) where readings of d models differ
    scale: FloatArray | float = 1.0
    known: Answers = field(default_factory=list, init=False, repr=False, compare=False)  #: of `feedback`

    def part(self, lanes: slice) -> AxisLoop:
        """Return the loops around some of the models."""
        return self if np.size(self.scale) == 1 else replace(self, scale=part_of(self.scale, lanes))

    def feedback(self, frequency: Frequencies) -> dict[str, ComplexArray]:
        """Return minus the command over the rate and over the attitude, (m,) or (d, m), held over a sample of the loop."""
        return _kept(self.known, frequency, self._feedback)

    def _feedback(self, frequency: Frequencies) -> dict[str, ComplexArray]:
        out = {self.rate: self.law.feedback(frequency, self.scale) * self.hold(frequency)}
        if self.held != self.rate:
            inner = self.law.response(SETPOINT, frequency, self.scale) * self.hold(frequency)
            out[self.held] = self.back(frequency) * inner
        return out

    @property
    def rate(self) -> str:
        """Name of the rate."""
        return MOTION[self.law.axis][0]

    @property
    def held(self) -> str:
        """Name of what follows a setpoint: the attitude where it has a loop, else the rate."""
        rate, angle = MOTION[self.law.axis]
        if isinstance(self.attitude, RateLaw):
            return angle or HEADING
        return angle if angle and self.attitude else rate

    def back(self, frequency: Frequencies) -> ComplexArray | float:
        """Return minus the setpoint of the rate over the attitude (m,), 1/s; a gain is one number."""
        return self.attitude.feedback(frequency) if isinstance(self.attitude, RateLaw) else self.attitude

    def forward(self, frequency: Frequencies) -> ComplexArray:
        """Return the command over the setpoint of `held`, (m,) or (d, m), held over a sample of the loop."""
        inner = self.law.response(SETPOINT, frequency, self.scale) * self.hold(frequency)
        if isinstance(self.attitude, RateLaw):
            return np.asarray(self.attitude.response(SETPOINT, frequency) * inner)
        return inner if self.held == self.rate else self.attitude * inner

    def gyro(self, frequency: Frequencies) -> ComplexArray:
        """Return the rate behind the filters of the gyro, which logs hold, over its reading (m,)."""
        law = self.law
        sensed = law.sensing.get(RATE, PASS).response(np.exp(1j * frequency / (law.gyro_rate or law.rate)))
        return np.asarray(sensed * law.sensing_loop.response(np.exp(1j * frequency / law.rate)))

    def hold(self, frequency: Frequencies) -> ComplexArray:
        """Return the response (m,) of a command that is held over a sample of the loop."""
        half = 0.5 * frequency / self.law.rate
        return np.asarray(np.exp(-1j * half) * np.sinc(half / np.pi))


@dataclass(frozen=True, eq=False)
class Plants:
    """Linear models of d vehicles that differ in their numbers: x' = A x + B u, u the commands about the axes, delayed."""

    states: tuple[str, ...]  #: without position and heading
    A: FloatArray  #: (d, n, n)
    B: FloatArray  #: (d, n, n_u)
    delays: FloatArray  #: (d, n_u), s
    #: by rate, reading of its gyro over what turns (d,), which the law acts on; one where absent
    gyros: Mapping[str, FloatArray] = field(default_factory=dict)
    known: Answers = field(default_factory=list, init=False, repr=False)  #: of :func:`motion`
    #: of the vehicles, with their modes
    parts: dict[tuple[int, int], Plants] = field(default_factory=dict, init=False, repr=False)

    @classmethod
    def joint(cls, parts: Sequence[Plants]) -> Plants:
        """Return the vehicles of some plants of the same states, one after the other."""
        gyros = {n: np.concatenate([one.gyros[n] for one in parts]) for n in parts[0].gyros}
        A, B, delays = (np.concatenate([getattr(one, n) for one in parts]) for n in ("A", "B", "delays"))
        return cls(parts[0].states, A, B, delays, gyros)

    def part(self, lanes: slice) -> Plants:
        """Return some of the vehicles."""
        begin, end, _ = lanes.indices(len(self.A))
        if end - begin == len(self.A):
            return self
        if (begin, end) not in self.parts:
            gyros = {n: x[lanes] for n, x in self.gyros.items()}
            self.parts[begin, end] = Plants(
                self.states, self.A[lanes], self.B[lanes], self.delays[lanes], gyros
            )
        return self.parts[begin, end]

    @cached_property
    def modes(self) -> tuple[ComplexArray, ComplexArray]:
        """Eigenvalues (d, n) and eigenvectors (d, n, n) of A."""
        values, vectors = np.linalg.eig(self.A)
        return np.asarray(values, dtype=complex), np.asarray(vectors, dtype=complex)

    @cached_property
    def sound(self) -> bool:
        """Whether the eigenvectors are far enough apart for responses as sums over modes."""
        return bool(np.max(np.linalg.cond(self.modes[1])) < CONDITION)


def frequencies(loops: Sequence[AxisLoop], every: int = 1) -> FloatArray:
    """Return evenly spaced frequencies (m,), rad/s, up to half the rate of the slowest loop, or every so many of them."""
    return _line(min(one.law.rate for one in loops), every)


@cache
def _line(rate: float, every: int) -> FloatArray:
    """Return frequencies up to half the rate of a loop, Hz."""
    return np.geomspace(SLOWEST, np.pi * rate, POINTS)[::every]


@cache
def _right_of_axis(rate: float) -> ComplexArray:
    """Return the line right of which poles are counted, up to half the rate of a loop, Hz."""
    return np.asarray(np.geomspace(1e-3 * GROWTH, np.pi * rate, POINTS) - 1j * GROWTH, dtype=np.complex128)


def motion(plants: Plants, frequency: Frequencies) -> dict[str, ComplexArray]:
    """Return the responses (d, n_u, m) of rates, as gyros read them, and attitude angles to commands about the axes."""
    if len(plants.A) < LANES:
        return _kept(plants.known, frequency, lambda line: _motion(plants, line))
    return _motion(plants, frequency)


def _motion(plants: Plants, frequency: Frequencies) -> dict[str, ComplexArray]:
    names = plants.states
    wanted = [n for axis in AXES for n in MOTION[axis] if n in names]
    rows = [names.index(n) for n in wanted]
    values, vectors = plants.modes
    s = 1j * frequency
    count, _, inputs = plants.B.shape
    found = np.empty((count, len(rows), inputs, len(s)), dtype=complex)
    delays, group = np.unique(plants.delays, axis=1, return_inverse=True)
    # (d, m), most often one for all inputs
    late = [np.exp(-s * delays[:, [k]]) for k in range(delays.shape[1])]
    read = np.stack([np.broadcast_to(plants.gyros.get(n, 1.0), count) for n in wanted], axis=1)  # d, y
    if plants.sound:
        into = np.linalg.solve(vectors, plants.B.astype(complex))
        outof = read[:, :, None] * vectors[:, rows]
        for k, own in enumerate(late):
            of = np.flatnonzero(group.ravel() == k)
            weights = outof[:, :, None] * into.swapaxes(1, 2)[:, None, of]  # d, y, u, n
            gains = own[:, None] / (s - values[:, :, None])
            flat = weights.reshape(count, -1, len(names)) @ gains
            found[:, :, of] = flat.reshape(count, len(rows), len(of), len(s))
    else:
        matrices = s[:, None, None] * np.eye(len(names)) - plants.A[:, None]
        solved = np.linalg.solve(matrices, plants.B[:, None].astype(complex))[:, :, rows]
        found[:] = np.moveaxis(read[:, None, :, None] * solved, 1, 3)
        found *= np.stack(late, axis=1)[:, None, group.ravel()]
    turning = {n: found[:, i] for i, n in enumerate(wanted)}
    if "r" in turning:  # the heading is no integral of what the gyro reads
        turning[HEADING] = turning["r"] * (1.0 / (s * read[:, wanted.index("r"), None, None]))
    return turning


def return_difference(
    moves: Mapping[str, ComplexArray], loops: Sequence[AxisLoop], frequency: Frequencies
) -> ComplexArray:
    """Return F = I + K P (d, n, n, m); the inputs of `moves` are those of the loops, in their order."""
    rows = [
        sum((k[..., None, :] * moves[n] for n, k in loop.feedback(frequency).items()), np.zeros(1))
        for loop in loops
    ]
    return np.asarray(np.eye(len(loops))[:, :, None] + np.stack(rows, axis=1))


def opened(difference: ComplexArray) -> ComplexArray:
    """Return L (n, d, m) at each actuator, the others closed."""
    whole, n = _determinant(difference), difference.shape[1]
    out = []
    for i in range(n):
        others = [k for k in range(n) if k != i]
        out.append(whole / _determinant(difference[:, others][:, :, others]) - 1.0)
    return np.array(out)


def followed(
    moves: Mapping[str, ComplexArray], loops: Sequence[AxisLoop], frequency: Frequencies
) -> ComplexArray:
    """Return the response (n, d, m) of what each loop holds to its setpoint, all loops closed.

    That of y to the command i is the i-th column of P F^-1, by Cramer's rule: det F with P_y for row i, over det F.
    """
    difference = return_difference(moves, loops, frequency)
    whole, out = _determinant(difference), []
    for i, loop in enumerate(loops):
        replaced = difference.copy()
        replaced[:, i] = moves[loop.held]
        out.append(loop.forward(frequency) * _determinant(replaced) / whole)
    return np.array(out)


def _determinant(matrices: ComplexArray) -> ComplexArray:
    """Return the determinants (d, m) of small matrices (d, n, n, m), by expansion along the first row."""
    n = matrices.shape[1]
    if n == 0:
        return np.ones((1, 1), dtype=complex)
    if n == 1:
        return matrices[:, 0, 0]
    columns = [[k for k in range(n) if k != i] for i in range(n)]
    minors = [_determinant(matrices[:, 1:][:, :, kept]) for kept in columns]
    return np.asarray(sum((-1) ** i * matrices[:, 0, i] * minors[i] for i in range(n)))


def stable(plants: Plants, loops: Sequence[AxisLoop]) -> BoolArray:
    """Return which closed loops (d,) have no pole that grows faster than `GROWTH`.

    Along Re s = `GROWTH` the argument of det F turns by pi for every pole right of it that the loops remove or add.
    """
    frequency = _right_of_axis(min(one.law.rate for one in loops))
    whole = _determinant(return_difference(motion(plants, frequency), loops, frequency))
    angle = np.unwrap(np.angle(whole), axis=1)
    # on the real axis F is real, and far up it is one
    turned = angle[:, -1] - np.angle(whole[:, -1]) - np.pi * np.round(angle[:, 0] / np.pi)
    growing = np.sum(plants.modes[0].real > GROWTH, axis=1)
    return np.asarray(growing == np.round(turned / np.pi))
