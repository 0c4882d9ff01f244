"""A vehicle file as it is written: tables and entries, each with a comment of what it is, where it is from, how sure."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from stoop.base.toml import quoted, quoted_key
from stoop.errors import one_line
from stoop.vehicle_draft.apriori import Apriori

MEANINGS: Final[Mapping[str, str]] = {
    "CL0": "lift at V* and alpha*", "CLalpha": "lift slope", "CLq": "lift by pitch rate", "CLV": "by airspeed",
    "CLelevator": "lift of the elevator",
    "CD0": "drag at V* and alpha*", "CDalpha": "slope of the drag", "CDalpha2": "its curvature", "CDV": "by airspeed",
    "CQ0": "asymmetry", "CQbeta": "side force by sideslip", "CQp": "by roll rate", "CQr": "by yaw rate",
    "CQrudder": "side force of the rudder", "CQV": "by airspeed",
    "Cl0": "asymmetry", "Clbeta": "dihedral effect", "Clp": "roll damping", "Clr": "roll by yaw rate",
    "Claileron": "roll of the ailerons", "Clrudder": "roll of the rudder",
    "Cm0": "pitching moment at V* and alpha*", "Cmalpha": "static stability in pitch", "Cmq": "pitch damping",
    "CmV": "by airspeed", "Cmelevator": "pitch of the elevator",
    "Cn0": "asymmetry", "Cnbeta": "directional stability", "Cnp": "yaw by roll rate", "Cnr": "yaw damping",
    "Cnaileron": "adverse yaw", "Cnrudder": "yaw of the rudder",
}  # fmt: skip  #: of the terms of eq. (1)


def plain(value: float) -> str:
    """Return a number with four digits, as TOML writes it."""
    text = f"{value + 0.0:.4g}"
    return text if any(c in text for c in ".e") else f"{text}.0"


def quantity(value: float, prior: float) -> str:
    """Return a number with its prior as a vehicle file has it."""
    return f"{{ value = {plain(value)}, prior = {plain(float(f'{prior:.2g}'))} }}"


def known(one: Apriori) -> str:
    """Return a number with its prior."""
    return quantity(one.value, one.std)


def mixture(gains: Mapping[str, float]) -> str:
    """Return channels and numbers as an inline table."""
    return "{ " + ", ".join(f"{quoted_key(name)} = {plain(gain)}" for name, gain in gains.items()) + " }"


def point(parts: Sequence[str]) -> str:
    """Return three numbers as a list."""
    return f"[{', '.join(parts)}]"


@dataclass
class Sheet:
    """Lines of a file."""

    lines: list[str] = field(default_factory=list)

    def remark(self, *texts: str) -> None:
        """Add comments on lines of their own."""
        self.lines += [f"# {one_line(text)}" for text in texts]

    def table(self, name: str, comment: str = "") -> None:
        """Begin a table."""
        tail = f" # {one_line(comment)}" if comment else ""
        self.lines += ["", f"[{name}]{tail}"]

    def entry(self, key: str, value: str, comment: str = "") -> None:
        """Add a number or a list that is written as TOML."""
        tail = f" # {one_line(comment)}" if comment else ""
        self.lines.append(f"{key} = {value}{tail}")

    def word(self, key: str, value: str, comment: str = "") -> None:
        """Add a text."""
        self.entry(key, quoted(value), comment)

    def text(self) -> str:
        """Return the file."""
        return "\n".join([*self.lines, ""])
