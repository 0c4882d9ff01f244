"""The files of NIST StRD: starts, certified values and data, parsed and nothing evaluated."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.errors import StoopError

_ROW: Final = re.compile(r"^\s*b\d+ =\s+(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.MULTILINE)
_SUM: Final = re.compile(r"^Residual Sum of Squares:\s+(\S+)\s*$", re.MULTILINE)
_LEVEL: Final = re.compile(r"^\s*(Lower|Average|Higher) Level of Difficulty", re.MULTILINE)
FOLDER: Final = "nist-strd"


@dataclass(frozen=True, eq=False)
class Certified:
    """What a file says.

    Attributes
    ----------
    name : str
    level : str
        Of difficulty: lower, average or higher.
    starts : (2, p)
    values, deviations : (p,)
        Certified parameters and their standard deviations.
    least : float
        Certified residual sum of squares.
    y : (n,)
    x : (m, n)
        Predictors.
    """

    name: str
    level: str
    starts: FloatArray
    values: FloatArray
    deviations: FloatArray
    least: float
    y: FloatArray
    x: FloatArray


def read_certified(path: Path) -> Certified:
    """Read a file.

    Raises
    ------
    StoopError
        It cannot be read, or is not of this format.
    """
    try:
        text = path.read_text(encoding="ascii")
    except (OSError, UnicodeDecodeError) as error:
        raise StoopError(f"{path}: cannot be read ({error}); fetch it again from NIST") from None
    try:
        return _parsed(path.stem, text)
    except (ValueError, TypeError, IndexError):
        raise StoopError(f"{path}: is no file of NIST StRD; fetch it again from NIST") from None


def _parsed(name: str, text: str) -> Certified:
    rows = np.array(_ROW.findall(text), dtype=np.float64)
    least, level = _SUM.search(text), _LEVEL.search(text)
    if least is None or level is None:
        raise ValueError("no certified sum of squares or no level of difficulty")
    lines = text[text.rindex("\nData:") :].splitlines()[2:]
    table = np.array([line.split() for line in lines if line.strip()], dtype=np.float64)
    return Certified(
        name,
        level[1].lower(),
        rows[:, :2].T,
        rows[:, 2],
        rows[:, 3],
        float(least[1]),
        table[:, 0],
        table[:, 1:].T,
    )


def problem_files(folder: Path | None, names: tuple[str, ...]) -> list[Path]:
    """Return the files of the problems that lie in a folder, or in its folder ``nist-strd``.

    Raises
    ------
    StoopError
        There are none.
    """
    places = [] if folder is None else [folder, folder / FOLDER]
    found = [[p / f"{n}.dat" for n in names if (p / f"{n}.dat").is_file()] for p in places]
    best = max(found, key=len, default=[])
    if not best:
        where = "no folder is named" if folder is None else f"{folder}: holds none of its files"
        raise StoopError(
            f"nist: {where}; give --data DIR with the files of "
            "https://www.itl.nist.gov/div898/strd/nls/nls_main.shtml (Misra1a.dat and others)"
        )
    return best
