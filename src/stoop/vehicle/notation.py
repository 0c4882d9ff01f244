"""LaTeX symbols of the numbers of a vehicle file; `vehicle.symbolic.latex` prints the equations."""

from __future__ import annotations

import re
from typing import Final

from stoop.vehicle.vehicle import Vehicle

GREEK: Final = ("alpha", "beta", "phi", "theta", "psi")
SURFACES: Final = {"elevator": r"\delta_e", "aileron": r"\delta_a", "rudder": r"\delta_r"}
BODY_DRAG: Final = {"linear": "d", "quadratic": "D", "rotation": "c"}
EACH_ROTOR: Final = {"factor": "f", "torque_factor": "f_Q"}
_ROTORS: Final = {
    "T0": "T_{0}", "T1": "T_{1}", "T2": "T_{2}", "inflow": "k_{v}", "translational": "k_{h}", "drag": "k_{d}",
    "drag_inflow": "k_{n}", "radius": "R",
    "Q0": "Q_{0}", "Q1": "Q_{1}", "Q2": "Q_{2}", "torque_ratio": "c_{Q}", "inertia": "J", "lag": r"\tau", "gain": "g",
    "idle": r"u_{\mathrm{idle}}", "nominal_voltage": "U_{0}", "delay": "t_{d}",
}  # fmt: skip
_BODY: Final = {
    "mass.mass": "m", **{f"mass.inertia.{axes}": f"I_{{\\mathrm{{{axes}}}}}" for axes in ("xx", "yy", "zz", "xz", "xy", "yz")},
    "reference.area": "S", "reference.chord": r"\bar{c}", "reference.span": "b", "reference.airspeed": r"V_{\ast}",
    "reference.alpha": r"\alpha_{\ast}",
}  # fmt: skip
_GROUND_EFFECT: Final = {"rotor": "k_{g}", "lift": r"k_{\ell}", "radius": "R"}


def symbols(vehicle: Vehicle) -> dict[str, str]:
    """Return the LaTeX symbol of every aerodynamic parameter, and of mass, reference values, rotors and body drag."""
    found = {name: symbol for name, symbol in _BODY.items() if name in vehicle.rows}
    found |= {name: parameter_symbol(name, c) for c, group in vehicle.terms.items() for name in group}
    for name in vehicle.rows:
        table, _, rest = name.partition(".")
        first, _, last = rest.partition(".")
        if table == "rotors" and first in _ROTORS:
            found[name] = _ROTORS[first]
        elif table == "ground_effect":
            found[name] = _GROUND_EFFECT[first]
        elif table == "body_drag":
            found[name] = f"{BODY_DRAG[first]}_{{{last}}}"
        elif table == "rotor":
            part, _, axis = last.partition(".")
            letter = EACH_ROTOR.get(part) or {"position": axis, "axis": f"n_{axis}"}[part]
            found[name] = f"{{{letter}}}_{{" + r"\mathrm{" + plain(first) + "}}"
    return found


def coefficient_symbol(coefficient: str) -> str:
    """Return e.g. ``C_{L}`` or ``C_{l}``."""
    return f"C_{{{coefficient[1:]}}}"


def parameter_symbol(name: str, coefficient: str | None = None) -> str:
    r"""Return the LaTeX of a parameter's name, e.g. ``C_{L\alpha}`` for CLalpha."""
    if coefficient is None or not name.startswith(coefficient):
        return r"\mathrm{" + plain(name) + "}"
    known = "|".join((*GREEK, *SURFACES))
    tail = ""
    for part in re.split(f"({known}|[0-9]+)", name[len(coefficient) :]):
        if part in SURFACES:
            tail += f" {SURFACES[part]}"
        elif part in GREEK:
            tail += f" \\{part}"
        elif part.isdigit():
            tail += part if part == "0" else f"^{{{part}}}"
        elif part:
            tail += f" {plain(part)}"
    return f"C_{{{coefficient[1:]}{tail}}}"


def plain(text: str) -> str:
    """Return a name that LaTeX prints as it is."""
    return re.sub(r"[^A-Za-z0-9.]", " ", text)
