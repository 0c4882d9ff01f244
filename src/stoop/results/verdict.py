"""The verdict on a result: a grade, what the model may be used for, and why; `stoop.assessment.verdict` makes it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, TypeAlias

from stoop.base.notices import Notice, notice, of_severity

Grade: TypeAlias = Literal["", "trusted", "usable", "do not use"]


@dataclass(frozen=True)
class Need:
    """What a use must know: the largest of some free parameters, such as the effect of the controls about one axis."""

    subject: str
    parameters: tuple[str, ...]
    #: value of each at which its effect in the fitted maneuvers would be the largest on its axis, SI; empty where not known
    sizes: tuple[float, ...] = ()


@dataclass(frozen=True)
class Use:
    """One use of a model: what it needs, whether it is justified, and what speaks against it."""

    name: str  #: "control design", "simulation" or "performance"
    channels: tuple[str, ...]  #: that must be predicted
    needs: tuple[Need, ...] = ()  #: empty for the simulation, which is judged by its predictions
    justified: bool = False
    against: tuple[Notice, ...] = ()


@dataclass(frozen=True)
class Verdict:
    """Whether to use a model, and for what; the grade is empty where none was made."""

    grade: Grade = ""
    uses: tuple[Use, ...] = ()
    reasons: tuple[
        Notice, ...
    ] = ()  #: warnings, the gravest first, then (information) what speaks for the model
    advice: tuple[Notice, ...] = ()  #: flights that would settle what is open

    @property
    def justified(self) -> tuple[str, ...]:
        """Names of the uses that are justified."""
        return tuple(use.name for use in self.uses if use.justified)

    @property
    def against(self) -> tuple[Notice, ...]:
        """What speaks against the model, the gravest first."""
        return of_severity(self.reasons, "warning")

    @property
    def headline(self) -> Notice:
        """The verdict in one line."""
        others = tuple(use.name for use in self.uses if not use.justified)
        if self.grade == "do not use":
            return notice("verdict-refused")
        code = "verdict-trusted" if self.grade == "trusted" else "verdict-usable"
        uses = self.justified or ("what was fitted",)  # of a file without uses
        return notice(code + ("-in-part" if others else ""), uses=uses, others=others)
