"""The table of the targets of ``stoop export``, which command line, Python, app and documentation read.

A new target is a module with a subclass of `stoop_export.exporter.Exporter`, a row here, and its row in ``docs/export.md``;
packages add theirs as rows of ``targets``, with ``title`` and ``exporter``, the place of the class.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

from stoop.extend.errors import StoopError
from stoop.extend.text import nearest
from stoop.extend.verbs import made, resolved

if TYPE_CHECKING:
    from stoop_analysis.known_model import Condition
    from stoop_export.exporter import Exported, Exporter, ModelData


@dataclass(frozen=True)
class Target:
    """A row of the table."""

    title: str  #: the tool, as the app and the documentation name it
    exporter: str  #: place ``module:class`` of what writes its files; imported when the target is chosen

    def load(self) -> Any:
        """Return what writes its files."""
        return resolved(self.exporter)


TARGETS: Final[dict[str, Target]] = {
    "jsbsim": Target("JSBSim", "stoop_export.jsbsim:JSBSim"),
    "ardupilot-jsbsim": Target(
        "ArduPilot in the loop with JSBSim", "stoop_export.sitl_folders:ArduPilotJSBSim"
    ),
    "px4-jsbsim": Target("PX4 in the loop with JSBSim", "stoop_export.sitl_folders:PX4JSBSim"),
    "state-space": Target("state space (A, B, C, D)", "stoop_export.matlab:StateSpaceFiles"),
    "simulink": Target("Simulink", "stoop_export.matlab:Simulink"),
    "fmu": Target("FMI", "stoop_export.fmu_target:FMU"),
    "rotorpy": Target("RotorPy", "stoop_export.rotorpy_flight:RotorPy"),
    "mujoco": Target("MuJoCo", "stoop_export.mujoco_flight:MuJoCo"),
    "pyflyt": Target("PyFlyt", "stoop_export.pyflyt:PyFlyt"),
    "gym-pybullet-drones": Target("gym-pybullet-drones", "stoop_export.bullet_and_isaac:GymPyBulletDrones"),
    "isaac": Target("Isaac Lab and Aerial Gym", "stoop_export.bullet_and_isaac:Isaac"),
    "crazyflow": Target("Crazyflow and drone-models", "stoop_export.crazyflow:Crazyflow"),
    "gazebo": Target("Gazebo", "stoop_export.gazebo:Gazebo"),
}
TARGETS.update(made("targets", "target", Target, TARGETS))


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
