"""The table of all decisions, and which of them a fit takes; packages add theirs, which enclose all others."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, Literal

from stoop.base.packages import guarded, rows
from stoop.base.text import nearest
from stoop.errors import IdentificationError
from stoop.estimate.treatment import Treatment
from stoop.results.uncertainty import COMPONENTS
from stoop.strategy.assumptions import ASSUMPTIONS
from stoop.strategy.bounds import BOUNDS
from stoop.strategy.decision import Change, Decision, Fitted, Fitter, Setup
from stoop.strategy.extensions import EXTENSIONS
from stoop.strategy.gusts import GUSTS
from stoop.strategy.inertia import hold_inertia
from stoop.strategy.instability import INSTABILITY
from stoop.strategy.method import METHOD
from stoop.strategy.sensor_delays import SENSOR_DELAYS

#: at which functions of packages decide, and what they return
POINTS: Final = {"data": Change | None, "problem": Change | None, "around": Fitted}


def drop_faults(setup: Setup) -> Change | None:
    """Return the fit in which samples of clipped and stuck sensors count as not measured."""
    flights = {name: flight.without_faults() for name, flight in setup.flights.items()}
    lost = [name for name, flight in flights.items() if flight is not setup.flights[name]]
    if not lost:
        return None
    found = f"samples at a limit or held constant in {', '.join(lost)}"
    return Change(replace(setup, flights=flights), found, "treated as not measured")


#: in the order in which they change the problem; of those around a fit each encloses the ones before it
_BUILT_IN: Final[tuple[Decision, ...]] = (
    Decision("faults", "Are samples at a limit or held constant?", data=drop_faults),
    METHOD,
    INSTABILITY,
    BOUNDS,
    GUSTS,
    ASSUMPTIONS,
    Decision(
        "recorded-motion",
        "Does the record hold the motion that a reduced model leaves out?",
        treatment="recorded_motion",
    ),
    Decision(
        "held-numbers",
        "Are there numbers that the data determine as ratios only?",
        treatment="held_numbers",
        around=hold_inertia,
    ),
    Decision(
        "stuck-channels", "Does a channel never change, or hold spikes only?", treatment="stuck_channels"
    ),
    Decision("noise-shape", "Do residuals have outliers?", treatment="noise_shape"),
    Decision("maneuver-noise", "Does the noise differ between maneuvers?", treatment="maneuver_noise"),
    Decision("noise-color", "Do residuals repeat themselves?", treatment="noise_color"),
    EXTENSIONS,
    SENSOR_DELAYS,
)


def _offered() -> list[Decision]:
    """Return the decisions of packages; their functions are imported when they are called."""
    found = list[Decision]()
    for _, name, row in rows("decisions", [one.name for one in _BUILT_IN]):
        points: dict[str, Any] = {p: guarded(row[p], POINTS[p], _undecided) for p in POINTS if p in row}
        found.append(Decision(name, row["question"], row.get("default", False), **points))
    return found


def _undecided(setup: Setup, *fitter: Fitter) -> Fitted | None:
    """Return what follows where a decision fails: the fit around which it is, or no change."""
    return fitter[0](setup) if fitter else None


DECISIONS: Final = (*_BUILT_IN, *_offered())
NAMES: Final = tuple(one.name for one in DECISIONS)
SWITCHED: Final = tuple(name for name in COMPONENTS if name != "noise")  #: components that can be left out


@dataclass(frozen=True)
class Strategy:
    """Which decisions a fit takes by itself.

    Parameters
    ----------
    names : frozenset of str
        Of `NAMES`.
    left_out : frozenset of str
        Components that the covariance does not hold, of `stoop.results.uncertainty.COMPONENTS`.

    Examples
    --------
    >>> Strategy.default().without("noise-shape", "bounds")
    >>> Strategy.textbook()
    """

    names: frozenset[str]
    left_out: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        if not isinstance(self.names, frozenset):
            raise IdentificationError(
                f"Strategy({self.names!r}): names are a frozenset; write Strategy.only('faults')"
            )
        for name in sorted(map(str, self.names - set(NAMES))):
            raise IdentificationError(f"decision '{name}': not known; {nearest(name, NAMES)}")
        for name in sorted(map(str, self.left_out - set(SWITCHED))):
            raise IdentificationError(f"component '{name}': cannot be left out; {nearest(name, SWITCHED)}")

    @classmethod
    def default(cls) -> Strategy:
        """Return the decisions that a fit takes unless they are switched off."""
        return cls(frozenset(one.name for one in DECISIONS if one.default))

    @classmethod
    def textbook(cls) -> Strategy:
        """Return no decision: output error, or the method that is named, with normal noise that is the same everywhere."""
        return cls(frozenset())

    @classmethod
    def named(cls, strategy: Strategy | Literal["default", "textbook"] | str) -> Strategy:
        """Return a strategy from itself or from its name."""
        if isinstance(strategy, Strategy):
            return strategy
        if not isinstance(strategy, str):
            raise IdentificationError(
                f"strategy {strategy!r}: give 'default', 'textbook' or such as Strategy.default().without('faults')"
            )
        known = {"default": cls.default, "textbook": cls.textbook}
        if strategy not in known:
            raise IdentificationError(f"strategy '{strategy}': not known; {nearest(strategy, known)}")
        return known[strategy]()

    def without(self, *names: str) -> Strategy:
        """Return the strategy with some decisions switched off."""
        return replace(self, names=_of(self, "without") - Strategy(frozenset(names)).names)

    def without_component(self, *names: str) -> Strategy:
        """Return the strategy with a covariance that does not hold some components."""
        _of(self, "without_component")
        return replace(self, left_out=self.left_out | set(names))

    @classmethod
    def only(cls, *names: str) -> Strategy:
        """Return the strategy with some decisions and no other."""
        return cls(frozenset(names))

    def including(self, *names: str) -> Strategy:
        """Return the strategy with some decisions switched on."""
        return replace(self, names=_of(self, "including") | set(names))

    @cached_property
    def decisions(self) -> tuple[Decision, ...]:
        """The decisions that it takes, in order."""
        return tuple(one for one in DECISIONS if one.name in self.names)

    @property
    def treatment(self) -> Treatment:
        """What an estimator may decide by itself."""
        return Treatment(**{one.treatment: one.name in self.names for one in DECISIONS if one.treatment})

    def __repr__(self) -> str:
        listed = ", ".join(one.name for one in self.decisions) or "textbook"
        without = f", without component {', '.join(sorted(self.left_out))}" if self.left_out else ""
        return f"<Strategy: {'default' if self.names == Strategy.default().names else listed}{without}>"


def _of(strategy: object, verb: str) -> frozenset[str]:
    """Return the decisions of a strategy; a method that is called on the class has a name in its place."""
    if not isinstance(strategy, Strategy):
        raise IdentificationError(
            f"Strategy.{verb}('{strategy}'): of which? write Strategy.default().{verb}('{strategy}')"
        )
    return strategy.names
