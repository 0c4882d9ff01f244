"""A maneuver flown by stoop's simulation and by JSBSim, channel by channel."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from stoop.base.arrays import FloatArray
from stoop.exporters.jsbsim_aircraft import PLANET
from stoop.exporters.jsbsim_flight import frames_per_sample, jsbsim_readings
from stoop.exporters.record import Record, file_name, own_readings, relative_differences


@dataclass(frozen=True, eq=False)
class RecordedManeuver:
    """A stretch of flight.

    Attributes
    ----------
    title : str
    record : Record
        Vehicle, start and inputs.
    measured : (n, n_y), optional
        Readings of the instruments, NaN where there is none.
    loaded : bool
        Whether it flew with numbers of a loading in place of the vehicle file's own.
    """

    title: str
    record: Record
    measured: FloatArray | None = None
    loaded: bool = False


@dataclass(frozen=True, eq=False)
class Comparison:
    """One maneuver, flown by our simulation and by JSBSim.

    Attributes
    ----------
    maneuver : RecordedManeuver
    own, fine : (n, n_y)
        Our simulation: a step per sample, and a step per frame of JSBSim.
    flat, earth : (n, n_y)
        JSBSim on the flat planet and on its Earth.
    """

    maneuver: RecordedManeuver
    own: FloatArray
    fine: FloatArray
    flat: FloatArray
    earth: FloatArray

    @property
    def relative(self) -> dict[str, float]:
        """Largest difference of each channel over its largest magnitude, JSBSim against our simulation."""
        return relative_differences(self.maneuver.record.vehicle, self.own, self.flat)

    def __str__(self) -> str:
        """Return the largest difference of all channels as a sentence."""
        channel, largest = max(self.relative.items(), key=lambda item: item[1])
        title = self.maneuver.title
        return f"{title}: JSBSim within {largest:.1e} of each channel's maximum (largest in {channel})."


def compare(root: Path, maneuver: RecordedManeuver) -> Comparison:
    """Fly a maneuver by our equations and in JSBSim, whose root folder holds the exported aircraft.

    Raises
    ------
    StoopError
        The flight diverges, or JSBSim is not there.
    """
    record = maneuver.record
    name = file_name(record.vehicle.name)
    return Comparison(
        maneuver,
        own_readings(record),
        own_readings(record, frames_per_sample(record.dt)),
        jsbsim_readings(root, name, record, root / PLANET),
        jsbsim_readings(root, name, record, None),
    )
