"""The table of the targets of ``stoop export``, which command line, Python, app and documentation read.

A new target is a module with a subclass of `stoop.exporters.exporter.Exporter`, a row here, and its row in ``docs/export.md``.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final

from stoop.base.text import nearest
from stoop.errors import StoopError

if TYPE_CHECKING:
    from stoop.exporters.exporter import Condition, Exported, Exporter, ModelData


@dataclass(frozen=True)
class Target:
    """A row of the table.

    Attributes
    ----------
    title : the tool, as the app and the documentation name it
    module : of the exporter, below ``stoop.exporters``; imported when the target is chosen
    name : of the exporter's class in the module
    """

    title: str
    module: str
    name: str

    def exporter(self) -> type[Exporter]:
        """Return the class of the exporter."""
        found: type[Exporter] = getattr(importlib.import_module(f"stoop.exporters.{self.module}"), self.name)
        return found


TARGETS: Final = {
    "jsbsim": Target("JSBSim", "jsbsim", "JSBSim"),
    "ardupilot-jsbsim": Target("ArduPilot in the loop with JSBSim", "sitl_targets", "ArduPilotJSBSim"),
    "px4-jsbsim": Target("PX4 in the loop with JSBSim", "sitl_targets", "PX4JSBSim"),
    "state-space": Target("state space (A, B, C, D)", "matlab_targets", "StateSpaceFiles"),
    "simulink": Target("Simulink", "matlab_targets", "Simulink"),
    "fmu": Target("FMI", "fmu_target", "FMU"),
    "rotorpy": Target("RotorPy", "rotorpy_target", "RotorPy"),
    "gazebo": Target("Gazebo", "gazebo", "Gazebo"),
}


def export(model: ModelData, target: str, condition: Condition | None = None) -> Exported:
    """Make the files of a target.

    Raises
    ------
    StoopError
        There is no such target, the model cannot be exported so, or no steady flight is found.
    """
    if target not in TARGETS:
        raise StoopError(f"there is no target {target!r} of an export; {nearest(target, TARGETS)}")
    exporter = TARGETS[target].exporter()
    return (exporter(model) if condition is None else exporter(model, condition)).export()
