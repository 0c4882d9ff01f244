"""Target ``rotorpy``: parameters and a script with both vehicles, flown by RotorPy where it is installed."""

from __future__ import annotations

import tempfile
from pathlib import Path

from stoop.base.files import write_files
from stoop.exporters import rotorpy_flight, rotorpy_model
from stoop.exporters.exporter import (
    Exported,
    Exporter,
    actuator_numbers,
    agreement,
    along_reference,
    cost_without_actuators,
    encoded,
)
from stoop.exporters.reference_flight import ReferenceFlight


class RotorPy(Exporter):
    """A quadrotor for RotorPy: its own model, and a class with the identified equations."""

    def files(self) -> Exported:
        """Return parameters and script."""
        made = rotorpy_model.rotorpy_model(self.vehicle, self.point)
        return Exported(encoded(made.texts), f"{made.name}_rotorpy.py", self.model.unidentified)

    def lacks(self) -> list[str]:
        """Return dead zones, rate limits and delays, and what they make."""
        if not (actuators := actuator_numbers(self.vehicle)):
            return []
        note = f"RotorPy has no {', '.join(actuators)}: give it channels as rotors receive them."
        return [note, *cost_without_actuators(self.model)]

    def fly(self, made: Exported) -> Exported:
        """Fly both vehicles along the reference flight, and return what RotorPy's own model leaves out of it."""

        def compared(flight: ReferenceFlight) -> list[str]:
            left_out = rotorpy_flight.costs(flight, rotorpy_model.limits(self.vehicle))
            notes = [
                f"RotorPy's own model has no {name}: {100.0 * share:.2g} % of {channel} (rms over the compared flight)."
                for name, (share, channel) in left_out.items()
            ]
            if not rotorpy_flight.installed():
                return [
                    *notes,
                    f"Not flown: the package rotorpy is not installed; {rotorpy_flight.INSTALL}.",
                ]
            with tempfile.TemporaryDirectory(prefix="stoop-export-") as root:
                write_files(Path(root), made.files)
                module = rotorpy_flight.load_script(Path(root) / made.main)
            ours = rotorpy_flight.motion(rotorpy_flight.held_flight(flight))
            for title, stock in (("the identified equations", False), ("RotorPy's own model", True)):
                found = rotorpy_flight.differences(ours, rotorpy_flight.fly_rotorpy(module, flight, stock))
                notes.append(f"RotorPy with {title}, {agreement(flight, found)}.")
            return notes

        return made.with_notes(along_reference(self.vehicle, self.point, compared))
