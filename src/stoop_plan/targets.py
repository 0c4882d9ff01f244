"""Who flies a designed maneuver: the table of ``stoop design --for``, which command line, Python, app and documentation read.

A new row has a `stoop_plan.injection.Target` in `stoop_plan.injection_targets`, and its row in ``docs/fly-the-maneuver.md``.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from stoop.extend.errors import StoopError
from stoop.extend.text import nearest

if TYPE_CHECKING:
    from stoop_plan.injection import Target


@dataclass(frozen=True)
class FlownBy:
    """A row of the table: a pilot or an autopilot, and the name of its target."""

    title: str
    name: str


FLOWN_BY: Final = {
    "pilot": FlownBy("a pilot, by hand", "PILOT"),
    "ardupilot": FlownBy("ArduPilot", "ARDUPILOT"),
    "px4": FlownBy("PX4", "PX4"),
    "crazyflie": FlownBy("Crazyflie", "CRAZYFLIE"),
}


def flown_by(target: str) -> Target:
    """Return what writes the files with which a pilot or an autopilot flies a maneuver; raises `StoopError`: no such target."""
    if not isinstance(target, str) or target not in FLOWN_BY:
        raise StoopError(
            f"there is no target {target!r} of a designed maneuver; {nearest(str(target), FLOWN_BY)}"
        )
    found: Any = getattr(importlib.import_module("stoop_plan.injection_targets"), FLOWN_BY[target].name)
    return found  # type: ignore[no-any-return]
