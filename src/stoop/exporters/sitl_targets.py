"""Targets ``ardupilot-jsbsim`` and ``px4-jsbsim``: folders for autopilots, flown in JSBSim by the properties that they write."""

from __future__ import annotations

from abc import abstractmethod
from functools import cached_property
from pathlib import Path
from typing import ClassVar

from stoop.exporters import sitl_folders
from stoop.exporters.exporter import Exported, Exporter, encoded
from stoop.exporters.jsbsim import NOT_FLOWN, installed, written
from stoop.exporters.jsbsim_aircraft import flat_planet
from stoop.exporters.jsbsim_flight import (
    PLANET,
    Host,
    Record,
    frames_per_sample,
    jsbsim_readings,
    own_readings,
    relative_differences,
)
from stoop.exporters.reference_flight import reference_record
from stoop.exporters.sitl import AutopilotCommands, autopilot_commands


class AutopilotFolder(Exporter):
    """The folder of an autopilot: its name, the rate of its JSBSim, Hz, and whether it commands rotors."""

    title: ClassVar[str]
    rate: ClassVar[float]
    rotors: ClassVar[bool]

    @abstractmethod
    def folder(self) -> tuple[dict[str, str], str]:
        """Return the files by place, and which of them is the aircraft."""

    @cached_property
    def commands(self) -> AutopilotCommands:
        """The autopilot's commands to the vehicle."""
        model, condition = self.model, self.condition
        return autopilot_commands(
            self.vehicle, condition.airspeed, model.altitude_of(condition), model.density
        )

    @cached_property
    def made(self) -> tuple[dict[str, str], str]:
        """The files by place, and which of them is the aircraft."""
        return self.folder()

    def files(self) -> Exported:
        """Return the folder, and what was assumed."""
        notes = (*self.model.unidentified, *sitl_folders.assumptions(self.commands))
        return Exported(encoded(self.made[0]), "README.md", notes)

    def fly(self, made: Exported) -> Exported:
        """Fly on wings and on rotors, exactly and as the autopilot runs JSBSim."""
        if not installed():
            return made.with_notes([NOT_FLOWN])
        texts, aircraft = self.made
        vehicle, name = self.commands.vehicle, Path(aircraft).stem
        planet = flat_planet(vehicle.value("environment.gravity"))
        points = (self.commands.wings, self.commands.hover if self.rotors else None)
        records = [None if point is None else reference_record(vehicle, point) for point in points]
        with written({f"aircraft/{name}/{name}.xml": texts[aircraft], PLANET: planet}) as root:
            return made.with_notes(
                [self._agreement(root, name, record) for record in records if record is not None]
            )

    def _agreement(self, root: Path, name: str, record: Record) -> str:
        """Fly a record exactly and as the autopilot runs JSBSim; return how the flights agree."""
        settings = self.commands.settings
        hosts = ((root / PLANET, Host(to_commands=settings)), (None, Host(self.rate, {}, settings)))
        own = own_readings(record)
        flown = (jsbsim_readings(root, name, record, place, host) for place, host in hosts)
        exact, theirs = (max(relative_differences(record.vehicle, own, y).values()) for y in flown)
        steps = frames_per_sample(record.dt, self.rate) / record.dt
        return (
            f"{record.title}, by the properties that {self.title} writes: JSBSim within {exact:.1e} of each channel's "
            f"maximum; with {steps:g} steps per second ({self.title} takes {self.rate:g}), Euler's method for rotation and "
            f"the round Earth {theirs:.1e}."
        )


class ArduPilotJSBSim(AutopilotFolder):
    """ArduPilot's JSBSim backend."""

    title, rate, rotors = "ArduPilot", 1200.0, False

    def folder(self) -> tuple[dict[str, str], str]:
        """Return the files by place, and which of them is the aircraft."""
        return sitl_folders.ardupilot(self.commands)


class PX4JSBSim(AutopilotFolder):
    """PX4's JSBSim bridge."""

    title, rate, rotors = "PX4", 250.0, True

    def folder(self) -> tuple[dict[str, str], str]:
        """Return the files by place, and which of them is the aircraft."""
        return sitl_folders.px4(self.commands)
