"""The verdict on a result: a grade, what the model may be used for, and why; `stoop.assessment.verdict` makes it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, TypeAlias

from stoop.base.notices import Notice, notice, of_severity
from stoop.base.numbers import count
from stoop.base.text import enumerated, printable, printable_lines

Grade: TypeAlias = Literal["", "trusted", "usable", "do not use"]
MAX_NAMES: Final = 3  #: names of a list that a short sentence holds
REASONS: Final = 3  #: against a model, and for it, in a short text
CAUTIONS: Final = ("verdict-unresolved",)  #: information that is no merit


@dataclass(frozen=True)
class Need:
    """What a use must know: the largest of some free parameters, such as the effect of the controls about one axis."""

    subject: str
    parameters: tuple[str, ...]
    #: value of each at which its effect in the fitted maneuvers would be the largest on its axis, SI; empty where not known
    sizes: tuple[float, ...] = ()
    inertia: str = ""  #: free moment of inertia over which they count; empty where they count by themselves


@dataclass(frozen=True)
class Use:
    """One use of a model: what it needs, whether it is justified, and what speaks against it."""

    name: str  #: "control design", "simulation" or "performance"
    channels: tuple[str, ...]  #: that must be predicted
    needs: tuple[Need, ...] = ()  #: empty for the simulation, which is judged by its predictions
    justified: bool = False
    against: tuple[Notice, ...] = ()


@dataclass(frozen=True, repr=False)
class Verdict:
    """Whether to use a model, and for what; the grade is empty where none was made."""

    grade: Grade = ""
    uses: tuple[Use, ...] = ()
    #: warnings, the gravest first, then (information) what speaks for the model
    reasons: tuple[Notice, ...] = ()
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
    def sides(self) -> tuple[tuple[Notice, ...], tuple[Notice, ...]]:
        """Reasons against the model, cautions last, and reasons for it; see :func:`grouped`."""
        known = of_severity(self.reasons, "info")
        cautions = tuple(one for one in known if one.code in CAUTIONS)
        merits = tuple(one for one in known if one.code not in CAUTIONS)
        return grouped((*self.against, *cautions)), grouped(merits)

    @property
    def headline(self) -> Notice:
        """The verdict in one line."""
        others = tuple(use.name for use in self.uses if not use.justified)
        if self.grade == "do not use":
            return notice("verdict-refused")
        code = "verdict-trusted" if self.grade == "trusted" else "verdict-usable"
        uses = self.justified or ("what was fitted",)  # of a file without uses
        return notice(code + ("-in-part" if others else ""), uses=uses, others=others)

    def __repr__(self) -> str:
        """Return the headline and the number of reasons on one line."""
        if not self.grade:
            return "<Verdict: none was made>"
        against, merits = map(len, self.sides)
        return printable(f"<Verdict: {self.headline}; {count(against, 'reason')} against, {merits} for>")

    def __str__(self) -> str:
        """Return the headline, and the strongest reasons against the model and for it, on ten lines at most."""
        if not self.grade:
            return "verdict: none was made"
        lines = [f"verdict: {self.headline}"]
        for title, reasons in zip(("against", "for"), self.sides, strict=True):
            strongest = f", the strongest {REASONS} of {len(reasons)}" if len(reasons) > REASONS else ""
            lines += [f"{title}{strongest}:"] * bool(reasons)
            lines += [f"- {shortened(one)}" for one in reasons[:REASONS]]
        return printable_lines("\n".join(lines))


def shortened(found: Notice, most: int = MAX_NAMES) -> Notice:
    """Return a notice whose lists of names hold `most` of them, the others counted."""
    lists = {k: v for k, v in found.values.items() if isinstance(v, tuple) and isinstance((*v, "")[0], str)}
    return replace(found, values={**found.values, **{k: few_names(v, most) for k, v in lists.items()}})


def few_names(names: Sequence[object], most: int = MAX_NAMES) -> tuple[str, ...]:
    """Return names, of a long list `most` of them and the number of the others."""
    shown = tuple(map(str, names))
    return shown if len(shown) <= most + 1 else (*shown[:most], f"{len(shown) - most} more")


def grouped(reasons: Sequence[Notice]) -> tuple[Notice, ...]:
    """Return reasons with the needs of one use, and findings of one kind, in one notice each."""
    out: dict[tuple[str, ...], list[Notice]] = {}
    for found in reasons:
        kind = "verdict-needs" if found.code in _NEEDS else found.code
        key = (kind, str(found.values["use"]) if kind == "verdict-needs" else "")
        out.setdefault(key if kind in _TOGETHER else (kind, str(found)), []).append(found)
    return tuple(one for (kind, _), own in out.items() for one in _combined(kind, own))


def _combined(kind: str, own: Sequence[Notice]) -> Sequence[Notice]:
    """Return notices of one kind as one, where they are several or too long for a verdict."""
    first = own[0].values
    if kind == "contribution-in-doubt" and "variables" in first:
        return (notice("verdict-contributions", variables=first["variables"]),)
    if len(own) == 1 or kind not in _TOGETHER:
        return own
    if kind == "verdict-needs":
        return (notice(kind, use=first["use"], needs=tuple(map(_need, own))),)
    if kind == "verdict-channels":
        uses = tuple(f"{one.subject} in {_listed(one, 'channels')}" for one in own)
        return (notice("verdict-channels-of-uses", uses=uses),)
    names = tuple(f"{one.subject} (t = {one.values['statistic']:.1f})" for one in own)
    lines = "; ".join(str(one.values["line"]) for one in own)
    return (notice("verdict-lacks-several", names=names, lines=lines),)


def _listed(found: Notice, key: str) -> str:
    several = found.values[key]
    return enumerated(map(str, several)) if isinstance(several, tuple) else str(several)


def _need(found: Notice) -> str:
    """Return what a use must know, and how badly it is known."""
    if found.code == "verdict-need-unknown":
        return f"{found.subject} ({_listed(found, 'parameters')} not identifiable or at a bound)"
    names = (str(found.values[key]) for key in ("parameter", "inertia") if key in found.values)
    return f"{found.subject} ({' over '.join(names)} +- {found.values['error']:.0%})"


_NEEDS: Final = ("verdict-need-unknown", "verdict-need-inaccurate", "verdict-ratio-inaccurate")
_TOGETHER: Final = ("verdict-needs", "verdict-channels", "verdict-lacks")
