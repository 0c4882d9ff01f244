"""The equations of a vehicle as functions of arrays, without the compiler: for many points and few evaluations."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from types import ModuleType
from typing import Any

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

from stoop.base.arrays import FloatArray
from stoop.kernels.kernel import array_functions

Rows = Any  #: (n_p,) or (n_p, n), or a sequence of numbers and (n,)


@dataclass(frozen=True, eq=False)
class Equations:
    """What takes parameters, states and inputs to derivatives and readings.

    Shapes are (n_p,) or (n_p, n), (n_x, n), (n_u, n), (n_x, n), (n_y, n), as of :meth:`stoop.kernels.Kernel.evaluate`; each of
    the parameters may also be a number or (n,).
    """

    functions: ModuleType

    def constants(self, rows: Rows) -> Sequence[Any]:
        """Return what depends on the parameters alone; the arithmetic of Python's numbers is quicker."""
        plain = rows.tolist() if getattr(rows, "ndim", 0) == 1 else rows
        return self.functions.prepare(plain)  # type: ignore[no-any-return]

    def values(self, states: Any, inputs: Any, constants: Sequence[Any]) -> Sequence[Any]:
        """Return derivatives, then readings, of whatever NumPy's functions take."""
        forcing = self.functions.forcing(inputs, constants)
        return self.functions.observe(states, forcing, constants)  # type: ignore[no-any-return]

    def __call__(self, rows: Rows, states: FloatArray, inputs: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return derivatives and readings."""
        found = self.values(states, inputs, self.constants(rows))
        values = np.empty((len(found), *states.shape[1:]))
        for i, value in enumerate(found):
            values[i] = value
        return values[: len(states)], values[len(states) :]


def flow_angles(velocity: Sequence[Any]) -> Sequence[Any]:
    """Return airspeed, angle of attack and sideslip of the velocity along the body axes."""
    return _kinematics("flow_angles", velocity)


def euler_angles(quaternion: Sequence[Any]) -> Sequence[Any]:
    """Return roll, pitch and yaw of a quaternion."""
    return _kinematics("euler_angles", quaternion)


def _kinematics(name: str, states: Sequence[Any]) -> Sequence[Any]:
    from stoop.vehicle.vehicle import equations_version

    def build() -> Any:
        from stoop.vehicle import symbolic

        return getattr(symbolic, name)()

    return array_functions(f"{name} {equations_version()}", build).observe(states, (), ())  # type: ignore[no-any-return]


@dataclass(eq=False)
class _Tape:
    """Every operation of an evaluation with its value, so that a change repeats only what depends on it."""

    values: list[Any] = field(default_factory=list)
    #: place, ufunc, operands
    operations: list[tuple[int, Any, tuple[int, ...]]] = field(default_factory=list)

    def place(self, value: Any) -> int:
        """Return where an operand stands."""
        if isinstance(value, _Traced):
            return value.place
        self.values.append(value)
        return len(self.values) - 1

    def traced(self, values: Iterable[Any]) -> list[_Traced]:
        """Return operands of which every operation is kept."""
        return [_Traced(self, self.place(value)) for value in values]

    def repeated(self, fresh: dict[int, Any]) -> dict[int, Any]:
        """Return the values that are others when those at some places are, by place."""
        values = self.values
        for place, ufunc, operands in self.operations:
            if not fresh.keys().isdisjoint(operands):
                fresh[place] = ufunc(*[fresh[i] if i in fresh else values[i] for i in operands])
        return fresh


class _Traced(NDArrayOperatorsMixin):
    """A value on a tape; NumPy's functions of it are put there too."""

    def __init__(self, tape: _Tape, place: int) -> None:
        self.tape, self.place = tape, place

    def __array_ufunc__(self, ufunc: Any, method: str, *operands: Any) -> _Traced:
        tape = self.tape
        places = tuple(tape.place(x) for x in operands)
        place = tape.place(ufunc(*(tape.values[i] for i in places)))
        tape.operations.append((place, ufunc, places))
        return _Traced(tape, place)


class Evaluation:
    """An evaluation of equations at n points, of which changes cost only what they change."""

    def __init__(self, equations: Equations, rows: Rows, states: FloatArray, inputs: FloatArray) -> None:
        self.equations, self.inputs, self.count = equations, inputs, len(states)
        self.constants, self.tape = equations.constants(rows), _Tape()
        self.of_inputs, self.of_constants = self.tape.traced(inputs), self.tape.traced(self.constants)
        found = equations.values(self.tape.traced(states), self.of_inputs, self.of_constants)
        self.outputs = [self.tape.place(value) for value in found]

    def reading(self, index: int) -> FloatArray:
        """Return one reading (n,)."""
        value = self.tape.values[self.outputs[self.count + index]]
        return np.broadcast_to(value, self.inputs.shape[1:])

    def changes(self, rows: Rows, inputs: FloatArray) -> list[tuple[int, FloatArray]]:
        """Return what changes (n,) with other parameters and inputs, and which derivative or reading (counted on) it is."""
        pairs: list[Any] = [(self.of_inputs, self.inputs, inputs)] if inputs is not self.inputs else []
        pairs.append((self.of_constants, self.constants, self.equations.constants(rows)))
        fresh = self.tape.repeated(
            {
                place.place: new
                for places, old, others in pairs
                for place, x, new in zip(places, old, others, strict=True)
                if not (x == new if isinstance(x, float) else np.array_equal(x, new))
            }
        )
        values = self.tape.values
        return [(i, fresh[at] - values[at]) for i, at in enumerate(self.outputs) if at in fresh]
