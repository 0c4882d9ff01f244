"""The equations of a vehicle as LaTeX, printed from the SymPy expressions that are compiled; i counts the rotors.

Sums over rotors and cross products are written as vectors; their terms are printed.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import sympy as sp

from stoop.vehicle import terms
from stoop.vehicle.notation import BODY_DRAG, EACH_ROTOR, SURFACES, coefficient_symbol, plain, symbols
from stoop.vehicle.symbolic import forces
from stoop.vehicle.symbolic.frames import Numbers, scale
from stoop.vehicle.vehicle import Vehicle

X, AXIAL, INPLANE, DRAWN, DENSITY_RATIO = sp.symbols(
    r"x_{i} v_{n\,i} v_{h\,i} v_{d\,i} \frac{\rho}{\rho_{0}}", real=True
)
COMMAND, VOLTAGE, DENSITY = sp.symbols(r"u_{i} U \rho", real=True)


def equations(vehicle: Vehicle) -> tuple[str, ...]:
    """Return one equation per coefficient of the kept equations, then those of rotors and body drag."""
    numbers = Numbers(vehicle)
    names = {numbers[name]: latex for name, latex in symbols(vehicle).items()}
    given = {r: sum(f"rotor.{r}.{part}" in numbers for part in EACH_ROTOR) for r in vehicle.rotors}
    fullest = max(given, key=given.__getitem__, default=None)
    rotors = _rotors(numbers, names, fullest) if fullest else ()
    return (*_aerodynamics(numbers, names), *rotors, *_body_drag(numbers, names))


def _aerodynamics(n: Numbers, names: dict[Any, str]) -> Iterator[str]:
    """Yield C = sum of terms, eq. (1), in the order of the file."""
    if n.vehicle.file.reference is None:
        return
    speed = "V" if n.vehicle.actual_rates else "V_*"
    flow = {
        "alpha": r"\Delta\alpha", "beta": r"\beta", "p": rf"\frac{{p b}}{{2{speed}}}",
        "q": rf"\frac{{q \bar c}}{{2{speed}}}", "r": rf"\frac{{r b}}{{2{speed}}}", "V": r"\frac{V-V_*}{V_*}",
    }  # fmt: skip
    surfaces = {c: SURFACES.get(c) or r"\delta_{\mathrm{" + plain(c) + "}}" for c in n.vehicle.file.controls}
    known = {name: sp.Symbol(f"term {name}", real=True) for name in (*flow, *surfaces)}
    names = names | {known[name]: latex for name, latex in (flow | surfaces).items()}
    for coefficient, group in n.vehicle.terms.items():
        printed = [
            sp.latex(n[name], symbol_names=names)
            if (factor := sp.sympify(terms.convert(terms.parse(text, known, name), known))) == 1
            else f"{sp.latex(n[name], symbol_names=names)} {_factor(factor, names)}"
            for name, text in group.items()
        ]
        total = " + ".join(printed) or "0"
        gain = forces.lift_gain(n, _height(n)) if coefficient == "CL" else 1
        if gain != 1:
            total = rf"\left({total}\right) \left({sp.latex(gain, symbol_names=names)}\right)"
        yield f"{coefficient_symbol(coefficient)} = {total}"


def _height(n: Numbers) -> dict[str, Any]:
    table = n.vehicle.file.ground_effect
    return {} if table is None else {table.channel: sp.Symbol("z", real=True)}


def _factor(expression: Any, names: dict[Any, str]) -> str:
    if expression.has(sp.Pow):
        names = {
            symbol: text if " " not in text and "\\" not in text[1:] else rf"\left({text}\right)"
            for symbol, text in names.items()
        }
    text = sp.latex(expression, symbol_names=names)
    return rf"\left({text}\right)" if expression.is_Add else text


def _rotors(n: Numbers, names: dict[Any, str], first: str) -> Iterator[str]:
    """Yield command, lag, thrust, in-plane force and torque of rotor i, and the sums over the rotors.

    Rotor `first` has all factors that any rotor has.
    """
    vehicle = n.vehicle
    each = {n[f"rotor.{first}.{p}"]: f"{s}_{{i}}" for p, s in EACH_ROTOR.items() if f"rotor.{first}.{p}" in n}
    names = names | each | {INPLANE: r"\left| v_{h,i} \right|"}

    def line(left: str, right: Any) -> str:
        return f"{left} = {sp.latex(right, symbol_names=names)}"

    channels = {rotor.channel: COMMAND for rotor in vehicle.file.rotor.values()} | {"voltage": VOLTAGE}
    commanded = forces.rotor_commands(n, channels)[first]
    if "rotors.lag" in n:
        yield line("x_{c,i}", commanded)
        yield line(r"\dot{x}_{i}", (sp.Symbol("x_{c,i}") - X) / n["rotors.lag"])
    else:
        yield line("x_{i}", commanded)
    through = AXIAL + (DRAWN if "rotors.radius" in n else 0)
    thrust, drag, torque = forces.blade_loads(n, first, X, through, INPLANE**2, DENSITY_RATIO)
    yield line("T_{i}", thrust * forces.thrust_gain(n, _height(n)))
    if "rotors.radius" in n:
        flow = sp.sqrt(INPLANE**2 + through**2)
        yield line("T_{i}", 2 * DENSITY * sp.pi * n["rotors.radius"] ** 2 * DRAWN * flow)
    if drag != 0:
        yield f"{line('H_{i}', -drag)} v_{{h,i}}"
    if torque != 0:
        yield line("Q_{i}", torque)
    yield r"F = \sum_{i} \left( T_{i}\, n_{i} + H_{i} \right) + F_{\mathrm{body}}"
    reaction = r" - s_{i} J \left( \dot{x}_{i}\, n_{i} + \omega \times x_{i}\, n_{i} \right)"
    yield (
        r"M = \sum_{i} \left( r_{i} \times \left( T_{i}\, n_{i} + H_{i} \right) - s_{i} Q_{i}\, n_{i}"
        + (reaction if "rotors.inertia" in n else "")
        + r" \right) + M_{\mathrm{body}}"
    )


def _body_drag(n: Numbers, names: dict[Any, str]) -> Iterator[str]:
    """Yield force and moment along body axis k."""
    present = [part for part in BODY_DRAG if f"body_drag.{part}.x" in n]
    names = names | {n[f"body_drag.{part}.x"]: f"{BODY_DRAG[part]}_{{k}}" for part in present}
    speed, rate = sp.symbols(r"v_{k} \omega_{k}", real=True)
    load = forces.body_resistance(n, scale(speed, (1, 1, 1)), scale(rate, (1, 1, 1)))
    for name, value in (("F", load.force[0]), ("M", load.moment[0])):
        if value != 0:
            yield rf"{name}_{{\mathrm{{body}},k}} = {sp.latex(value, symbol_names=names)}"
