"""`stoop linearize`: A, B, C, D and the modes about a steady straight flight."""

from __future__ import annotations

import argparse
import math
from collections.abc import Container, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from stoop.base.files import check_target, write_text_atomic
from stoop.cli.arguments import add_overwrite
from stoop.cli.page import Page, page, print_json, to_json
from stoop.cli.point import add_point_arguments, condition, trim_at, vehicle_at
from stoop.cli.tables import Column, blocks, fixed, numbers, words
from stoop.cli.trim import trim_document

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from stoop.simulation import LinearModel, Mode, Trim
    from stoop.vehicle import Vehicle

    FloatArray = NDArray[np.float64]

FORMAT = "stoop-linear-model/1"
STDOUT = Path("-")
_UNITS = {"h": "m", "u": "m/s", "v": "m/s", "w": "m/s"}
NOISE = 1e-12  #: of the largest entry: less than rounding errors leave


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of this verb."""
    add_point_arguments(parser)
    parser.add_argument("--reduce", choices=["longitudinal", "lateral"], help="keep these equations only")
    parser.add_argument(
        "--json", metavar="FILE", type=Path, help="write JSON (- prints it) instead of tables"
    )
    add_overwrite(parser)


def run(arguments: argparse.Namespace) -> int:
    """Linearize and print, or write."""
    from stoop.simulation import linearize
    from stoop.simulation.linearize import left_out

    target: Path | None = arguments.json
    if target is not None and target != STDOUT:
        check_target(target, arguments.overwrite)
    vehicle = vehicle_at(arguments)
    point = trim_at(vehicle, arguments)
    model = linearize(vehicle, point)
    if target is None:
        _print(page(), vehicle, model, condition(vehicle, point, arguments))
        page().bullets(left_out(vehicle))
    else:
        _write(target, linear_document(vehicle, point, model, arguments.climb_angle))
    return 0


def linear_document(vehicle: Vehicle, point: Trim, model: LinearModel, climb_angle: float) -> dict[str, Any]:
    """Return the linear model for JSON, SI and rad."""
    return {
        "format": FORMAT,
        "vehicle": vehicle.name,
        "file": vehicle.where,
        "reduce": vehicle.reduce,
        "trim": trim_document(vehicle, point, climb_angle),
        "states": model.states,
        "inputs": model.inputs,
        "outputs": model.outputs,
        **{name: getattr(model, name).tolist() for name in "ABCD"},
        "modes": [_mode_document(mode) for mode in model.modes],
    }


def _mode_document(mode: Mode) -> dict[str, Any]:
    return {
        "name": mode.name,
        "eigenvalue": {"real": mode.eigenvalue.real, "imag": mode.eigenvalue.imag},
        "frequency": mode.frequency,
        "damping": mode.damping,
        "time_constant": mode.time_constant,
    }


def _write(target: Path, document: dict[str, Any]) -> None:
    if target == STDOUT:
        print_json(document)
        return
    write_text_atomic(target, to_json(document) + "\n")
    page().line(f"wrote {target}: A, B, C, D, modes and trim (SI units, rad)")


def _print(out: Page, vehicle: Vehicle, model: LinearModel, where: str) -> None:
    out.line(vehicle.name)
    out.line(f"linear model about {where}")
    out.heading("Modes")
    out.table(_mode_columns(model.modes))
    out.heading("x' = A x + B u, y = C x + D u (SI units and rad, about the steady flight)")
    plain = frozenset(f"{rotor}.lag" for rotor in vehicle.rotors)
    out.line(f"x: {_with_units(model.states, plain)}")
    out.line(f"u: {_with_units(model.inputs, plain)}")
    out.line(f"y: {_with_units(model.outputs, plain)}")
    for name, rows, heads in (
        ("A", model.states, model.states),
        ("B", model.states, model.inputs),
        ("C", model.outputs, model.states),
        ("D", model.outputs, model.inputs),
    ):
        _print_matrix(out, name, rows, heads, getattr(model, name))


def _mode_columns(modes: Sequence[Mode]) -> list[Column]:
    return [
        words("", [mode.name for mode in modes]),
        fixed("rad/s", [mode.frequency for mode in modes], 4),
        fixed("damping", [mode.damping for mode in modes], 4),
        fixed("period s", [_period(mode) for mode in modes], 3),
        fixed("time constant s", [mode.time_constant for mode in modes], 3),
        words("amplitude", [_amplitude(mode) for mode in modes]),
    ]


def _period(mode: Mode) -> float:
    """Return the period of an oscillation, s; NaN for what does not oscillate."""
    return 2.0 * math.pi / mode.eigenvalue.imag if mode.eigenvalue.imag > 0.0 else math.nan


def _amplitude(mode: Mode) -> str:
    """Say how fast it dies away or grows."""
    if not math.isfinite(mode.time_constant):
        return "stays"
    time = math.log(2.0) * mode.time_constant
    return f"halves in {time:.2f} s" if time > 0.0 else f"doubles in {-time:.2f} s"


def _with_units(names: Sequence[str], plain: Container[str]) -> str:
    """Write names with their units; ``plain`` ones (what rotors lag behind with) as they are."""
    units = ["" if name in plain else _unit(name) for name in names]
    return ", ".join(f"{name} {unit}".rstrip() for name, unit in zip(names, units, strict=True))


def _unit(name: str) -> str:
    """Return the unit of a state, input or output; deflections and their lags are angles."""
    from stoop.cli.tables import shown_unit
    from stoop.flight import VARIABLES

    if name in _UNITS:
        return _UNITS[name]
    return shown_unit(VARIABLES[name].unit) if name in VARIABLES else "rad"


def _print_matrix(
    out: Page, name: str, rows: Sequence[str], heads: Sequence[str], matrix: FloatArray
) -> None:
    floor = NOISE * float(abs(matrix).max(initial=0.0))
    clean = [[x if abs(x) > floor else 0.0 for x in column] for column in matrix.T.tolist()]
    columns = [numbers(head, column) for head, column in zip(heads, clean, strict=True)]
    for block in blocks(words(name, rows), columns, out.width):
        out.line()
        out.table(block)
