"""Grammars of the other documents that a user writes, from their published pages.

The pages are flight-files.md (mappings), maneuver-file.md, commands.md (windows) and geometry.md; `vehicle_grammar` and
`result_grammar` have those of vehicles and results.
"""

from __future__ import annotations

from typing import Final

from stoop_studies.robustness.node_makers import (
    either,
    flag,
    integer,
    named,
    number,
    row,
    several,
    table,
    text,
)
from stoop_studies.robustness.vehicle_grammar import CHANNEL_NAMES

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
    table(
        {
            **START,
            **LENGTH,
            "shape": text("sweep"),
            "amplitude": number(0.1),
            "low": number(0.5),
            "band": number(5.0),
        },
        {"fade": number(1.0)},
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
