"""What a model lacks: score tests of extensions (``docs/extensions.md``), and frequency responses that it does not explain."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field


@dataclass(frozen=True)
class ExtensionTest:
    """One extension that the data ask for."""

    name: str  #: of the number in the vehicle file
    kind: str  #: "term", "number", "lag", "delay", "scale", ...
    value: float  #: that it would take, to first order
    std_error: float  #: of the value, with all other unknowns free
    unit: str
    statistic: float  #: t of the score test, residuals taken as colored
    p_value: float  #: of the largest of all tests of this fit (Bonferroni)
    gain: float  #: of log-likelihood
    line: str  #: what to write into the vehicle file
    change: float = math.nan  #: from where it changes nothing; the reciprocal of a rate limit
    beside: float = math.nan  #: statistic once the strongest extension is there; NaN for the strongest itself
    rivals: tuple[str, ...] = ()  #: extensions that the data hardly distinguish from it
    #: parameters that would move most, in their standard errors
    moves: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True)
class ExtensionTests:
    """Score tests of the catalogue; `found` are the significant ones, the strongest first.

    `unresolved` are fixed numbers of the vehicle file that the data know too badly to contradict: what is wrong with them goes
    into the estimates unseen.
    """

    tested: int = 0  #: extensions that the data distinguish from the model; 0 where nothing was tested
    level: float = math.nan  #: of all tests together
    found: tuple[ExtensionTest, ...] = ()
    unresolved: tuple[str, ...] = ()

    @property
    def standing(self) -> tuple[ExtensionTest, ...]:
        """The strongest, and those that stay significant once it is there."""
        chances = (self.tested * math.erfc(abs(t.beside) / math.sqrt(2.0)) for t in self.found[1:])
        pairs = zip(self.found[1:], chances, strict=True)
        return self.found[:1] + tuple(test for test, chance in pairs if chance < self.level)


@dataclass(frozen=True)
class ResponseMisfit:
    """Part of the response of a rate to an input that a model does not explain."""

    input: str  #: control, or axis that rotors command
    output: str
    low: float  #: rad/s; the frequencies at which the response of the flights is known
    high: float
    coherence: float  #: mean partial coherence there
    #: rms magnitude of the response of the residuals, random error taken off, over that of the flights
    share: float
    #: likewise, with the largest random error of about forty taken off
    least: float
