"""The folder of an identification, read back: the vehicle with its estimates, its biases, its flights."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from stoop.assessment.baseline import BaselineManeuver
from stoop.errors import StoopError
from stoop.flight import Flight, load
from stoop.flight.flight import flight_name
from stoop.problem.prepare import prepare
from stoop.problem.windows import Window
from stoop.results.result import Result, read_result
from stoop.vehicle import Vehicle, load_vehicle
from stoop.workflow.curves import baseline_maneuver
from stoop.workflow.outputs import RESULT, file_hashes, flight_file, flight_files


@dataclass(frozen=True, eq=False)
class Identified:
    """The output folder of stoop identify."""

    folder: Path
    result: Result
    vehicle: Vehicle  #: with its free numbers at their estimates, to the last digit
    #: SHA-256 of every fitted flight, and of its copy in the folder, to the flight's name
    hashes: Mapping[str, str]

    def biases(self, flight: str | None) -> dict[str, float]:
        """Return each bias averaged over the fitted maneuvers of a flight, or of all flights if it has none."""
        fitted = self.result.maneuvers
        of_flight = [b for b in self.result.biases if fitted[b.maneuver].flight == flight]
        found: dict[str, list[float]] = {}
        for one in of_flight or self.result.biases:
            for channel, quantity in one.values.items():
                found.setdefault(f"sensors.{channel}.bias", []).append(quantity.estimate)
        return {name: float(np.mean(values)) for name, values in found.items()}

    def name_of(self, flight: Flight) -> str | None:
        """Return the name under which a flight was fitted; None for one that was not."""
        digests = file_hashes(flight_files([flight])).values()
        return next((self.hashes[d] for d in digests if d in self.hashes), None)

    def fitted_maneuvers(self) -> list[BaselineManeuver]:
        """Return the fitted maneuvers, from which the baseline model is estimated.

        Raises
        ------
        StoopError
            A flight no longer lies in the folder, or is not the one that was fitted.
        """
        fitted = [m for m in self.result.maneuvers if m.role == "fit"]
        windows = [Window(m.flight, m.start, m.stop, m.loading or None) for m in fitted]
        prepared = prepare(self.vehicle, self.flights(), windows)
        pieces = [[prepared.pieces[i] for i in prepared.of_maneuver(m)] for m in range(len(windows))]
        return [baseline_maneuver(self.vehicle, "fit", some) for some in pieces]

    def flights(self) -> dict[str, Flight]:
        """Return the flights that lie in the folder, by name.

        Raises
        ------
        StoopError
            One of them does not.
        """
        copies = _copies(self.folder, self.result)
        return {name: replace(load(path), name=name) for name, path in copies.items()}


def read_identified(path: Path) -> Identified:
    """Read the folder of stoop identify, or the ``result.json`` in it.

    Raises
    ------
    StoopError
        There is no such folder, or it does not hold what stoop identify writes.
    """
    folder, file = (path, path / RESULT) if path.is_dir() else (path.parent, path)
    if not file.exists():
        raise StoopError(f"{path}: holds no {RESULT}; name the folder that stoop identify wrote")
    result = read_result(file)
    wrong = next(_contradictions(result), None)
    if wrong is not None:
        raise StoopError(f"{file}: {wrong}; write it again with stoop identify")
    if not (folder / "vehicle.toml").exists():
        raise StoopError(
            f"{folder}: holds no vehicle.toml beside {RESULT}; name the whole folder that stoop identify wrote"
        )
    vehicle = load_vehicle(folder / "vehicle.toml")
    try:
        vehicle = vehicle.with_numbers({n: {"value": p.estimate} for n, p in result.parameters.items()})
    except StoopError as error:
        raise StoopError(f"{folder}: {RESULT} and vehicle.toml do not belong together ({error})") from None
    copies = _copies(folder, result)
    hashes = {digest: flight_name(Path(file)) for file, digest in result.inputs.items()}
    hashes = {digest: name for digest, name in hashes.items() if name in copies}
    hashes |= {next(iter(file_hashes([p]).values())): name for name, p in copies.items() if p.exists()}
    return Identified(folder, result, vehicle, hashes)


def _copies(folder: Path, result: Result) -> dict[str, Path]:
    """Return where the flights of a result lie in its folder, by name."""
    names = tuple(dict.fromkeys(m.flight for m in result.maneuvers))
    return {name: folder / flight_file(name, len(names)) for name in names}


def _contradictions(result: Result) -> Iterator[str]:
    """Yield what stoop identify does not write: a file that was edited, or cut and mended."""
    for name, p in result.parameters.items():
        if not np.isfinite(p.estimate):
            yield f"has no estimate of {name}"
    if not set(result.covariance.names) <= set(result.parameters):
        yield "has a covariance of other parameters than its estimates"
    for names, matrix in (
        (result.covariance.names, result.covariance.matrix),
        (result.noise_covariance.channels, result.noise_covariance.matrix),
    ):
        if len(matrix) != len(names):
            yield f"has a covariance of {len(matrix)} rows for {len(names)} names"
    if not any(m.role == "fit" for m in result.maneuvers):
        yield "names no maneuver that was fitted"
    places = {b.maneuver for b in result.biases} | {i.maneuver for i in result.initial_states}
    if not places <= set(range(len(result.maneuvers))):
        yield "has biases or initial states of a maneuver that it does not name"
