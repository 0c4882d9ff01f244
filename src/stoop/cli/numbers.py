"""Numbers on the command line, refused in one line where they are none."""

from __future__ import annotations

import argparse
import math


def count(text: str) -> int:
    """Read a whole number, zero or above."""
    if not text.isascii() or not text.isdigit():
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number, zero or above")
    return int(text)


def at_least_one(text: str) -> int:
    """Read a whole number, one or above."""
    if not text.isascii() or not text.isdigit() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"'{text}' is not a whole number, one or above")
    return int(text)


def positive(text: str) -> float:
    """Read a finite number above zero."""
    value = _number(text)
    if not 0.0 < value < math.inf:
        raise argparse.ArgumentTypeError(f"'{text}' is not a positive number")
    return value


def finite(text: str) -> float:
    """Read a number that is neither infinite nor nan."""
    value = _number(text)
    if not math.isfinite(value):
        raise argparse.ArgumentTypeError(f"'{text}' is not a number")
    return value


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        return math.nan
