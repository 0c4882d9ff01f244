"""Numbers as people read them: as many digits as they are worth, a true minus, powers of ten set raised."""

from __future__ import annotations

import math
import re
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, TypeVar

from stoop.base.units import DEGREE
from stoop.errors import SimulationError

if TYPE_CHECKING:
    from stoop.base.arrays import FloatArray

Values = TypeVar("Values", float, "FloatArray")

MAX_NUMBER: Final = 1e30  #: in any unit; powers and products of larger numbers leave float64
NOTHING: Final = "–"
ROUNDING: Final = 1e-12  #: of the scale of a row, a column or a matrix: what solvers leave where zero belongs
RAISED: Final = str.maketrans("0123456789-", "⁰¹²³⁴⁵⁶⁷⁸⁹⁻")
SHOWN_IN_DEGREES: Final = {"rad": "deg", "rad/s": "deg/s", "rad/s2": "deg/s2"}
POWER: Final = re.compile(r"(?<=[a-zA-Z])\d+")
#: quantity of a condition -> unit and limits
LIMITS: Final = {
    "airspeed": ("m/s", 0.0, 1e4), "altitude": ("m", -1e4, 4e4), "band": ("rad/s", 1e-3, 1e4), "band in Hz": ("Hz", 0.0, 1e4),
}  # fmt: skip


def within_limits(name: str, given: Any, count: int = 1) -> tuple[float, ...]:
    """Return a quantity of `LIMITS`, or two of a pair or a text LOW:HIGH; raises `SimulationError`: no such, or outside."""
    unit, least, most = LIMITS[name]
    try:
        parts = given.split(":") if isinstance(given, str) else given if count > 1 else [given]
        values = tuple(map(float, parts))
    except (TypeError, ValueError):
        values = ()
    if len(values) != count or not all(a <= b for a, b in pairwise((least, *values, most))):
        form = "a number" if count == 1 else "LOW:HIGH, the lower number first,"
        raise SimulationError(f"{name} {given}: give {form} from {least:g} to {most:g} {unit}")
    return values


def number(value: float, digits: int = 4) -> str:
    """Return `value` with `digits` significant digits; a dash when there is none."""
    if math.isnan(value):
        return NOTHING
    if math.isinf(value):
        return "∞" if value > 0.0 else "−∞"
    exponent = math.floor(math.log10(abs(value))) if value else 0
    if -4 < exponent < 6:
        return _minus(f"{value:.{max(0, digits - 1 - exponent)}f}")
    return _power(f"{value:.{digits - 1}e}")


def without_rounding(values: Values, scale: Values | float) -> Values:
    """Return `values`, zero where they are rounding errors beside the `scale` of the row, column or matrix they belong to."""
    return values * (abs(values) > ROUNDING * scale) + 0.0  # + 0: no negative zero


def finite_or_none(value: float) -> float | None:
    """Return what a file of numbers holds for `value`: itself, or nothing where it is not finite."""
    return float(value) if math.isfinite(value) else None


def compact(value: float, digits: int = 3) -> str:
    """Return `value` without trailing zeros, for numbers that somebody chose."""
    text = number(value, digits)
    return text.rstrip("0").rstrip(".") if "." in text and "×" not in text else text


def rounded_to_error(value: float, error: float) -> tuple[str, str]:
    """Return `value` and its standard error, both to the second significant digit of the error."""
    if not (math.isfinite(value) and math.isfinite(error) and error > 0.0):
        return number(value), number(error, 2)
    last = math.floor(math.log10(error)) - 1
    largest = math.floor(math.log10(max(abs(value), error)))
    if largest >= 6 or last < -7:
        digits = max(largest - last + 1, 1)
        return _power(f"{value:.{digits - 1}e}"), number(error, 2)
    decimals = max(0, -last)
    return _minus(f"{value:.{decimals}f}"), _minus(f"{error:.{decimals}f}")


def clock(value: float) -> str:
    """Return a time in s as short as it is: milliseconds at most."""
    return number(value) if not math.isfinite(value) else _minus(f"{value:.3f}".rstrip("0").rstrip("."))


def window(start: float, stop: float) -> str:
    """Return e.g. ``140–145 s``."""
    return f"{clock(start)}–{clock(stop)} s"


def share(value: float) -> str:
    """Return a share between 0 and 1 in percent; a dash when there is none."""
    return NOTHING if math.isnan(value) else f"{100.0 * value:.0f} %"


def factor_and_unit(unit: str) -> tuple[float, str]:
    """Return by what an SI value is multiplied to be drawn, and in which unit: angles in degrees."""
    shown = SHOWN_IN_DEGREES.get(unit, unit)
    factor = 1.0 / DEGREE if shown != unit else 1.0
    return factor, readable_unit(shown)


def readable_unit(unit: str) -> str:
    """Return the unit with raised powers; nothing for a pure number."""
    return "" if unit == "1" else POWER.sub(lambda found: found.group().translate(RAISED), unit)


def count(amount: int, one: str, many: str = "") -> str:
    """Return e.g. ``1 parameter`` or ``3 parameters``."""
    return f"{amount} {one if amount == 1 else many or one + 's'}"


def _minus(text: str) -> str:
    return text.replace("-", "−")


def _power(text: str) -> str:
    mantissa, exponent = text.split("e")
    return _minus(mantissa) + "×10" + str(int(exponent)).translate(RAISED)
