"""Grammars of the documents that stoop reads, written from their published pages: what may stand where, and what usually does.

A maker draws a node: the usual one, or a hostile one where the next choice is. The pages are vehicle-file.md, flight-files.md
(mappings), maneuver-file.md, commands.md (windows) and geometry.md; `result_grammar` has that of results.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from typing import Final, TypeAlias

from stoop_studies.robustness.document_trees import TEXTS, Branch, Node, hostile
from stoop_studies.robustness.log_grammars import Draw

Maker: TypeAlias = Callable[[Draw], Node]
SPREAD: Final = 0.2  #: of a number about its usual value, as a share
OPTIONAL: Final = 0.3  #: of the keys that may be left out, how many are written


def table(
    required: Mapping[str, Maker], optional: Mapping[str, Maker] | None = None, share: float = OPTIONAL
) -> Maker:
    """Return a maker of tables; a hostile one lacks a key, or has one more."""

    def make(draw: Draw) -> Node:
        pairs = [(key, maker(draw)) for key, maker in required.items()]
        pairs += [(key, maker(draw)) for key, maker in (optional or {}).items() if draw.rng.random() < share]
        if pairs and draw.rng.random() < 0.1 * draw.hostile:
            del pairs[draw.rng.randrange(len(pairs))]
        if draw.rng.random() < 0.1 * draw.hostile:
            pairs.insert(draw.rng.randrange(len(pairs) + 1), (draw.rng.choice(TEXTS), hostile(draw.rng)))
        return Branch(pairs)

    return make


def leaf(usual: Callable[[Draw], Node]) -> Maker:
    """Return a maker of one value."""
    return lambda draw: hostile(draw.rng) if draw.bad() else usual(draw)


def number(usual: float, spread: float = SPREAD) -> Maker:
    """Return a maker of numbers about a usual one."""
    return leaf(lambda draw: usual * math.exp(draw.rng.gauss(0.0, spread)))


def integer(most: int) -> Maker:
    """Return a maker of counts."""
    return leaf(lambda draw: draw.rng.randrange(most + 1))


def text(*words: str) -> Maker:
    """Return a maker of one of some words."""
    return leaf(lambda draw: draw.rng.choice(words))


def flag() -> Maker:
    """Return a maker of true and false."""
    return leaf(lambda draw: draw.rng.random() < 0.5)


def nothing() -> Maker:
    """Return a maker of a value that does not exist."""
    return leaf(lambda draw: None)


def several(maker: Maker, least: int, most: int) -> Maker:
    """Return a maker of lists; a hostile one has another length."""

    def make(draw: Draw) -> Node:
        count = draw.rng.choice((0, 1, most + 1, 50)) if draw.bad() else draw.rng.randint(least, most)
        return [maker(draw) for _ in range(count)]

    return make


def row(*makers: Maker) -> Maker:
    """Return a maker of lists with one entry of each."""
    return several_of(makers)


def several_of(makers: tuple[Maker, ...]) -> Maker:
    """Return a maker of lists with one entry of each maker; a hostile one lacks the last or repeats it."""

    def make(draw: Draw) -> Node:
        made = [maker(draw) for maker in makers]
        if draw.rng.random() < 0.1 * draw.hostile:
            made = draw.rng.choice((made[:-1], [*made, *made[-1:]]))
        return list(made)

    return make


def named(names: tuple[str, ...], maker: Maker, least: int = 1) -> Maker:
    """Return a maker of tables by names of the user's choice."""

    def make(draw: Draw) -> Node:
        chosen = draw.rng.sample(names, draw.rng.randint(min(least, len(names)), len(names)))
        return Branch([(draw.word(name), maker(draw)) for name in chosen])

    return make


def either(*makers: Maker) -> Maker:
    """Return a maker that is one of several."""
    return lambda draw: draw.rng.choice(makers)(draw)


def quantity(usual: float, *ties: str) -> Maker:
    """Return a maker of a number of a vehicle file: plain, with bounds and prior, or tied."""
    plain = number(usual)
    size = abs(usual) or 1.0

    def full(draw: Draw) -> Node:
        keys: list[tuple[str, Maker]] = [
            ("free", flag()),
            (
                "bounds",
                row(number(min(usual, 0.0) - 3.0 * size, 0.0), number(max(usual, 0.0) + 3.0 * size, 0.0)),
            ),
            ("prior", either(number(size), text("guess"))),
        ]
        chosen = [key for key in keys if draw.rng.random() < 0.5]
        pairs = [("value", plain(draw)), *((key, maker(draw)) for key, maker in chosen)]
        if draw.bad():
            pairs.append(
                draw.rng.choice(
                    (("mean", 0.1), ("tie", "mass.mass"), ("bounds", [1.0, 0.0]), ("prior", -1.0))
                )
            )
        return Branch(list(pairs))

    tied = text(*(f"={name}" for name in (*ties, "mass.mass"))) if ties else plain
    return lambda draw: (plain, plain, full, tied)[draw.rng.randrange(4)](draw)


def point(size: float = 0.3) -> Maker:
    """Return a maker of the coordinates of a point."""
    return row(quantity(size), quantity(0.0), quantity(-size))


# vehicle files: docs/vehicle-file.md

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

# mappings of a table with the columns t_ms, p, az and phi: docs/flight-files.md

COLUMN: Final = either(text("p", "az", "phi"), named(("p", "az"), number(1.0)))
CLOCK: Final = table({"column": text("t_ms"), "unit": text("ms")}, {"offset": number(0.5)})
LINE_KEYS: Final = {
    "scale": number(1.0),
    "offset": number(0.1),
    "stream": text("a.csv"),
    "file": text("a.csv"),
    "frame": text("frd", "flu"),
    "valid": text("az", "p"),
    "stamp": text("t_ms"),
    "stamp_unit": text("ms"),
    "unused": number(0.0),
    "instance": text("first", "most moved"),
    "optional": flag(),
}
RATE_LINE: Final = table({"column": COLUMN, "unit": text("deg/s", "rad/s", "rpm")}, LINE_KEYS, 0.08)
VARIABLE_TABLES: Final = table(
    {},
    {
        "p": RATE_LINE,
        "q": RATE_LINE,
        "az": table({"column": COLUMN, "unit": text("g", "m/s2")}, LINE_KEYS, 0.08),
        "phi": table({"column": text("phi"), "unit": text("deg")}, LINE_KEYS, 0.08),
        "pwm_1": table({"column": COLUMN, "unit": text("pwm", "us")}),
        "motor_1": table({"column": COLUMN, "unit": text("1", "percent")}),
    },
    0.7,
)
SOURCE: Final = table(
    {"columns": either(several(COLUMN, 1, 3), text("p", "x{1..2}", "x{1..99999999}", "{2..1}"))},
    {
        "stream": text("a.csv", "ESC/{0..1}"),
        "unit": either(text("deg/s"), several(text("deg/s"), 1, 3)),
        "scale": either(number(1.0), several(number(1.0), 1, 3)),
        "partial": flag(),
    },
)
GROUP: Final = table(
    {
        "variables": either(several(text("p", "q", "r"), 1, 3), text("rotor_{1..2}", "pwm_{1..8}")),
        "sources": several(SOURCE, 1, 2),
    },
    {
        "choose": text("first", "fastest"),
        "unit": text("deg/s", "rpm"),
        "partial": flag(),
        "unused": integer(1),
    },
)
CALIBRATION: Final = table(
    {"points": several(row(number(1500.0, 0.3), number(0.3, 1.0)), 2, 5)},
    {"unit": text("rad", "deg"), "degree": integer(3)},
)
MIXER: Final = table({"kind": text("v-tail", "elevon"), "left": text("pwm_1"), "right": text("motor_1")})
ALIGN: Final = table(
    {"with": text("a.csv", "b.csv")},
    {"using": several(text("p", "turning"), 0, 2), "longest": number(30.0), "drift": flag()},
)
MAPPING: Final = table(
    {"time": CLOCK, "variables": VARIABLE_TABLES},
    {
        "extends": text("px4", "ardupilot", "none"),
        "files": named(("more",), text("a.csv", "../a.csv", "/etc/passwd", "b.csv")),
        "clock": named(("a.csv", "b"), CLOCK),
        "group": named(("rates", "p"), GROUP),
        "calibration": named(("pwm_1", "motor_1"), CALIBRATION),
        "surface": named(("aileron", "elevator"), table({"from": named(("pwm_1", "motor_1"), number(1.0))})),
        "mixer": named(("tail",), MIXER),
        "align": named(("a.csv", "b"), ALIGN),
    },
    0.12,
)

# maneuver files: docs/maneuver-file.md

CONTROL_NAME: Final = text(
    "elevator", "aileron", "rudder", "throttle", "roll", "forward", "heading", "motor_1"
)
START: Final = {"control": CONTROL_NAME, "start": number(1.0)}
LENGTH: Final = {"duration": number(5.0)}
INPUT: Final = either(
    table(
        {
            **START,
            "shape": text("3-2-1-1", "doublet", "1-1", "2-1-1"),
            "step": number(0.3),
            "amplitude": number(0.1),
        },
        {"slew": number(3.0)},
    ),
    table({**START, **LENGTH, "shape": text("pulse"), "amplitude": number(0.1)}),
    table(
        {
            **START,
            "shape": text("levels"),
            "levels": row(number(0.1), number(-0.1)),
            "lengths": row(number(0.5), number(0.5)),
        },
        {"slew": number(3.0)},
    ),
    table(
        {**START, **LENGTH, "shape": text("multisine"), "amplitude": number(0.1), "band": number(2.0)},
        {"first": integer(5), "stride": integer(3)},
    ),
    table(
        {
            **START,
            **LENGTH,
            "shape": text("harmonics"),
            "harmonics": row(integer(9), integer(9)),
            "amplitudes": row(number(0.1), number(0.1)),
            "phases": row(number(0.1), number(1.0)),
        }
    ),
)
SPEEDS: Final = row(number(3.0), number(-1.0), number(0.1))
MANEUVER: Final = table(
    {"duration": number(20.0), "input": several(INPUT, 0, 4)},
    {
        "format": text("stoop-maneuver/1"),
        "rate": number(100.0),
        "airspeed": number(30.0),
        "altitude": number(200.0),
        "heading": number(0.5),
        "wind": SPEEDS,
        "velocity": SPEEDS,
        "noise": named(CHANNEL_NAMES, number(0.1), 0),
        "battery": table({}, {"start": number(16.0), "fall": number(0.01), "sag": number(0.5)}),
    },
)

# windows and geometry

WINDOW: Final = table(
    {"flight": text("a", "b c", "é"), "start": number(5.0), "stop": number(50.0)},
    {
        "loading": text("heavy"),
        "axis": text("roll", "pitch"),
        "why": text("doublet"),
        "information": number(0.5),
        "gain": number(0.3),
        "accept": flag(),
        "use": text("fit", "validate"),
    },
)
WINDOWS: Final = table({"format": text("stoop-windows/1"), "window": several(WINDOW, 0, 4)})
FLAP: Final = table({}, {"chord": number(0.25), "span": row(number(0.3), number(0.9, 0.02))})
SURFACE: Final = {
    "taper": number(0.7),
    "sweep": number(0.05),
    "position": row(number(0.1), number(0.0), number(0.1)),
    "dihedral": number(0.03),
    "incidence": number(0.02),
}
GEOMETRY: Final = table(
    {
        "template": text("conventional", "v-tail", "glider", "flying-wing", "quadplane"),
        "mass": number(8.5),
        "wing": table(
            {"span": number(2.3), "chord": number(0.3)},
            {**SURFACE, "camber": number(0.02), "thickness": number(0.12), "aileron": FLAP},
        ),
    },
    {
        "format": text("stoop-geometry/1"),
        "tail": table({}, {"area": number(0.1), "span": number(0.7), **SURFACE, "elevator": FLAP}),
        "fin": table({}, {"area": number(0.06), "span": number(0.3), "rudder": FLAP}),
        "fuselage": table({}, {"length": number(1.2), "width": number(0.12), "height": number(0.15)}),
    },
)

COVARIANCE: Final = either(
    row(row(number(0.1), number(0.2), number(0.3))),
    row(*(row(*(number(1.0 if i == k else 0.01, 0.01) for k in range(3))) for i in range(3))),
)
VEHICLE: Final = either(AIRCRAFT, MULTIROTOR)
