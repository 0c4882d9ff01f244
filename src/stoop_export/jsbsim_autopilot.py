"""A maneuver flown in JSBSim under an autopilot that holds the attitude, as a flight test flies it.

The autopilot is the usual one of small airplanes: wings level and pitch of the trim by proportional feedback, rates by damping,
no feedback of the flow. It knows the aircraft only by the model that it was designed for. The maneuver is added to its
commands, so the surfaces move by both.
"""

from __future__ import annotations

import tempfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stoop import Flight, Vehicle, trim
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError
from stoop.extend.files import write_files
from stoop.extend.flights import from_columns
from stoop.extend.motion import Maneuver, Trim
from stoop.extend.notices import notice
from stoop_export import jsbsim_aircraft
from stoop_export.jsbsim_flight import PLANET, READ, Record, begin, file_name, instruments, maneuver_record

BANDWIDTH: Final = 1.0  #: rad/s, of the attitude that is held
DAMPING: Final = 0.5  #: of 2 times the bandwidth, in the feedback of the rate
ANGLES: Final = ("phi", "theta")  #: that are held
RATES: Final = ("p", "q", "r")  #: that are damped


@dataclass(frozen=True, eq=False)
class AttitudeHold:
    """Deflections that hold the attitude of a steady flight: gain (n_c, n_s) times the changes of ``states`` from it."""

    controls: tuple[str, ...]
    states: tuple[str, ...]
    gain: FloatArray
    point: Trim

    @classmethod
    def of(cls, vehicle: Vehicle, point: Trim, bandwidth: float = BANDWIDTH) -> AttitudeHold:
        """Design it for a model: the wanted angular accelerations by the smallest deflections that give them there."""
        states = (*ANGLES, *RATES)
        wanted = np.zeros((3, len(states)))
        wanted[[0, 1], [0, 1]] = -(bandwidth**2)
        wanted[:, len(ANGLES) :] = -2.0 * DAMPING * bandwidth * np.eye(3)
        effect = np.column_stack([point.surface_moments(vehicle, c) for c in vehicle.controls])
        return cls(tuple(vehicle.controls), states, np.linalg.pinv(effect) @ wanted, point)

    def deflections(self, state: Mapping[str, float]) -> FloatArray:
        """Return the changes (n_c,) of the controls, rad."""
        return np.asarray(
            self.gain @ np.array([state[s] - self.point.start.get(s, 0.0) for s in self.states])
        )


def fly_in_jsbsim(
    vehicle: Vehicle,
    maneuver: Maneuver,
    model: Vehicle | None = None,
    seed: int = 0,
    noise: bool = True,
    name: str = "jsbsim",
) -> Flight:
    """Fly a maneuver in JSBSim, with the aircraft exported, under an autopilot; return what the instruments record.

    Parameters
    ----------
    vehicle : Vehicle
        The aircraft that flies, on wings.
    maneuver : Maneuver
        Added to the commands of the autopilot.
    model : Vehicle, optional
        What the autopilot was designed for; the aircraft itself when absent.
    seed : int
        Of the sensor noise.
    noise : bool
        Of the sensors, with the standard deviations of the vehicle file.
    name : str
        Of the flight.

    Raises
    ------
    StoopError
        JSBSim is not installed, the vehicle does not fly on wings, or the flight diverges.
    """
    maneuver.check(vehicle)
    point = trim(vehicle, maneuver.airspeed, maneuver.altitude)
    if not point.on_wings:
        raise SimulationError(
            f"{vehicle.where}: the autopilot in JSBSim flies on wings; give the maneuver an airspeed"
        )
    record = maneuver_record(vehicle, point, maneuver)
    known = vehicle if model is None else model
    hold = AttitudeHold.of(known, trim(known, maneuver.airspeed, maneuver.altitude))
    with tempfile.TemporaryDirectory(prefix="stoop-jsbsim-") as folder:
        root = Path(folder)
        write_files(root, jsbsim_aircraft.folder(vehicle, None))
        flown = _fly(root, vehicle, record, hold, point)
    readings = instruments(record.vehicle)(flown, record.dt)
    sigma = np.array([getattr(vehicle.file.sensors, c).sigma for c in vehicle.outputs]) * float(noise)
    readings = readings + sigma * np.random.default_rng(seed).standard_normal(readings.shape)
    columns = dict(zip(vehicle.outputs, readings.T, strict=True))
    columns |= {c: record.inputs[:, vehicle.inputs.index(c)] for c in vehicle.recorded}
    columns["altitude"] = flown["h"]
    return from_columns(name, record.time, columns, source="JSBSim", notices=(notice("simulated", name),))


def _fly(
    root: Path, vehicle: Vehicle, record: Record, hold: AttitudeHold, point: Trim
) -> dict[str, FloatArray]:
    """Fly a record, to whose inputs those of the autopilot are added; they answer the sample before."""
    simulation = begin(root, file_name(vehicle.name), record, root / PLANET)
    places = [i for i, n in enumerate(vehicle.inputs) if n != "none"]
    rows = [simulation.read()]
    mixing = np.array(
        [point.inputs_about(vehicle, {c: np.ones(1)}, 1)[0] - point.inputs for c in hold.controls]
    )
    for k in range(1, len(record.time)):
        record.inputs[k] += hold.deflections(rows[-1]) @ mixing
        simulation.advance(record.inputs[k - 1, places], record.inputs[k, places])
        rows.append(simulation.read())
        if not np.isfinite([*rows[-1].values()]).all():
            raise SimulationError(
                f"{vehicle.where}: diverges in JSBSim at {record.time[k]:.2f} s; lower the amplitude"
            )
    return {n: np.array([row[n] for row in rows]) for n in READ}
