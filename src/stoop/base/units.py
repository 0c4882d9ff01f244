"""The only conversion factors of the package; everything inside is SI and radians."""

from __future__ import annotations

import math
import tomllib
from importlib.resources import files
from typing import Final, NamedTuple

DEGREE: Final = math.pi / 180.0  #: rad
FOOT: Final = 0.3048  #: m (international foot, exact)
INCH: Final = 0.0254  #: m (exact)
KNOT: Final = 1852.0 / 3600.0  #: m/s (exact)
POUND_FORCE: Final = 4.4482216152605  #: N (exact)
SLUG: Final = POUND_FORCE / FOOT  #: kg
STANDARD_GRAVITY: Final = 9.80665  #: m/s2 (exact by definition)
ZERO_CELSIUS: Final = 273.15  #: K
MICROSECOND: Final = 1e-6  #: s

REVOLUTION: Final = 2.0 * math.pi  #: rad

FACTORS: Final[dict[str, float]] = {
    "1": 1.0, "rad": 1.0, "mrad": 1e-3, "deg": DEGREE, "cdeg": 1e-2 * DEGREE,
    "rad/s": 1.0, "mrad/s": 1e-3, "deg/s": DEGREE, "cdeg/s": 1e-2 * DEGREE, "mdeg/s": 1e-3 * DEGREE,
    "rpm": REVOLUTION / 60.0, "rev/s": REVOLUTION, "rad/s2": 1.0, "deg/s2": DEGREE,
    "m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "in": INCH, "ft": FOOT,
    "m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2, "km/h": 1.0 / 3.6, "kt": KNOT, "ft/s": FOOT, "ft/min": FOOT / 60.0,
    "m/s2": 1.0, "mm/s2": 1e-3, "cm/s2": 1e-2, "ft/s2": FOOT, "g": STANDARD_GRAVITY, "mg": 1e-3 * STANDARD_GRAVITY,
    "s": 1.0, "ms": 1e-3, "us": MICROSECOND, "ns": 1e-9,
    "kg": 1.0, "slug": SLUG, "N": 1.0, "lbf": POUND_FORCE, "N m": 1.0,
    "kg/m3": 1.0, "Pa": 1.0, "hPa": 100.0, "kPa": 1e3, "mbar": 100.0, "K": 1.0, "degC": 1.0,
    "V": 1.0, "mV": 1e-3, "A": 1.0, "mA": 1e-3, "cA": 1e-2,
    "percent": 0.01, "%": 0.01, "pwm": 1.0,
}  #: unit written in a file -> factor to SI  # fmt: skip

#: unit of a servo pulse -> microseconds, as pulses are kept
PULSE_FACTORS: Final[dict[str, float]] = {"pwm": 1.0, "us": 1.0, "ms": 1e3, "s": 1e6}

_KINDS: Final[dict[str, str]] = {
    "an angle": "rad mrad deg cdeg", "a rate of turn": "rad/s mrad/s deg/s cdeg/s mdeg/s rpm rev/s",
    "an angular acceleration": "rad/s2 deg/s2", "a length": "m mm cm km in ft",
    "a speed": "m/s mm/s cm/s km/h kt ft/s ft/min", "an acceleration": "m/s2 mm/s2 cm/s2 ft/s2 g mg",
    "a time": "s ms us ns pwm", "a mass": "kg slug", "a force": "N lbf", "a moment": "N_m", "a density": "kg/m3",
    "a pressure": "Pa hPa kPa mbar", "a temperature": "K degC", "a voltage": "V mV", "a current": "A mA cA",
    "a plain number": "1 percent %",
}  # fmt: skip


class Unit(NamedTuple):
    """A unit of measurement."""

    factor: float  #: to SI
    kind: str  #: what it measures
    zero: float  #: SI value of its zero
    written: tuple[str, ...]  #: as files and people write it, in small letters


_WRITTEN: Final = tomllib.loads((files("stoop.data") / "units.toml").read_text("utf-8"))

#: symbol -> unit
UNITS: Final[dict[str, Unit]] = {
    symbol: Unit(
        FACTORS[symbol], kind, ZERO_CELSIUS if symbol == "degC" else 0.0, tuple(_WRITTEN.get(symbol, ()))
    )
    for kind, symbols in _KINDS.items()
    for symbol in (text.replace("_", " ") for text in symbols.split())
}
#: what is written -> symbol
WRITTEN: Final = {text: symbol for symbol, unit in UNITS.items() for text in unit.written}
