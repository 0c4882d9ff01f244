"""Expressions of a vehicle's numbers in the grammar of aerodynamic terms: parsed against a white list, never run as code."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.text import nearest
from stoop.extend.vehicles import terms
from stoop_analysis.propagation.quantities import Samples

NAME: Final = re.compile(r"(?<![\w.])[A-Za-z_]\w*(?:\.[A-Za-z_]\w*)*")
ABS: Final = "abs"
GRAMMAR: Final = "write names, numbers, + - * /, whole powers (**) and abs()"


def parse_expressions(texts: Mapping[str, str], vehicle: Vehicle) -> dict[str, Expression]:
    """Return expressions by their names; every number of the vehicle file may stand in them.

    Raises
    ------
    StoopError
        A name that the vehicle does not have, or text that is no expression.
    """
    return {name: Expression.of(name, text, vehicle) for name, text in texts.items()}


class Expression:
    """An expression of numbers of a vehicle."""

    def __init__(self, name: str, text: str, places: Mapping[str, int]) -> None:
        self.name, self.text = name, text
        # the grammar knows no points in names
        symbols = {known: f"v{i}" for i, known in enumerate(places)}
        plain = NAME.sub(lambda found: symbols.get(found[0], found[0]), text)
        try:
            self.tree = terms.parse(plain, symbols.values(), f"expression {name}")
        except StoopError as error:
            known = {symbol: name for name, symbol in symbols.items()}
            raise StoopError(re.sub(r"\bv\d+\b", lambda one: known.get(one[0], one[0]), str(error))) from None
        self.rows = {symbols[known]: place for known, place in places.items()}

    @classmethod
    def of(cls, name: str, text: str, vehicle: Vehicle) -> Expression:
        """Return the expression of a text; raises StoopError as :func:`parse_expressions`."""
        found = [one for one in dict.fromkeys(NAME.findall(text)) if one != ABS]
        unknown = next((one for one in found if one not in vehicle.rows), None)
        if unknown is not None and re.search(rf"{re.escape(unknown)}\s*\(", text):
            raise StoopError(f"expression {name}: there is no function {unknown}(); {GRAMMAR}")
        if unknown is not None:
            raise StoopError(
                f"expression {name}: {vehicle.where} has no number '{unknown}'; {nearest(unknown, vehicle.rows)}"
            )
        return cls(name, text, {one: vehicle.rows[one] for one in found})

    def values(self, rows: FloatArray) -> FloatArray:
        """Return the values (B,) for kernel parameters (n_p, B); NaN where there is none."""
        with np.errstate(all="ignore"):
            found = terms.convert(self.tree, {symbol: rows[row] for symbol, row in self.rows.items()})
        value = np.broadcast_to(np.asarray(found, dtype=np.float64), rows.shape[1:])
        return np.where(np.isfinite(value), value, np.nan)

    def samples(self, rows: FloatArray) -> Samples:
        """Return the quantity; the first lane of (n_p, 1 + D) is the estimate."""
        return Samples.of(self.name, "", self.values(rows))
