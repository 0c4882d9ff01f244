"""The equations of rotors and of the body's drag as LaTeX, for the report; i counts the rotors."""

from __future__ import annotations

import re

from stoop.vehicle.vehicle import Vehicle

_SHARED = {
    "T0": "T_{0}", "T1": "T_{1}", "T2": "T_{2}", "inflow": r"k_{v}", "translational": r"k_{h}", "drag": r"k_{d}",
    "drag_inflow": r"k_{n}", "radius": "R",
    "Q0": "Q_{0}", "Q1": "Q_{1}", "Q2": "Q_{2}", "torque_ratio": r"c_{Q}", "inertia": "J", "lag": r"\tau", "gain": "g",
    "idle": r"u_{\mathrm{idle}}", "nominal_voltage": r"U_{0}", "delay": r"t_{d}",
}  # fmt: skip
_BODY = {"linear": "d", "quadratic": "D", "rotation": "c"}


def rotor_symbols(vehicle: Vehicle) -> dict[str, str]:
    """Return the LaTeX symbol of each number of the rotors and of the body's drag that the file has."""
    found = {name: _symbol(name) for name in vehicle.rows}
    return {name: symbol for name, symbol in found.items() if symbol is not None}


def _symbol(name: str) -> str | None:
    room, _, rest = name.partition(".")
    first, _, last = rest.partition(".")
    if room == "rotors":
        return _SHARED.get(first)
    if room == "body_drag":
        return f"{_BODY[first]}_{{{last}}}"
    if room != "rotor":
        return None
    rotor = r"\mathrm{" + re.sub(r"[^A-Za-z0-9]", " ", first) + "}"
    part, _, axis = last.partition(".")
    letter = {"factor": "f", "torque_factor": "f_Q", "position": axis, "axis": f"n_{axis}"}[part]
    return f"{{{letter}}}_{{{rotor}}}"


def rotor_equations(vehicle: Vehicle) -> tuple[str, ...]:
    """Return command, lag, thrust, in-plane force, torque and the sums, with the terms that the file has."""
    if not vehicle.hovers:
        return ()
    present = {name.removeprefix("rotors.") for name in vehicle.rows if name.startswith("rotors.")}
    out = [_command(present)]
    if "lag" in present:
        out.append(r"\dot{x}_{i} = \frac{x_{c,i} - x_{i}}{\tau}")
    out += [
        _thrust(vehicle, present),
        _momentum(present),
        _inplane(vehicle, present),
        _torque(vehicle, present),
    ]
    out += [r"F = \sum_{i} \left( T_{i}\, n_{i} + H_{i} \right) + F_{\mathrm{body}}", _moment(present)]
    return (*(line for line in out if line), *_body(vehicle))


def _command(present: set[str]) -> str:
    head = "x_{c,i}" if "lag" in present else "x_{i}"
    volts = r"\frac{U}{U_{0}}" if "nominal_voltage" in present else ""
    return rf"{head} = \max\left( g \left( u_{{i}} - u_{{\mathrm{{idle}}}} \right), 0 \right) {volts}"


def _polynomial(letter: str, present: set[str]) -> list[str]:
    factors = ("", r"\,x_{i}", r"\,x_{i}^{2}")
    return [f"{letter}_{{{k}}}{factor}" for k, factor in enumerate(factors) if f"{letter}{k}" in present]


def _factors(vehicle: Vehicle, *kinds: str) -> str:
    have = [k for k in kinds if any(f"rotor.{r}.{k}" in vehicle.rows for r in vehicle.rotors)]
    letters = "".join({"factor": "f_{i}", "torque_factor": "f_{Q,i}"}[k] + r"\," for k in have)
    return letters + r"\frac{\rho}{\rho_{0}}"


def _thrust(vehicle: Vehicle, present: set[str]) -> str:
    inside = " + ".join(_polynomial("T", present))
    inside += rf" - k_{{v}}\,x_{{i}}\,{_through(present)}" if "inflow" in present else ""
    inside += r" + k_{h} \left| v_{h,i} \right|^{2}" if "translational" in present else ""
    return rf"T_{{i}} = {_factors(vehicle, 'factor')} \left( {inside} \right)"


def _inplane(vehicle: Vehicle, present: set[str]) -> str:
    terms = [r"k_{d}\, x_{i}"] if "drag" in present else []
    terms += [r"k_{n}\, " + _through(present)] if "drag_inflow" in present else []
    if not terms:
        return ""
    inside = terms[0] if len(terms) == 1 else r"\left( " + " + ".join(terms) + r" \right)"
    return rf"H_{{i}} = -{_factors(vehicle, 'factor')}\, {inside}\, v_{{h,i}}"


def _through(present: set[str]) -> str:
    return r"\left( v_{n,i} + v_{d,i} \right)" if "radius" in present else "v_{n,i}"


def _momentum(present: set[str]) -> str:
    if "radius" not in present:
        return ""
    flow = r"\sqrt{\left| v_{h,i} \right|^{2} + \left( v_{n,i} + v_{d,i} \right)^{2}}"
    return rf"T_{{i}} = 2 \rho \pi R^{{2}}\, v_{{d,i}}\, {flow}"


def _torque(vehicle: Vehicle, present: set[str]) -> str:
    if "torque_ratio" in present:
        ahead = r"f_{Q,i}\," if "f_{Q,i}" in _factors(vehicle, "torque_factor") else ""
        return rf"Q_{{i}} = {ahead}c_{{Q}}\, T_{{i}}"
    inside = " + ".join(_polynomial("Q", present))
    return (
        rf"Q_{{i}} = {_factors(vehicle, 'factor', 'torque_factor')} \left( {inside} \right)" if inside else ""
    )


def _moment(present: set[str]) -> str:
    reaction = (
        r" - s_{i} J \left( \dot{x}_{i}\, n_{i} + \omega \times x_{i}\, n_{i} \right)"
        if "inertia" in present
        else ""
    )
    return (
        r"M = \sum_{i} \left( r_{i} \times \left( T_{i}\, n_{i} + H_{i} \right) - s_{i} Q_{i}\, n_{i}"
        rf"{reaction} \right) + M_{{\mathrm{{body}}}}"
    )


def _body(vehicle: Vehicle) -> tuple[str, ...]:
    have = [part for part in _BODY if f"body_drag.{part}.x" in vehicle.rows]
    forces = {"linear": "d_{k}\\,v_{k}", "quadratic": r"D_{k} \left| v_{k} \right| v_{k}"}
    inside = " + ".join(forces[part] for part in have if part in forces)
    lines = [rf"F_{{\mathrm{{body}},k}} = -\left( {inside} \right)"] if inside else []
    return (*lines, *([r"M_{\mathrm{body},k} = -c_{k}\,\omega_{k}"] if "rotation" in have else []))
