"""The output folder of an identification, written whole or not at all and read back; hashes and versions."""

from __future__ import annotations

import hashlib
import platform
import uuid
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

import numpy as np
import numpy.typing as npt
import tomlkit

from stoop.assessment.baseline import BaselineManeuver
from stoop.base.files import check_targets, make_folder, scratch, write_files
from stoop.base.numbers import MAX_NUMBER
from stoop.errors import FlightError, OutputError, StoopError
from stoop.estimate.initial_state import BiasPrior, bias_priors
from stoop.estimate.noise import is_covariance
from stoop.flight import Flight, flight_bytes, load
from stoop.flight.flight import flight_name
from stoop.logs.csv_tables import mapping_beside
from stoop.problem.prepare import decoupled, prepare
from stoop.problem.windows import Window
from stoop.results.result import Result, read_result, to_json
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle
from stoop.vehicle.document import keys_of, write_entry, write_fields
from stoop.vehicle.vehicle import leaves
from stoop.workflow.curves import baseline_maneuver

if TYPE_CHECKING:
    from stoop.workflow.identification import Job

RESULT: Final = "result.json"  #: moved into place last: where it is, the others are
ATTACHED: Final = ("posterior.nc",)  #: files that some results have
PACKAGES: Final = ("stoop", "numpy", "scipy", "numba", "sympy", "xarray")
TABLES: Final = (".csv", ".csv.gz")  #: endings of the files that are read of a folder, beside its mapping


def output_names(flights: Sequence[str]) -> tuple[str, ...]:
    """Return the names of all files that are written for flights of these names, in the order of moving."""
    return ("vehicle.toml", *(flight_file(name, len(flights)) for name in flights), "report.html", RESULT)


def flight_file(name: str, count: int) -> str:
    """Return the name of a flight's file, one of so many."""
    return "flight.nc" if count == 1 else f"flight-{name}.nc"


def check_folder(
    folder: Path,
    flights: Sequence[str],
    overwrite: bool = False,
    inputs: Sequence[Path] = (),
    more: Sequence[str] = (),
) -> None:
    """Refuse a folder that cannot take the outputs, before any work is done; make it if it is not there.

    `flights` and `more` are names of flights and of further files; `inputs` are never written over.

    Raises `OutputError`: it holds an input or an earlier output of the same name, is no folder, or cannot be made.
    """
    check_targets(folder, (RESULT, *output_names(flights), *more), overwrite, inputs)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with scratch(folder):
            pass
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be written ({error.strerror}); name another folder with -o"
        ) from None


def place_outputs(job: Job, folder: Path, overwrite: bool = False) -> Path:
    """Write into a folder that was checked, maybe hours ago; all is made first, then moved into place.

    Raises `OutputError`: the folder cannot be written; or another run has written there since, and this one's lies beside it.
    """
    from stoop.report.identification import render

    files: dict[str, bytes | str] = dict(job.attachments)
    files["vehicle.toml"] = with_values(job.fit.problem.layout.vehicle, job.fit.estimates)
    files |= {flight_file(flight.name, len(job.flights)): flight_bytes(flight) for flight in job.flights}
    files |= {"report.html": render(job.identification), RESULT: to_json(job.result)}
    make_folder(folder)
    if not overwrite and any((folder / name).exists() for name in files):
        # Hours may lie in either: the result is put beside that of the other run.
        aside = folder / f"run-{uuid.uuid4().hex[:8]}"
        write_files(folder, {f"{aside.name}/{name}": content for name, content in files.items()})
        raise OutputError(
            f"{folder}: another run has written there meanwhile; this one's result is in {aside}"
        )
    # an old mark must not stand beside new files, nor an old posterior beside a new result
    obsolete = [RESULT, *(set(ATTACHED) - set(files))] if (folder / RESULT).exists() else []
    write_files(folder, files, obsolete)
    return folder


def with_values(vehicle: Vehicle, values: dict[str, float]) -> str:
    """Return the text of a vehicle file with some numbers replaced or added; comments and order stay.

    A fit that begins from it is of the same problem: priors stay about their own means, so that each counts once, and what was
    set, freed or fixed since the file was read is written.
    """
    document, original = tomlkit.parse(vehicle.text), parse_vehicle(vehicle.text, vehicle.where)
    written = dict(leaves(original.file))
    for name, q in leaves(vehicle.file):
        before = written.get(name)
        if q.tie is not None or before is None or before.tie is not None:
            continue
        value, keys = values.get(name, q.value), keys_of(vehicle, name)
        fields: dict[str, Any] = {} if q.free in (None, before.free) else {"free": q.free}
        if name in values and q.prior is not None:
            fields |= {"prior": q.prior, "mean": q.prior_mean}
        if fields or name in values or value != before.value:
            low, high = q.bounds or (-MAX_NUMBER, MAX_NUMBER)
            rounded = float(f"{value:.10g}")
            write_entry(document, keys, min(max(rounded, low), high))
        if fields:
            write_fields(document, keys, fields)
    if original.reduce != vehicle.reduce:
        write_entry(document, ["model", "reduce"], vehicle.reduce)
    return tomlkit.dumps(document)


def by_name(flights: Sequence[Flight], verb: str) -> dict[str, Flight]:
    """Return flights by their names; raises `FlightError` if two have the same."""
    out: dict[str, Flight] = {}
    for flight in flights:
        if flight.name in out:
            raise FlightError(f"{verb}: two flights are called '{flight.name}'; rename one of the files")
        out[flight.name] = flight
    return out


def versions() -> dict[str, str]:
    """Return the versions that a result depends on."""
    return {"python": platform.python_version(), **{name: metadata.version(name) for name in PACKAGES}}


def input_hashes(
    vehicle: Vehicle, flights: Mapping[str, Flight], others: Iterable[Path] = ()
) -> dict[str, str]:
    """Return the SHA-256 of the vehicle file, of every flight's files and of all others, by name."""
    own = {Path(vehicle.where).name: hashlib.sha256(vehicle.text.encode()).hexdigest()}
    return own | file_hashes([*flight_files(flights.values()), *others], own)


def flight_files(flights: Iterable[Flight]) -> list[Path]:
    """Return the files or folders of flights, and the mappings that are found beside them."""
    logs = [flight.path for flight in flights if flight.path is not None]
    mappings = [mapping_beside(path) for path in logs if path.is_file()]
    return [path for path in [*logs, *mappings] if path.exists()]


def file_hashes(paths: Iterable[Path], taken: Iterable[str] = ()) -> dict[str, str]:
    """Return the SHA-256 of files by their names, by their paths where a name is taken.

    Of a folder the sorted names and contents of its tables and mapping are hashed, not of results beside them.
    """
    out: dict[str, str] = {}
    for path in dict.fromkeys(paths):
        digest, files = hashlib.sha256(), [path]
        if path.is_dir():
            read = (p for p in path.iterdir() if p.name.lower().endswith(TABLES) or p == mapping_beside(path))
            files = sorted(p for p in read if p.is_file())
        for file in files:
            if path.is_dir():
                digest.update(str(file.relative_to(path)).encode())
            with file.open("rb") as stream:
                while chunk := stream.read(1 << 20):
                    digest.update(chunk)
        out[str(path) if path.name in {*taken, *out} else path.name] = digest.hexdigest()
    return out


@dataclass(frozen=True, eq=False)
class Identified:
    """The output folder of stoop identify."""

    folder: Path
    result: Result
    vehicle: Vehicle  #: with its free numbers at their estimates, to the last digit
    #: SHA-256 of every fitted flight, and of its copy in the folder, to the flight's name
    hashes: Mapping[str, str]

    def biases(self, flight: str | None) -> dict[str, BiasPrior]:
        """Return what the fitted maneuvers tell of each bias in a window of a flight."""
        fitted = [
            (self.result.maneuvers[b.maneuver].flight, {f"sensors.{c}.bias": q.estimate for c, q in b.values.items()})
            for b in self.result.biases
        ]  # fmt: skip
        return bias_priors(fitted, flight, {p.name: p.prior or 1.0 for p in self.vehicle.parameters})

    def name_of(self, flight: Flight) -> str | None:
        """Return the name under which a flight was fitted; None for one that was not."""
        digests = file_hashes(flight_files([flight])).values()
        return next((self.hashes[d] for d in digests if d in self.hashes), None)

    def fitted_maneuvers(self) -> list[BaselineManeuver]:
        """Return the fitted maneuvers, from which the baseline model is estimated.

        Raises `StoopError` if a flight no longer lies in the folder, or is not the one that was fitted.
        """
        fitted = [m for m in self.result.maneuvers if m.role == "fit"]
        windows = [Window(m.flight, m.start, m.stop, m.loading or None) for m in fitted]
        flights = self.flights()
        prepared = prepare(decoupled(self.vehicle, flights, windows), flights, windows)
        pieces = [[prepared.pieces[i] for i in prepared.of_maneuver(m)] for m in range(len(windows))]
        return [baseline_maneuver(self.vehicle, "fit", some) for some in pieces]

    def flights(self) -> dict[str, Flight]:
        """Return the flights that lie in the folder, by name; raises `StoopError` if one is missing."""
        copies = _copies(self.folder, self.result)
        return {name: replace(load(path), name=name) for name, path in copies.items()}


def read_identified(path: Path) -> Identified:
    """Read the folder of stoop identify, or the ``result.json`` in it.

    Raises `StoopError` if there is no such folder, or it does not hold what stoop identify writes.
    """
    folder, file = (path, path / RESULT) if path.is_dir() else (path.parent, path)
    if not file.exists():
        raise StoopError(f"{path}: holds no {RESULT}; name the folder that stoop identify wrote")
    result = read_result(file)
    # What stoop identify does not write: a file that was edited, or cut and mended.
    lost = next((name for name, p in result.parameters.items() if not np.isfinite(p.estimate)), None)
    covariance, noise = result.covariance, result.noise_covariance
    numbers: tuple[npt.ArrayLike, ...] = (
        *([p.estimate, p.std_error, p.prior_mean, p.prior_std] for p in result.parameters.values()),
        np.sqrt(np.abs(covariance.matrix)),
        np.sqrt(np.abs(noise.matrix)),
    )
    apart = covariance.matrix[np.ix_(*[np.isfinite(np.diag(covariance.matrix))] * 2)]
    sizes = ((len(covariance.matrix), len(covariance.names)), (len(noise.matrix), len(noise.channels)))
    plain = result.uncertainty.get("cramer_rao")
    places = {b.maneuver for b in result.biases} | {i.maneuver for i in result.initial_states}
    checks = (
        (lost is not None, f"has no estimate of {lost}"),
        (
            not set(covariance.names) <= set(result.parameters),
            "has a covariance of other parameters than its estimates",
        ),
        *((rows != names, f"has a covariance of {rows} rows for {names} names") for rows, names in sizes),
        (
            any(_size(some) > MAX_NUMBER for some in numbers)
            or any(0.0 < p.std_error < 1.0 / MAX_NUMBER for p in result.parameters.values()),
            "has numbers out of range (1e-30 to 1e30)",
        ),
        (
            not np.allclose(apart, apart.T) or bool((np.diag(covariance.matrix) < 0.0).any()),
            "has a covariance that is not symmetric, has holes or negative variances",
        ),
        (
            not is_covariance(noise.matrix * noise.inflation),
            "has a noise covariance that is not positive definite",
        ),
        (
            any(p.prior_std <= 0.0 for p in result.parameters.values()),
            "has a prior without a standard deviation",
        ),
        (
            not set(result.parameters) <= set(plain.parameters if plain else result.parameters),
            "lacks the intervals of some of its estimates",
        ),
        (all(m.role != "fit" for m in result.maneuvers), "names no maneuver that was fitted"),
        (
            not places <= set(range(len(result.maneuvers))),
            "has biases or initial states of a maneuver that it does not name",
        ),
    )
    wrong = next((text for failed, text in checks if failed), None)
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


def _size(numbers: npt.ArrayLike) -> float:
    """Return the size of the largest number that is finite."""
    values = np.abs(np.asarray(numbers, dtype=np.float64))
    return float(np.max(values, initial=0.0, where=np.isfinite(values)))


def _copies(folder: Path, result: Result) -> dict[str, Path]:
    """Return where the flights of a result lie in its folder, by name."""
    names = tuple(dict.fromkeys(m.flight for m in result.maneuvers))
    return {name: folder / flight_file(name, len(names)) for name in names}
