"""Eq. (1) of the PS-GDE paper: the 32 terms of the default aerodynamic model.

Bounds are wide: they hold conventional aeroplanes from a hand-launched model to a light aircraft. The
paper prints the coefficient of roll rate in the side force as ``C_Qw``; the symmetric reading is ``CQp``.
"""

from __future__ import annotations

from typing import Final

COEFFICIENTS: Final = ("CL", "CD", "CQ", "Cl", "Cm", "Cn")

EQUATION_1: Final[dict[str, dict[str, tuple[str, float, float]]]] = {
    "CD": {
        "CD0": ("1", 0.0, 0.5),
        "CDalpha": ("alpha", -1.0, 3.0),
        "CDalpha2": ("alpha^2", -2.0, 8.0),
        "CDV": ("V", -0.5, 0.5),
    },
    "CL": {
        "CL0": ("1", -1.0, 2.0),
        "CLalpha": ("alpha", 0.5, 10.0),
        "CLq": ("q", -20.0, 60.0),
        "CLV": ("V", -2.0, 2.0),
        "CLelevator": ("elevator", -2.0, 3.0),
    },
    "Cm": {
        "Cm0": ("1", -1.0, 1.0),
        "Cmalpha": ("alpha", -8.0, 2.0),
        "Cmq": ("q", -150.0, 0.0),
        "CmV": ("V", -1.0, 1.0),
        "Cmelevator": ("elevator", -5.0, 5.0),
    },
    "CQ": {
        "CQ0": ("1", -0.2, 0.2),
        "CQbeta": ("beta", -3.0, 1.0),
        "CQp": ("p", -2.0, 2.0),
        "CQr": ("r", -2.0, 3.0),
        "CQrudder": ("rudder", -1.0, 1.0),
        "CQV": ("V", -0.5, 0.5),
    },
    "Cl": {
        "Cl0": ("1", -0.1, 0.1),
        "Clbeta": ("beta", -0.6, 0.4),
        "Clp": ("p", -2.5, 0.0),
        "Clr": ("r", -1.0, 1.5),
        "Claileron": ("aileron", -1.0, 1.0),
        "Clrudder": ("rudder", -0.3, 0.3),
    },
    "Cn": {
        "Cn0": ("1", -0.1, 0.1),
        "Cnbeta": ("beta", -0.4, 0.6),
        "Cnp": ("p", -0.8, 0.6),
        "Cnr": ("r", -1.5, 0.3),
        "Cnaileron": ("aileron", -0.3, 0.3),
        "Cnrudder": ("rudder", -0.6, 0.6),
    },
}  #: coefficient -> parameter -> (term, lower bound, upper bound)


def default_bounds(name: str, value: float) -> tuple[float, float]:
    """Return where to look for an aerodynamic parameter whose file gives no bounds."""
    for terms in EQUATION_1.values():
        if name in terms:
            _, low, high = terms[name]
            return min(low, value - abs(value)), max(high, value + abs(value))
    reach = max(1.0, 5.0 * abs(value))
    return -reach, reach
