"""Values that carry their derivatives: forward differentiation of NumPy's functions, exact to rounding.

References
----------
A. Griewank and A. Walther, *Evaluating Derivatives*, 2nd ed., SIAM, 2008, section 3.1.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Any, Final

import numpy as np
from numpy.lib.mixins import NDArrayOperatorsMixin

#: operation -> its partial derivatives, of its result and its operands
_PARTIALS: Final[Mapping[np.ufunc, Callable[..., tuple[Any, ...]]]] = MappingProxyType(
    {
        np.add: lambda _, a, b: (1.0, 1.0),
        np.subtract: lambda _, a, b: (1.0, -1.0),
        np.multiply: lambda _, a, b: (b, a),
        np.true_divide: lambda ratio, a, b: (1.0 / b, -ratio / b),
        np.negative: lambda _, a: (-1.0,),
        np.sqrt: lambda root, a: (0.5 / root,),
        np.absolute: lambda _, a: (np.sign(a),),
        np.arctan2: lambda _, y, x: (x / (x * x + y * y), -y / (x * x + y * y)),
    }
)


class Dual(NDArrayOperatorsMixin):
    """A value and its derivatives, which broadcast against it; duals of duals have second derivatives."""

    def __init__(self, value: Any, slope: Any) -> None:
        self.value, self.slope = value, slope

    def __array_ufunc__(self, ufunc: np.ufunc, method: str, *operands: Any) -> Any:
        if ufunc not in _PARTIALS:
            return NotImplemented
        values = [x.value if isinstance(x, Dual) else x for x in operands]
        found = ufunc(*values)
        partials = zip(_PARTIALS[ufunc](found, *values), operands, strict=True)
        first, *others = (partial * x.slope for partial, x in partials if isinstance(x, Dual))
        return Dual(found, sum(others, first))
