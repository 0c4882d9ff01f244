"""Target ``gazebo``: models for PX4 and ArduPilot in Gazebo, flown by the equations of its systems."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cached_property, partial

from stoop.exporters import gazebo_autopilots, gazebo_files, rotorpy_flight
from stoop.exporters.exporter import (
    Exported,
    Exporter,
    ModelData,
    actuator_numbers,
    agreement,
    along_reference,
    cost_without_actuators,
    encoded,
)
from stoop.exporters.gazebo_flight import flown_alphas, fly_gazebo
from stoop.exporters.gazebo_model import GazeboModel, gazebo_model, unsupported_rotor_numbers
from stoop.exporters.gazebo_wing import unsupported_wing_terms
from stoop.exporters.reference_flight import ReferenceFlight
from stoop.simulation import Trim
from stoop.vehicle import Vehicle


class Gazebo(Exporter):
    """Models with all six degrees of freedom, whatever the fit had."""

    @cached_property
    def full(self) -> ModelData:
        """The model with the equations of all six degrees of freedom."""
        vehicle = self.model.vehicle
        return (
            self.model if vehicle.reduce == "full" else replace(self.model, vehicle=vehicle.reduced("full"))
        )

    @property
    def vehicle(self) -> Vehicle:
        """The vehicle with all six degrees of freedom."""
        return self.full.vehicle

    @cached_property
    def point(self) -> Trim:
        """The steady flight of the condition."""
        return self.full.trim(self.condition)

    @cached_property
    def models(self) -> dict[str, GazeboModel]:
        """The model for each autopilot."""
        alphas = flown_alphas(self.model.maneuvers)
        return {
            title: gazebo_model(self.vehicle, self.point, alphas, title == "ArduPilot")
            for title in ("PX4", "ArduPilot")
        }

    def files(self) -> Exported:
        """Return the models with their worlds and the files of the autopilots."""
        px4, ardupilot, reduced = self.models["PX4"], self.models["ArduPilot"], self.model.vehicle.reduce
        notes = [*self.model.unidentified]
        if reduced != "full":
            notes.append(
                f"The equations of the fit are {reduced}; the models have all six degrees of freedom, the others with the "
                "numbers of the vehicle file."
            )
        notes += gazebo_autopilots.notes(ardupilot)
        return Exported(encoded(gazebo_files.folders(px4, ardupilot)), f"{px4.name}/model.sdf", tuple(notes))

    def lacks(self) -> list[str]:
        """Return dead zones, rate limits and delays, and what they make."""
        actuators = actuator_numbers(self.vehicle)
        note = f"Not exported: {', '.join(actuators)}."
        return [note, *cost_without_actuators(self.full)] if actuators else []

    def fly(self, made: Exported) -> Exported:
        """Fly hover and cruise by the equations of Gazebo's systems, and return what these leave out."""
        px4 = self.models["PX4"]
        starts = ((px4.hover, unsupported_rotor_numbers), (px4.cruise, unsupported_wing_terms))
        for start, unsupported in starts:
            if start is not None:
                compare = partial(self._compared, unsupported)
                made = made.with_notes(along_reference(self.vehicle, start, compare))
        return made

    def _compared(
        self, unsupported: Callable[[Vehicle], Mapping[str, float]], flight: ReferenceFlight
    ) -> list[str]:
        notes = [
            f"Gazebo omits {name} or keeps only its slope at the steady flight; the term is {100.0 * share:.2g} % of "
            f"{channel} (rms over the compared flight)."
            for name, (share, channel) in rotorpy_flight.costs(flight, unsupported(self.vehicle)).items()
        ]
        ours = rotorpy_flight.motion(flight)
        for title, model in self.models.items():
            found = rotorpy_flight.differences(ours, fly_gazebo(model, flight))
            notes.append(f"Gazebo's equations for {title}, {agreement(flight, found)}.")
        return notes
