"""A hexacopter, flown outdoors: ``hexacopter``, with the argument ``data``, the folder of its log.

Fourteen numbers are sought from hover, climbs and slow descents, 140 to 214 s of PX4's log 18. There is no truth: what
counts as solved is the cost at which a refinement from the vehicle file's own values ends, which no optimizer is given.

The six outputs were logged at 43 Hz, too slowly for moments (what is quicker looks slow); the moments and the thrust that
the mixer made them of at 236 Hz. So outputs are mixed anew, as PX4 does.
"""

from __future__ import annotations

import functools
from dataclasses import replace
from importlib.resources import as_file, files
from pathlib import Path
from typing import Final

import numpy as np

from stoop import optimize
from stoop.base.arrays import FloatArray
from stoop.errors import FlightError, IdentificationError
from stoop.estimate.noise import channel_residuals, effective_variance
from stoop.flight import Flight, load_flight
from stoop.optimize.ledger import Evaluations
from stoop.optimize.local_refinement import FULL
from stoop.problem import Misfit, Weights
from stoop.problem.prepare import Prepared
from stoop.problem.windows import Window
from stoop.vehicle import Vehicle, parse_vehicle
from stoop_studies.problems import Posed, data_text
from stoop_studies.problems.multirotor import motors_behind, windowed, windows

NAMES: Final = ("hexacopter",)
FOLDER: Final = "altlnt-hexacopter-px4"
SOURCE: Final = "https://github.com/altlnt/id_mod_helice (logs/copter/vol2/log_18_2019-7-26-10-48-46)"
WINDOW: Final = "140:214"
#: s, of a window; the rates of this vehicle, shaken by its rotors, are not followed for longer
LENGTH: Final = 0.25
RATE: Final = 50.0  #: Hz, of the grid
SIGMA: Final = {
    "vn": 0.3, "ve": 0.3, "vd": 0.3, "p": 0.1, "q": 0.1, "r": 0.05, "phi": 0.03, "theta": 0.03, "psi": 0.03,
    "ax": 0.3, "ay": 0.3, "az": 0.6,
}  # fmt: skip
"""First guess of what a model leaves, m/s, rad/s, rad, m/s2; Q is estimated from there."""

IDLE, SPAN = 1075.0, 875.0  #: us, and us from idle to full (authors)
_H: Final = float(np.sqrt(0.75))
#: PX4's Hexarotor x: roll, pitch, yaw of each output
MIXER: Final = np.array(
    [[-1, 0, -1], [1, 0, 1], [0.5, _H, -1], [-0.5, -_H, 1], [-0.5, _H, 1], [0.5, -_H, -1]]
)


def pose(name: str, seed: int, **arguments: object) -> Posed:
    """Pose the flight of the log in the folder ``data``, or the one below it; the seed is the search's alone.

    Raises
    ------
    IdentificationError
        An argument is missing or unknown.
    StoopError
        The log cannot be read.
    """
    if set(arguments) != {"data"}:
        raise IdentificationError(f"problem {name}: needs data, the folder of {SOURCE}, and nothing else")
    return settled(str(arguments["data"]))


@functools.cache
def settled(data: str) -> Posed:
    """Pose the problem with the Q after refinements and noise estimates from the file's own values; once in a process."""
    model, flight = vehicle(), mixed(_flight(Path(data)))
    pieces = Prepared.of(model, {flight.name: flight}, [Window.parse(WINDOW, {flight.name: flight})]).pieces
    cut = [w for p in pieces for w in windows(model, p, LENGTH, motors_behind(model, p))]
    problem = windowed(model, cut, Weights.of(np.array([SIGMA[c] for c in model.outputs]) ** 2))

    def refined(problem: Misfit, z: FloatArray) -> FloatArray:
        return optimize.refine(optimize.Ledger(problem, Evaluations.none(problem)), z, 0, FULL).z

    z = problem.layout.start
    for _ in range(5):
        z = refined(problem, z)
        problem = problem.weighted(Weights.of(effective_variance(problem, channel_residuals(problem, z))))
    z = refined(problem, z)
    return Posed(
        problem=problem,
        target=float(problem.costs(z[None], 0)[0]) * (1.0 + 1e-3),
        reference=problem.reference(0),
        truth=None,
        parameters=tuple(p.name for p in problem.layout.parameters),
        values=lambda x: problem.layout.physical(x[None, :])[0],
    )


def vehicle() -> Vehicle:
    """Return what is believed of the vehicle."""
    return parse_vehicle(data_text("hexacopter.toml"), "hexacopter.toml")


def _flight(data: Path) -> Flight:
    """Read the log; a `FlightError` where it is not there."""
    place = next((p for p in (data / FOLDER, data) if any(p.glob("*_actuator_controls_0_0.csv*"))), None)
    if place is None:
        raise FlightError(f"{data}: holds no log of the hexacopter; fetch {SOURCE} and name its folder")
    with as_file(files("stoop_studies.problems").joinpath("hexacopter_mapping.toml")) as mapping:
        return load_flight(place, mapping, RATE)


def mixed(flight: Flight) -> Flight:
    """Return the flight with outputs as PX4's mixer makes them of moments and thrust; recorded holes stay holes."""
    moments = np.array([flight.column(c) for c in ("control_roll", "control_pitch", "control_yaw")])
    level = flight.column("control_throttle") + MIXER @ moments
    pulses = np.clip(IDLE + SPAN * level, IDLE, IDLE + SPAN)
    recorded = [flight.column(f"pwm_{i}") for i in range(1, len(MIXER) + 1)]
    pulses[:, ~np.isfinite(recorded).all(axis=0)] = np.nan  # moments are held across them
    kept = {f"pwm_{i}": ("time", p, flight.data[f"pwm_{i}"].attrs) for i, p in enumerate(pulses, 1)}
    return replace(flight, data=flight.data.assign(kept))
