"""Targets ``state-space`` and ``simulink``: a linear model, and MATLAB functions with the script of a Simulink model."""

from __future__ import annotations

from functools import cached_property

from stoop.base.notices import notice
from stoop.exporters import matlab
from stoop.exporters.exporter import Exported, Exporter, actuator_numbers, encoded
from stoop.exporters.jsbsim_flight import file_name
from stoop.simulation.linearize import left_out
from stoop.vehicle.vehicle import slope_input


class LinearExporter(Exporter):
    """An export that holds the linear model about the steady flight."""

    @cached_property
    def linear(self) -> matlab.StateSpace:
        """The linear model, with standard errors."""
        return matlab.state_space(self.vehicle, self.point, self.model.covariance)

    def lacks(self) -> list[str]:
        """Return what a linear model cannot express."""
        return [str(one) for one in left_out(self.vehicle)]


class StateSpaceFiles(LinearExporter):
    """A, B, C, D as JSON and as ``.mat``."""

    def files(self) -> Exported:
        """Return both files."""
        name = file_name(self.vehicle.name)
        files = {
            f"{name}.json": matlab.json_text(self.linear).encode("utf-8"),
            f"{name}.mat": matlab.mat_bytes(matlab.variables(self.linear)),
        }
        return Exported(files, f"{name}.json")


class Simulink(LinearExporter):
    """MATLAB functions, the script that builds a Simulink model, and the numbers."""

    def files(self) -> Exported:
        """Return functions, script and numbers."""
        made = matlab.matlab(self.vehicle, self.point, self.linear)
        files = encoded(made.texts) | {f"{made.name}.mat": matlab.mat_bytes(made.variables)}
        return Exported(files, f"{made.name}_simulink.m")

    def lacks(self) -> list[str]:
        """Return what the functions and the linear model cannot express."""
        actuators, sloped = actuator_numbers(self.vehicle), tuple(map(slope_input, self.vehicle.sloped))
        notes = [notice("functions-without-actuators", numbers=actuators)] if actuators else []
        notes += [notice("slopes-of-channels", channels=sloped)] if sloped else []
        return [*map(str, notes), *super().lacks()]
