"""The only conversion factors of the package; everything inside is SI and radians."""

from __future__ import annotations

import math
from typing import Final

DEGREE: Final = math.pi / 180.0  #: rad
FOOT: Final = 0.3048  #: m (international foot, exact)
INCH: Final = 0.0254  #: m (exact)
KNOT: Final = 1852.0 / 3600.0  #: m/s (exact)
POUND_FORCE: Final = 4.4482216152605  #: N (exact)
SLUG: Final = POUND_FORCE / FOOT  #: kg
STANDARD_GRAVITY: Final = 9.80665  #: m/s2 (exact by definition)
ZERO_CELSIUS: Final = 273.15  #: K
MICROSECOND: Final = 1e-6  #: s

FACTORS: Final[dict[str, float]] = {
    "1": 1.0, "rad": 1.0, "deg": DEGREE, "rad/s": 1.0, "deg/s": DEGREE, "rad/s2": 1.0, "deg/s2": DEGREE,
    "m": 1.0, "mm": 1e-3, "cm": 1e-2, "km": 1e3, "ft": FOOT,
    "m/s": 1.0, "km/h": 1.0 / 3.6, "kt": KNOT, "ft/s": FOOT,
    "m/s2": 1.0, "ft/s2": FOOT, "g": STANDARD_GRAVITY,
    "s": 1.0, "ms": 1e-3, "us": MICROSECOND, "ns": 1e-9,
    "kg": 1.0, "slug": SLUG, "N": 1.0, "lbf": POUND_FORCE, "N m": 1.0,
    "kg/m3": 1.0, "Pa": 1.0, "hPa": 100.0, "mbar": 100.0, "K": 1.0, "V": 1.0, "A": 1.0,
    "percent": 0.01, "pwm": 1.0,
}  #: unit written in a file -> factor to SI  # fmt: skip
