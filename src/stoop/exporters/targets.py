"""The tables of the targets of ``stoop export`` and ``stoop design``, which command line, Python, app and documentation read.

A new target is a module with a subclass of `stoop.exporters.exporter.Exporter` (or with a `stoop.exporters.injection.Target`, of
a designed maneuver), a row here, and its row in ``docs/export.md`` (or ``docs/fly-the-maneuver.md``).
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from stoop.base.text import nearest
from stoop.errors import StoopError

if TYPE_CHECKING:
    from stoop.exporters.exporter import Condition, Exported, Exporter, ModelData
    from stoop.exporters.injection import Target as Injected


@dataclass(frozen=True)
class Target:
    """A row of the table.

    Attributes
    ----------
    title : the tool, as the app and the documentation name it
    module : of what writes its files, below ``stoop.exporters``; imported when the target is chosen
    name : of the exporter's class, or of the target of a designed maneuver, in the module
    """

    title: str
    module: str
    name: str

    def load(self) -> Any:
        """Return what writes its files."""
        return getattr(importlib.import_module(f"stoop.exporters.{self.module}"), self.name)


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
FLOWN_BY: Final = {
    "pilot": Target("a pilot, by hand", "injection_targets", "PILOT"),
    "ardupilot": Target("ArduPilot", "injection_targets", "ARDUPILOT"),
    "px4": Target("PX4", "injection_targets", "PX4"),
    "crazyflie": Target("Crazyflie", "injection_targets", "CRAZYFLIE"),
}  #: who flies a designed maneuver


def flown_by(target: str) -> Injected:
    """Return what writes the files with which a pilot or an autopilot flies a maneuver; raises `StoopError`: no such target."""
    return _loaded(FLOWN_BY, target, "a designed maneuver")  # type: ignore[no-any-return]


def export(model: ModelData, target: str, condition: Condition | None = None) -> Exported:
    """Make the files of a target.

    Raises
    ------
    StoopError
        There is no such target, the model cannot be exported so, or no steady flight is found.
    """
    exporter: type[Exporter] = _loaded(TARGETS, target, "an export")
    return (exporter(model) if condition is None else exporter(model, condition)).export()


def _loaded(table: Mapping[str, Target], target: str, of: str) -> Any:
    if not isinstance(target, str) or target not in table:
        raise StoopError(f"there is no target {target!r} of {of}; {nearest(str(target), table)}")
    return table[target].load()
