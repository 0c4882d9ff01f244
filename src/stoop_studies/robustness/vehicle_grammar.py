"""Grammar of vehicle files, written from docs/vehicle-file.md."""

from __future__ import annotations

import math
from typing import Final

from stoop_studies.robustness.document_trees import Branch, Node
from stoop_studies.robustness.log_grammars import Draw
from stoop_studies.robustness.node_makers import (
    Maker,
    either,
    flag,
    leaf,
    named,
    number,
    point,
    quantity,
    row,
    several,
    table,
    text,
)

TERMS: Final = (
    "alpha",
    "beta",
    "alpha^2",
    "alpha*elevator",
    "abs(beta)",
    "q",
    "V",
    "1",
    "0.5*p - r",
    "alpha/2",
)
TERMS_BAD: Final = (
    "alpha^7",
    "alpha^alpha",
    "1/0",
    "1/(alpha-alpha)",
    "(((((alpha^6)^6)^6)^6)^6)",
    "alpha**2**2",
    "1e999",
    "__import__('os')",
    "alpha if 1 else 2",
    "(" * 190,
    "-" * 190 + "1",
    "+".join(["alpha"] * 33),
    "*".join(["alpha"] * 33),
    "abs(abs(abs(alpha)))",
    "9" * 199,
    "9^6",
    "((9^6)^2)*9e200",
    "alpha" * 39,
    "abs",
    "abs()",
    "abs(1,2)",
    "lambda: 0",
    "α",
    "0x1f",
    "1_0",
    "1j",
    "True",
    "alpha @ beta",
    "~alpha",
    "alpha\n",
    "\x00",
    "1/alpha^6",
    "1e-320/1e10",
    "1e308*10",
    "alpha or beta",
)
TERM: Final = table(
    {"term": leaf(lambda draw: draw.rng.choice(TERMS_BAD if draw.bad() else TERMS))}, {"value": number(0.1)}
)
CHANNEL_NAMES: Final = (
    "V",
    "alpha",
    "beta",
    "p",
    "q",
    "r",
    "phi",
    "theta",
    "psi",
    "ax",
    "ay",
    "az",
    "vn",
    "ve",
    "vd",
)
MASS: Final = table(
    {
        "mass": quantity(8.5),
        "inertia": table(
            {"xx": quantity(1.4), "yy": quantity(1.2), "zz": quantity(2.1)},
            {"xz": quantity(0.05), "xy": quantity(0.01), "yz": quantity(0.01)},
            0.1,
        ),
    },
    {"center_of_gravity": point()},
)
REFERENCE: Final = table(
    {
        "area": quantity(0.66),
        "chord": quantity(0.285),
        "span": quantity(2.32, "reference.chord"),
        "airspeed": quantity(24.0),
    },
    {
        "alpha": quantity(0.05),
        "moment_point": point(),
        "inertia": row(quantity(1.4), quantity(1.2), quantity(2.1)),
        "rate_normalization": text("actual", "reference"),
    },
)
ENVIRONMENT: Final = table(
    {}, {"gravity": quantity(9.81), "density": either(text("standard", "log"), quantity(1.2))}
)


def _terms(*known: str) -> Maker:
    """Return a maker of the terms of a coefficient: numbers, tables, false, and terms of one's own."""
    own = {name: either(quantity(0.3), leaf(lambda draw: False)) for name in known}
    more = {f"{known[0][:2]}x{i}": TERM for i in range(2)}
    return table({}, {**own, **more})


AERODYNAMICS: Final = table(
    {},
    {
        "default": flag(),
        "CL": _terms("CL0", "CLalpha", "CLq"),
        "CD": _terms("CD0", "CDalpha2"),
        "CQ": _terms("CQbeta", "CQr"),
        "Cl": _terms("Clp", "Claileron"),
        "Cm": _terms("Cm0", "Cmq", "Cmelevator"),
        "Cn": _terms("Cnr", "Cnrudder"),
    },
)
THRUST_PLACE: Final = {"position": point(0.2), "pitch": quantity(0.02)}
PROPULSION: Final = either(
    table({"kind": text("constant"), "thrust": quantity(20.0)}, THRUST_PLACE),
    table(
        {"kind": text("channel")},
        {"channel": text("thrust", "throttle"), "scale": quantity(1.0), **THRUST_PLACE},
    ),
    table(
        {
            "kind": text("propeller"),
            "channel": text("control_throttle", "motor_5"),
            "speed_gain": quantity(147.0),
            "diameter": quantity(0.4),
            "CT0": quantity(0.14),
        },
        {"idle": quantity(0.1), "CT1": quantity(-0.1), "CT2": quantity(-0.05), **THRUST_PLACE},
    ),
)
CONTROL: Final = table(
    {},
    {
        "mix": named(("pwm_3", "pwm_4", "servo_1"), quantity(0.0007)),
        "offset": quantity(0.01),
        "lag": quantity(0.05),
        "delay": quantity(0.02),
        "rate_limit": quantity(1.5),
        "dead_zone": quantity(0.01),
        "center": named(("pwm_3",), quantity(1500.0)),
    },
    0.2,
)
SENSOR: Final = table(
    {}, {"bias": quantity(0.01), "scale": quantity(1.0), "delay": quantity(0.1), "sigma": number(0.3)}
)
SENSORS: Final = table(
    {},
    {
        "estimate_biases": flag(),
        "accelerometer_position": point(),
        "vane_position": point(),
        "imu_alignment": point(0.01),
        **dict.fromkeys(CHANNEL_NAMES[:12], SENSOR),
    },
    0.15,
)
GUST: Final = table({"intensity": quantity(1.5, "turbulence.u.intensity"), "length": quantity(200.0)})
TURBULENCE: Final = table({"airspeed": quantity(6.0)}, {"u": GUST, "v": GUST, "w": GUST})
BODY_DRAG: Final = table({}, {"linear": point(0.1), "quadratic": point(0.02), "rotation": point(0.002)})
LOADINGS: Final = named(
    ("heavy", "light"), named(("mass.mass", "mass.inertia.xx", "reference.area"), number(1.5))
)
ROTORS: Final = table(
    {"T2": quantity(30.0)},
    {
        "drive": text("command", "speed"),
        "gain": quantity(1.0),
        "idle": quantity(0.05),
        "nominal_voltage": quantity(16.8),
        "voltage_average": number(30.0),
        "lag": quantity(0.05),
        "delay": quantity(0.01),
        "T0": quantity(0.1),
        "T1": quantity(2.5),
        "inflow": quantity(0.25),
        "translational": quantity(0.01),
        "radius": quantity(0.127),
        "drag": quantity(0.08),
        "drag_inflow": quantity(0.001),
        "Q0": quantity(0.002),
        "Q1": quantity(0.02),
        "Q2": quantity(0.1),
        "torque_ratio": quantity(0.016),
        "inertia": quantity(4e-5),
    },
    0.2,
)
GROUND: Final = table(
    {"rotor": quantity(1.0), "radius": quantity(0.127)}, {"channel": text("height"), "lift": quantity(0.1)}
)
HEAD: Final = {"format": text("stoop-vehicle/1"), "name": text("My aircraft", "é"), "mass": MASS}
COMMON: Final = {
    "notes": several(text("Inertia is assumed."), 0, 2),
    "environment": ENVIRONMENT,
    "sensors": SENSORS,
    "turbulence": TURBULENCE,
    "body_drag": BODY_DRAG,
    "loadings": LOADINGS,
}
AIRCRAFT: Final = table(
    {**HEAD, "reference": REFERENCE},
    {
        **COMMON,
        "aerodynamics": AERODYNAMICS,
        "propulsion": PROPULSION,
        "model": table({"reduce": text("full", "longitudinal", "lateral")}),
        "controls": named(("elevator", "aileron", "rudder", "flap"), CONTROL, 3),
    },
)


def _rotor(draw: Draw) -> Node:
    """Draw the rotors of a quadrotor, or of some number of rotors on a circle."""
    count = draw.rng.choice((1, 2, 17)) if draw.bad() else draw.rng.choice((4, 6))
    pairs: list[tuple[str, Node]] = []
    for i in range(count):
        angle = 2.0 * math.pi * (i + 0.5) / count
        place: Node = [0.2 * math.cos(angle), 0.2 * math.sin(angle), -0.03]
        one = table(
            {
                "channel": text(f"motor_{i + 1}"),
                "position": leaf(lambda _, place=place: place),  # type: ignore[misc]
                "spin": text("ccw" if i % 2 else "cw"),
            },
            {
                "axis": row(number(0.1), number(0.1), number(-1.0)),
                "factor": quantity(1.0),
                "torque_factor": quantity(1.1),
            },
            0.1,
        )
        pairs.append((draw.word(f"m{i + 1}"), one(draw)))
    return Branch(pairs)


MULTIROTOR: Final = table(
    {**HEAD, "rotors": ROTORS, "rotor": _rotor}, {**COMMON, "ground_effect": GROUND}, 0.15
)
VEHICLE: Final = either(AIRCRAFT, MULTIROTOR)
