"""Target ``fmu``: Functional Mock-up Units of both versions of the interface, flown by FMPy where it is installed."""

from __future__ import annotations

import tempfile
from functools import cached_property
from pathlib import Path

from stoop.base.files import write_files
from stoop.base.notices import notice
from stoop.exporters import fmu, fmu_flight
from stoop.exporters.exporter import (
    Exported,
    Exporter,
    actuator_numbers,
    agreement,
    along_reference,
    cost_without_actuators,
)
from stoop.exporters.jsbsim_flight import file_name
from stoop.exporters.reference_flight import ReferenceFlight


class FMU(Exporter):
    """Units with the equations, for co-simulation."""

    @cached_property
    def compiler(self) -> str | None:
        """The C compiler; None where there is none."""
        return fmu.find_compiler()

    def files(self) -> Exported:
        """Return a unit of each version."""
        unit, name = (
            fmu.make_unit(self.vehicle, self.point, self.model.covariance),
            file_name(self.vehicle.name),
        )
        files = {f"{name}-fmi{v[0]}.fmu": fmu.unit_bytes(unit, v, self.compiler) for v in fmu.VERSIONS}
        return Exported(files, f"{name}-fmi3.fmu", self.model.unidentified)

    def lacks(self) -> list[str]:
        """Return dead zones, rate limits and delays, and what they make."""
        actuators = actuator_numbers(self.vehicle)
        if not actuators:
            return []
        return [
            str(notice("functions-without-actuators", numbers=actuators)),
            *cost_without_actuators(self.model),
        ]

    def fly(self, made: Exported) -> Exported:
        """Fly both units along the reference flight."""
        if self.compiler is None:
            return made.with_notes(
                ["The units hold sources only, no C compiler was found: fmpy compile NAME.fmu"]
            )
        if not fmu_flight.installed():
            return made.with_notes([f"Not flown: the package fmpy is not installed; {fmu_flight.INSTALL}."])

        def compared(flight: ReferenceFlight) -> list[str]:
            notes = []
            with tempfile.TemporaryDirectory(prefix="stoop-export-") as root:
                write_files(Path(root), made.files)
                for version, place in zip(fmu.VERSIONS, made.files, strict=True):
                    found = flight.differences(fmu_flight.fly_unit(Path(root) / place, flight))
                    notes.append(f"FMI {version} in FMPy, {agreement(flight, found)}.")
            return notes

        return made.with_notes(along_reference(self.vehicle, self.point, compared))
