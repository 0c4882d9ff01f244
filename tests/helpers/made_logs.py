"""Logs of made columns and the mappings that read them; body rates of angles, written down once."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from stoop.base.arrays import FloatArray as Array
from stoop.base.variables import VARIABLES

CLOCK = '[time]\ncolumn = "t"\nunit = "s"\n[variables]\n'


def csv_log(path: Path, columns: Mapping[str, Array]) -> Path:
    """Write a table, its clock first."""
    rows = np.column_stack([*columns.values()])
    np.savetxt(path, rows, "%.17g", ",", header=",".join(columns), comments="")
    return path


def lines_of(*names: str, more: str = "") -> str:
    """Return the lines of a mapping of columns that are called as their variables, in SI."""
    return "".join(f'{n} = {{column = "{n}", unit = "{VARIABLES[n].unit}"{more}}}\n' for n in names)


def mapped_log(path: Path, columns: Mapping[str, Array]) -> Path:
    """Write a table whose clock is t, in s, and beside it the mapping of the others."""
    path.with_name(path.name + ".toml").write_text(CLOCK + lines_of(*(n for n in columns if n != "t")))
    return csv_log(path, columns)


def body_rates(phi: Array, theta: Array, dphi: Array, dtheta: Array, dpsi: Array) -> tuple[Array, ...]:
    p = dphi - dpsi * np.sin(theta)
    q = dtheta * np.cos(phi) + dpsi * np.sin(phi) * np.cos(theta)
    return p, q, -dtheta * np.sin(phi) + dpsi * np.cos(phi) * np.cos(theta)
