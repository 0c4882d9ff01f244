"""Uncertainty of the estimates: intervals by method, identifiability, and repeatability over maneuvers.

These are parts of the result (``docs/result-schema.md``); `stoop.assessment` computes them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Final

from stoop.base.notices import AS_PARAGRAPH, AS_SENTENCES, AS_TEXT, Notice, notice

NAN: Final = math.nan
SCATTER_LEVEL: Final = 0.05  #: chance of calling a scatter too large that is not
MANY: Final = 20  #: parameters compared, from which some scatter by chance
#: components of the covariance, in the order of their sum, with what each is
COMPONENTS: Final[Mapping[str, str]] = {
    "noise": "measurement noise as if it were white (Cramer-Rao)",
    "color": "correlated residuals and the curvature of the cost (Morelli and Klein 1997; White 1982)",
    "windows": "scatter between windows that begin anew (Newey and West 1987; Bell and McCaffrey 2002)",
    "maneuvers": "disagreement of maneuvers or flights (Bell and McCaffrey 2002; Smyth 2004)",
    "held": "moments of inertia that are held (Tapley, Schutz and Born 2004)",
    "model": "what the model lacks, by score tests and by two weightings (MacKay 1992; Hausman 1978)",
}


@dataclass(frozen=True, eq=False)
class Components:
    """What each component adds to the variances of the parameters; they add up to the squares of the standard errors."""

    #: by component of `COMPONENTS`, then by parameter; square of the parameter's unit
    variances: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    left_out: tuple[str, ...] = ()  #: components that were switched off

    def shares(self, name: str) -> dict[str, float]:
        """Return the share of each component in the variance of a parameter; empty without a finite variance."""
        parts = {component: own[name] for component, own in self.variances.items() if name in own}
        total = math.fsum(parts.values())
        return {c: v / total for c, v in parts.items()} if math.isfinite(total) and total > 0.0 else {}

    def __str__(self) -> str:
        """Return the standard error of each parameter and the shares of its variance, %, one line each."""
        names = list(dict.fromkeys(name for own in self.variances.values() for name in own))
        wide = max([len("parameter"), *map(len, names)])
        lines = [f"{'parameter':{wide}} {'std_error':>11}" + "".join(f"{c:>11}" for c in self.variances)]
        for name in names:
            total, shares = math.fsum(own[name] for own in self.variances.values()), self.shares(name)
            cells = (f"{100.0 * shares[c]:10.1f}%" if shares else "-".rjust(11) for c in self.variances)
            lines.append(f"{name:{wide}} {math.sqrt(max(total, 0.0)):11.4g}{''.join(cells)}")
        return "\n".join([*lines, *([f"left out: {', '.join(self.left_out)}"] if self.left_out else [])])


@dataclass(frozen=True)
class Interval:
    """Standard error and 95 % interval of one parameter by one method."""

    std_error: float = NAN  #: the parameter's unit; NaN when the method gives none
    #: the parameter's unit; ends of the 95 % interval; NaN for an end that the data leave open
    ci95_lower: float = NAN
    ci95_upper: float = NAN


@dataclass(frozen=True)
class MethodIntervals:
    """Intervals of the parameters by one method."""

    #: of every parameter; above it a posterior says nothing yet (Vehtari et al. 2021)
    MAX_RHAT: ClassVar = 1.01
    parameters: Mapping[str, Interval]
    #: statistics of the method itself: replicates, convergence
    figures: Mapping[str, float] = field(default_factory=dict)
    notes: tuple[Notice, ...] = field(default=(), metadata=AS_SENTENCES)


@dataclass(frozen=True)
class ParameterIdentifiability:
    """Identifiability of one parameter."""

    #: the parameter's unit; standard error with all other unknowns fixed, and with all of them free; NaN where the data do
    #: not determine it
    conditional_std: float
    marginal_std: float
    multiple_correlation: float  #: with all other unknowns; 1 where they replace the parameter exactly
    #: parameters that it is most correlated with, then those of the near-null directions that contain it
    partners: tuple[str, ...] = ()
    doubt: Notice | None = field(default=None, metadata=AS_TEXT)  #: why the estimate is doubtful
    #: the maneuver that would make the parameter identifiable; empty where there is no doubt
    advice: tuple[Notice, ...] = field(default=(), metadata=AS_PARAGRAPH)


@dataclass(frozen=True)
class CorrelatedPair:
    """Two highly correlated parameters."""

    first: str
    second: str
    correlation: float


@dataclass(frozen=True)
class NearNullDirection:
    """A direction in the parameter space along which the data hardly change."""

    #: of the sensitivities with columns scaled to length 1; 0 for a direction without any effect on the data
    singular_value: float
    #: change of each parameter, in its unit, for which the cost rises by 1, or one of them has doubled; small ones left out
    changes: Mapping[str, float]
    words: Notice | None = field(default=None, metadata=AS_TEXT)  #: the direction in one sentence


@dataclass(frozen=True)
class IdentifiabilityAnalysis:
    """Identifiability of all parameters from the data that were fitted."""

    #: of the sensitivities to the parameters, initial states and biases left free, with columns scaled to length 1;
    #: descending
    singular_values: tuple[float, ...] = ()
    parameters: Mapping[str, ParameterIdentifiability] = field(default_factory=dict)
    pairs: tuple[CorrelatedPair, ...] = ()  #: the most correlated first
    directions: tuple[NearNullDirection, ...] = ()  #: the least singular value first


@dataclass(frozen=True)
class SingleEstimate:
    """One parameter from one maneuver alone; `counted` where it is identifiable from that maneuver."""

    estimate: float
    std_error: float
    counted: bool


@dataclass(frozen=True)
class ParameterRepeatability:
    """Whether the maneuvers agree on one parameter."""

    singles: tuple[SingleEstimate, ...]  #: one for each of `Repeatability.maneuvers`
    mean: float = NAN  #: the parameter's unit; weighted mean of what is counted, and its standard error
    std_error: float = NAN
    chi_square: float = NAN  #: of the deviations from the mean, in standard errors
    degrees: int = 0  #: of freedom: maneuvers counted, less one
    p_value: float = NAN  #: chance of a scatter as large if the error bars are right
    #: ``"agree"``, ``"scatter"`` (more than the error bars explain, at 5 %), or empty where there are not two
    verdict: str = ""


@dataclass(frozen=True)
class JointTest:
    """Whether all compared parameters agree at once, with their covariance."""

    chi_square: float = NAN
    degrees: int = 0
    p_value: float = NAN

    def __str__(self) -> str:
        """Return the test in one line."""
        verdict = "agree" if self.p_value >= SCATTER_LEVEL else "differ by more than their error bars explain"
        return f"jointly they {verdict}: chi-square {self.chi_square:.1f} of {self.degrees} degrees, p = {self.p_value:.2g}"


@dataclass(frozen=True)
class Repeatability:
    """Each maneuver fitted alone, beside the joint fit; `maneuvers` are places in `Result.maneuvers`."""

    maneuvers: tuple[int, ...] = ()
    parameters: Mapping[str, ParameterRepeatability] = field(default_factory=dict)
    remarks: tuple[Notice, ...] = field(default=(), metadata=AS_SENTENCES)
    joint: JointTest = JointTest()  #: of results that were fitted apart; not of the maneuvers of one

    def summary(self) -> Notice:
        """Return how many parameters can be compared, and how far they scatter."""
        compared = [one for one in self.parameters.values() if one.verdict]
        if not compared:
            return notice("repeatability-nothing-compared")
        code = "repeatability" if len(compared) < MANY else "repeatability-of-many"
        found, chance = sum(one.verdict == "scatter" for one in compared), SCATTER_LEVEL * len(compared)
        return notice(code, compared=len(compared), scatter=found, by_chance=chance, ratio=self.scatter_ratio)

    @property
    def share_agreeing(self) -> float:
        """Share of the compared parameters whose scatter 95 % error bars explain; NaN where nothing is compared."""
        verdicts = [one.verdict for one in self.parameters.values() if one.verdict]
        return verdicts.count("agree") / len(verdicts) if verdicts else NAN

    @property
    def scatter_ratio(self) -> float:
        """Scatter of the maneuvers over their error bars, over all parameters; NaN where nothing is compared."""
        compared = [one for one in self.parameters.values() if one.verdict]
        degrees = sum(one.degrees for one in compared)
        square = sum(one.chi_square for one in compared)
        return math.sqrt(square / degrees) if degrees > 0 and square >= 0.0 else NAN
