"""Every unit of the registry against the definitions: scipy.constants, the SI brochure (2019), ISO 80000, NIST SP 811."""

import math

from scipy import constants as c

from stoop.base import units
from stoop.base.variables import VARIABLES

PREFIXES = {"k": c.kilo, "h": c.hecto, "c": c.centi, "m": c.milli, "u": c.micro, "n": c.nano}
#: unit -> SI value and SI unit, written from the definitions
DEFINED: dict[str, tuple[float, str]] = {
    "1": (1.0, "1"), "percent": (c.centi, "1"), "%": (c.centi, "1"),
    "rad": (1.0, "rad"), "deg": (c.degree, "rad"), "rev": (2.0 * c.pi, "rad"),
    "m": (1.0, "m"), "in": (c.inch, "m"), "ft": (c.foot, "m"), "kt": (c.knot, "m/s"), "km/h": (c.kmh, "m/s"),
    "g": (c.g, "m/s2"), "s": (1.0, "s"), "kg": (1.0, "kg"), "slug": (c.slug, "kg"), "N": (1.0, "N"), "lbf": (c.lbf, "N"),
    "N m": (1.0, "N m"), "kg/m3": (1.0, "kg/m3"), "Pa": (1.0, "Pa"), "mbar": (1e-3 * c.bar, "Pa"), "K": (1.0, "K"),
    "degC": (1.0, "K"), "V": (1.0, "V"), "A": (1.0, "A"), "rpm": (2.0 * c.pi / c.minute, "rad/s"),
    "ft/min": (c.foot / c.minute, "m/s"), "pwm": (1.0, "pwm"),
}  # fmt: skip
KINDS = {
    "1": "a plain number", "rad": "an angle", "rad/s": "a rate of turn", "rad/s2": "an angular acceleration", "m": "a length",
    "m/s": "a speed", "m/s2": "an acceleration", "s": "a time", "pwm": "a time", "kg": "a mass", "N": "a force",
    "N m": "a moment", "kg/m3": "a density", "Pa": "a pressure", "K": "a temperature", "V": "a voltage", "A": "a current",
}  # fmt: skip


def defined(unit: str) -> tuple[float, str]:
    if unit in DEFINED:
        return DEFINED[unit]
    base, slash, per = unit.partition("/")
    if slash:
        assert per in ("s", "s2"), unit
        value, si = defined(base)
        return value, f"{si}/{per}"
    value, si = DEFINED[unit[1:]]
    return PREFIXES[unit[0]] * value, si


def test_every_factor_is_the_definition() -> None:
    wrong = {u: f for u, f in units.FACTORS.items() if not math.isclose(f, defined(u)[0], rel_tol=1e-15)}
    assert wrong == {}
    assert {u: KINDS[defined(u)[1]] for u in units.FACTORS} == {u: x.kind for u, x in units.UNITS.items()}
    assert {v.unit for v in VARIABLES.values()} <= {*units.FACTORS}
    found = {u: x.zero for u, x in units.UNITS.items() if x.zero}
    assert found == {"degC": c.convert_temperature(0.0, "Celsius", "Kelvin")}
    assert {u: x.factor for u, x in units.UNITS.items()} == units.FACTORS
    expected = {u: c.micro if u == "pwm" else defined(u)[0] for u in units.PULSE_FACTORS}
    assert {*expected} == {"pwm", "us", "ms", "s"}
    assert all(math.isclose(f * c.micro, expected[u], rel_tol=1e-15) for u, f in units.PULSE_FACTORS.items())


def test_every_named_constant_is_the_definition() -> None:
    expected = {
        "DEGREE": c.degree, "FOOT": c.foot, "INCH": c.inch, "KNOT": c.knot, "POUND_FORCE": c.lbf, "SLUG": c.slug,
        "STANDARD_GRAVITY": c.g, "ZERO_CELSIUS": c.zero_Celsius, "MICROSECOND": c.micro, "REVOLUTION": 2.0 * c.pi,
    }  # fmt: skip
    found = {n: x for n, x in vars(units).items() if n.isupper() and isinstance(x, float)}
    assert found.keys() == expected.keys()
    assert {n: x for n, x in found.items() if not math.isclose(x, expected[n], rel_tol=1e-15)} == {}
