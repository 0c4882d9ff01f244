"""Records of the decisions that a fit took by itself, as `result.json` holds them."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable
from dataclasses import dataclass
from typing import Literal, TypeAlias

from stoop.base.notices import Notice, paragraph

State: TypeAlias = Literal["applied", "not needed", "off"]


@dataclass(frozen=True)
class DecisionRecord:
    """One decision of a fit: what it found, what it did, what that gained, and what it cost."""

    #: by which it is switched off, such as ``"noise-shape"``
    name: str
    state: State = "not needed"
    #: empty where it does not apply
    found: str = ""
    done: str = ""
    #: rise of the log-likelihood; NaN where no fit without the decision is known
    gained: float = math.nan
    #: rise of the log-likelihood of held-back windows under their prediction; NaN where it is not known
    held_back: float = math.nan
    #: s, of the decision and of the fits that it asked for
    seconds: float = 0.0

    @property
    def line(self) -> str:
        """The decision on one line."""
        if self.state != "applied":
            return f"{self.name}: {self.state}"
        known = ((self.gained, ""), (self.held_back, " held back"))
        gains = [f"log-likelihood {value:+.1f}{where}" for value, where in known if math.isfinite(value)]
        spent = [f"{self.seconds:.1f} s"] * (self.seconds >= 0.05)
        return ", ".join([f"{self.name}: {self.done}", *gains, *spent])


def applied(name: str, found: Collection[Notice], done: str) -> tuple[DecisionRecord, ...]:
    """Return the record of a decision by notices of what was found; none without any."""
    return (DecisionRecord(name, "applied", paragraph(found), done),) if found else ()


def switched_off(decisions: Iterable[DecisionRecord], name: str) -> bool:
    """Return whether a decision was switched off."""
    return any(one.name == name and one.state == "off" for one in decisions)


def decision_lines(decisions: Iterable[DecisionRecord]) -> list[str]:
    """Return one line for each decision that applied, and one for those that were switched off or not needed."""
    known = list(decisions)
    off = [one.name for one in known if one.state == "off"]
    idle = sum(one.state == "not needed" for one in known)
    rest = [f"off: {', '.join(off)}"] * bool(off)
    rest += [f"looked at and not needed: {idle} of {len(known)}"] * bool(idle)
    return [one.line for one in known if one.state == "applied"] + ["; ".join(rest)] * bool(rest)
