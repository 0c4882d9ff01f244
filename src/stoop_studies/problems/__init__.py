"""Problems with known answers: the paper's, those beside it, test functions, and recorded flights.

>>> from stoop_studies import problems
>>> problems.pose("paper-N", seed=3).parameters[:3]
('CL0', 'CLalpha', 'CLq')
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib.resources import files
from typing import Any, Final

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.errors import IdentificationError

__all__ = ["Posed", "data_text", "names", "pose", "take_none"]

#: first part of a name -> the module that poses it; imported when asked for
_FAMILIES: Final = {
    "paper": "paper", "longitudinal": "paper", "lateral": "paper", "bbob": "bbob", "flight": "flight",
    "multirotor": "multirotor", "hexacopter": "hexacopter",
}  # fmt: skip


@dataclass(frozen=True)
class Posed:
    """A problem and what is known of its answer."""

    problem: optimize.Problem
    target: float  #: a cost on the full record that counts as solved
    reference: float  #: the trivial model's cost
    truth: FloatArray | None  #: the answer in physical values, where it is known
    parameters: tuple[str, ...]
    #: from a point of the unit box, (D,), to physical values, (D,)
    values: Callable[[FloatArray], FloatArray]


def names() -> tuple[str, ...]:
    """Return the names of all problems."""
    return tuple(name for module in dict.fromkeys(_FAMILIES.values()) for name in _module(module).NAMES)


def pose(name: str, seed: int, **arguments: Any) -> Posed:
    """Pose a problem, one of `names`; the seed draws what it leaves open (box, noise, instance), most take no arguments.

    Raises
    ------
    IdentificationError
        There is none of that name, or it lacks an argument.
    """
    module = _FAMILIES.get(re.split("[-+]", name)[0])
    if module is None or name not in _module(module).NAMES:
        listed = ", ".join([*(n for n in names() if not n.startswith("bbob-")), "bbob-01 to bbob-24"])
        raise IdentificationError(f"problem {name}: there is none of that name; use one of {listed}")
    posed: Posed = _module(module).pose(name, seed, **arguments)
    return posed


def take_none(name: str, arguments: Mapping[str, object]) -> None:
    """Refuse arguments, of which a problem has none, with an `IdentificationError`."""
    if arguments:
        raise IdentificationError(f"problem {name}: knows no {', '.join(sorted(arguments))}; leave it out")


def data_text(name: str) -> str:
    """Return the text of a file beside these modules."""
    return files("stoop_studies.problems").joinpath(name).read_text(encoding="utf-8")


def _module(name: str) -> Any:
    return importlib.import_module(f"stoop_studies.problems.{name}")
