"""Target ``jsbsim``: the aircraft for JSBSim, a start, a script, and the page of how it flies."""

from __future__ import annotations

import importlib.util
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Final

from stoop.base.files import write_files
from stoop.base.variables import VARIABLES
from stoop.errors import SimulationError
from stoop.exporters import jsbsim_aircraft
from stoop.exporters.exporter import Exported, Exporter, encoded
from stoop.exporters.jsbsim_flight import Comparison, compare, file_name
from stoop.exporters.jsbsim_model import THRUST, channel
from stoop.exporters.jsbsim_page import EXPORT_PAGE, export_page
from stoop.exporters.reference_flight import reference_record, steady_start, with_restarts
from stoop.simulation import Trim

NOT_FLOWN: Final = "Not flown: the package jsbsim is not installed; pip install 'stoop[jsbsim]'."
SLOPES: Final = (
    "The reaction of rotors without a lag to their spin-up is computed from the last step of JSBSim, so it is a step late "
    "({}); give rotors.lag to have it exactly."
)


def installed() -> bool:
    """Return whether JSBSim is there."""
    return importlib.util.find_spec("jsbsim") is not None


@contextmanager
def written(texts: Mapping[str, str]) -> Iterator[Path]:
    """Give a temporary folder with files, in which JSBSim flies them before they are written where the user wants them."""
    with tempfile.TemporaryDirectory(prefix="stoop-export-") as root:
        write_files(Path(root), texts)
        yield Path(root)


class JSBSim(Exporter):
    """The aircraft, and the page of how it flies; without a steady flight there is no start to give."""

    @cached_property
    def start(self) -> Trim | str:
        """The steady flight, or why there is none."""
        try:
            return self.point
        except SimulationError as error:
            return f"No start and no script: {error}."

    @cached_property
    def texts(self) -> dict[str, str]:
        """The files by place."""
        start = None if isinstance(self.start, str) else steady_start(self.vehicle, self.start)
        return jsbsim_aircraft.folder(self.vehicle, start)

    @property
    def aircraft(self) -> str:
        """Place of the aircraft file."""
        name = file_name(self.vehicle.name)
        return f"aircraft/{name}/{name}.xml"

    def files(self) -> Exported:
        """Return the files, and which properties drive the aircraft."""
        vehicle = self.vehicle
        driving = {channel(n): VARIABLES[n].unit if n in VARIABLES else "1" for n in vehicle.recorded}
        if vehicle.file.propulsion is not None and vehicle.file.propulsion.kind == "constant":
            driving[THRUST] = "N"
        named = [place if unit == "1" else f"{place} ({unit})" for place, unit in driving.items()]
        notes = (f"To be set in flight: {', '.join(named)}.",) if named else ()
        return Exported(encoded(self.texts), self.aircraft, notes)

    def lacks(self) -> list[str]:
        """Return that JSBSim has no slopes of the channels."""
        return [SLOPES.format(", ".join(self.vehicle.sloped))] if self.vehicle.sloped else []

    def fly(self, made: Exported) -> Exported:
        """Fly the steady flight and the maneuvers, and add their page."""
        missing = [self.start] if isinstance(self.start, str) else []
        if not installed():
            return made.with_notes([*missing, NOT_FLOWN])
        maneuvers = [with_restarts(maneuver) for maneuver in self.model.maneuvers]
        record = None if isinstance(self.start, str) else reference_record(self.vehicle, self.start)
        if record is not None:
            maneuvers.insert(0, record)
        flown: list[Comparison] = []
        for maneuver in maneuvers:  # another loading is exported with its maneuver
            texts = jsbsim_aircraft.folder(maneuver.vehicle, None) if maneuver.loaded else self.texts
            with written(texts) as root:
                try:
                    flown.append(compare(root, maneuver))
                except SimulationError as error:  # the model cannot hold it open loop; the others are flown
                    missing.append(f"{maneuver.title}: {error}.")
        made = made.with_notes(missing)
        name = file_name(self.vehicle.name)
        page = export_page(self.vehicle, self.texts[self.aircraft], name, flown, made.notes)
        files = {**made.files, **encoded({EXPORT_PAGE: page})}
        return replace(made, files=files, main=EXPORT_PAGE).with_notes(map(str, flown))
