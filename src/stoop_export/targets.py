"""The table of the targets of ``stoop export``, which command line, Python, app and documentation read.

A new target is a module with a subclass of `stoop_export.exporter.Exporter`, a row here, and its row in ``docs/export.md``.
"""

from __future__ import annotations

import importlib
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from stoop.extend.errors import StoopError
from stoop.extend.text import nearest

if TYPE_CHECKING:
    from stoop_export.exporter import Condition, Exported, Exporter, ModelData


@dataclass(frozen=True)
class Target:
    """A row of the table.

    Attributes
    ----------
    title : the tool, as the app and the documentation name it
    module : of what writes its files, below ``stoop_export``; imported when the target is chosen
    name : of the exporter's class in the module
    """

    title: str
    module: str
    name: str

    def load(self) -> Any:
        """Return what writes its files."""
        return getattr(importlib.import_module(f"stoop_export.{self.module}"), self.name)


TARGETS: Final = {
    "jsbsim": Target("JSBSim", "jsbsim", "JSBSim"),
    "ardupilot-jsbsim": Target("ArduPilot in the loop with JSBSim", "sitl_folders", "ArduPilotJSBSim"),
    "px4-jsbsim": Target("PX4 in the loop with JSBSim", "sitl_folders", "PX4JSBSim"),
    "state-space": Target("state space (A, B, C, D)", "matlab", "StateSpaceFiles"),
    "simulink": Target("Simulink", "matlab", "Simulink"),
    "fmu": Target("FMI", "fmu_target", "FMU"),
    "rotorpy": Target("RotorPy", "rotorpy_flight", "RotorPy"),
    "mujoco": Target("MuJoCo", "mujoco_flight", "MuJoCo"),
    "pyflyt": Target("PyFlyt", "pyflyt", "PyFlyt"),
    "gym-pybullet-drones": Target("gym-pybullet-drones", "bullet_and_isaac", "GymPyBulletDrones"),
    "isaac": Target("Isaac Lab and Aerial Gym", "bullet_and_isaac", "Isaac"),
    "crazyflow": Target("Crazyflow and drone-models", "crazyflow", "Crazyflow"),
    "gazebo": Target("Gazebo", "gazebo", "Gazebo"),
}


def export(model: ModelData, target: str, condition: Condition | None = None) -> Exported:
    """Make the files of a target.

    Raises
    ------
    StoopError
        There is no such target, the model cannot be exported so, or no steady flight is found.
    """
    if not isinstance(target, str) or target not in TARGETS:
        raise StoopError(f"there is no target {target!r} of an export; {nearest(str(target), TARGETS)}")
    exporter: type[Exporter] = TARGETS[target].load()
    return (exporter(model) if condition is None else exporter(model, condition)).export()
