"""What a result says of its own uncertainty: by method, and what the data can tell at all.

These are parts of the result (``docs/result-schema.md``); the numbers come from `stoop.assess`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

NAN: Final = math.nan


@dataclass(frozen=True)
class Spread:
    """What one method says of one parameter.

    Attributes
    ----------
    std_error : float, the parameter's unit
        NaN when the method gives none.
    ci95_lower, ci95_upper : float, the parameter's unit
        Ends of the 95 % interval; NaN for an end that the data leave open.
    """

    std_error: float = NAN
    ci95_lower: float = NAN
    ci95_upper: float = NAN


@dataclass(frozen=True)
class MethodSpread:
    """What one method says of the uncertainty of the parameters that it looked at.

    Attributes
    ----------
    parameters : mapping of str to Spread
    figures : mapping of str to float
        How well the method itself worked: replicates, convergence statistics.
    notes : tuple of str
        In plain words.
    """

    parameters: Mapping[str, Spread]
    figures: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Sight:
    """How the data see one parameter.

    Attributes
    ----------
    conditional_std, marginal_std : float, the parameter's unit
        Standard error if everything else were known, and as it is; NaN when the data leave it free.
    multiple_correlation : float
        With all other unknowns together; 1 means that they can take its place.
    partners : tuple of str
        Parameters that could take its place, the strongest first, then those that move with it unseen.
    doubt : str
        Why its number is doubtful, in plain words; empty when nothing is amiss.
    advice : str
        The maneuver that would tell it; empty when nothing is amiss.
    """

    conditional_std: float
    marginal_std: float
    multiple_correlation: float
    partners: tuple[str, ...] = ()
    doubt: str = ""
    advice: str = ""


@dataclass(frozen=True)
class CorrelatedPair:
    """Two parameters that are known together rather than one by one."""

    first: str
    second: str
    correlation: float


@dataclass(frozen=True)
class BlindDirection:
    """A combination of parameters along which the data hardly change.

    Attributes
    ----------
    singular_value : float
        Of the sensitivities with columns scaled to length 1; 0 where the data see nothing at all.
    changes : mapping of str to float
        How far each parameter moves along it until the cost has risen by 1, in its unit, or one of them has doubled; those
        that matter.
    words : str
    """

    singular_value: float
    changes: Mapping[str, float]
    words: str


@dataclass(frozen=True)
class Identifiable:
    """What the data can tell.

    Attributes
    ----------
    singular_values : tuple of float
        Of the sensitivities to the parameters, initial states and biases left free, with columns scaled to length 1;
        descending.
    parameters : mapping of str to Sight
    pairs : tuple of CorrelatedPair
        The worst, in order.
    directions : tuple of BlindDirection
        Those that the data cannot see, the darkest first.
    """

    singular_values: tuple[float, ...] = ()
    parameters: Mapping[str, Sight] = field(default_factory=dict)
    pairs: tuple[CorrelatedPair, ...] = ()
    directions: tuple[BlindDirection, ...] = ()
