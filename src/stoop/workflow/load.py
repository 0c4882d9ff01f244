"""Reading the folder of a fitted model; and the first argument of a verb, a model or the folder of one."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, Final, ParamSpec, TypeVar

import numpy as np

from stoop.base.files import read_bounded
from stoop.base.numbers import MAX_NUMBER
from stoop.base.text import nearest
from stoop.errors import StoopError
from stoop.estimate.noise import is_covariance
from stoop.flight import Flight, load_flight
from stoop.results.result import Result, read_result
from stoop.vehicle import Vehicle, load_vehicle
from stoop.workflow.archive import Curves, unpacked_curves, without_curves
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.outputs import ARCHIVES, ATTACHED, CURVES, ESTIMATE, RESULT, flight_file, flight_places

P = ParamSpec("P")
T = TypeVar("T")
Place = str | Path
MAX_ATTACHED: Final = 2**28  #: bytes of a file beside the result


def fitted_model(given: object) -> FittedModel:
    """Return a fitted model, read from its folder if that is given."""
    if isinstance(given, str | Path):
        return load(given)
    if isinstance(given, FittedModel):
        return given
    kind = type(given).__name__
    raise StoopError(f"a fitted model or its folder comes first, not a {kind}; give what stoop.fit returns")


def model_or_vehicle(given: FittedModel | Vehicle | Place) -> FittedModel | Vehicle:
    """Return a fitted model or a vehicle: also of a folder, a ``result.json``, a vehicle file or a built-in vehicle."""
    if isinstance(given, Vehicle):
        return given
    if isinstance(given, str | Path) and not (Path(given).is_dir() or Path(given).suffix == ".json"):
        return load_vehicle(given)
    return fitted_model(given)


def takes_model(
    function: Callable[Concatenate[FittedModel, P], T],
) -> Callable[Concatenate[FittedModel | Place, P], T]:
    """Let the first argument of a function also be the folder of a fitted model."""
    return _read_first(function, fitted_model)


def takes_model_or_vehicle(
    function: Callable[Concatenate[FittedModel | Vehicle, P], T],
) -> Callable[Concatenate[FittedModel | Vehicle | Place, P], T]:
    """Let the first argument of a function also be a folder, a vehicle file or the name of a built-in vehicle."""
    return _read_first(function, model_or_vehicle)


def _read_first(function: Callable[..., T], read: Callable[[Any], Any]) -> Callable[..., T]:
    """Return a function that reads its first argument; an unknown keyword is answered by those that resemble it."""

    @wraps(function)
    def run(model: Any, *arguments: Any, **keywords: Any) -> T:
        known = list(inspect.signature(function).parameters)
        for name in keywords:
            if name not in known:
                raise TypeError(f"{function.__name__}() has no keyword '{name}'; {nearest(name, known)}")
        return function(read(model), *arguments, **keywords)

    return run


def load(path: str | Path) -> FittedModel:
    """Read a fitted model from the folder that :meth:`FittedModel.save` or stoop identify wrote.

    Parameters
    ----------
    path : path
        Of the folder, or of the ``result.json`` in it.

    Returns
    -------
    FittedModel
        Without flights, and with the reason in `missing`, where the folder has lost them.

    Raises
    ------
    StoopError
        There is no such folder, or it holds what no fit writes.
    """
    place = Path(path)
    folder, file = (place, place / RESULT) if place.is_dir() else (place.parent, place)
    if not file.exists():
        raise StoopError(f"{place}: holds no {RESULT}; name the folder that stoop identify wrote")
    result = read_result(file)
    _check(result, file)
    if not (folder / "vehicle.toml").exists():
        raise StoopError(
            f"{folder}: holds no vehicle.toml beside {RESULT}; name the whole folder that stoop identify wrote"
        )
    vehicle = load_vehicle(folder / "vehicle.toml")
    try:
        vehicle = vehicle.with_numbers({n: {"value": p.estimate} for n, p in result.parameters.items()})
    except StoopError as error:
        raise StoopError(f"{folder}: {RESULT} and vehicle.toml do not belong together ({error})") from None
    try:
        flights, missing = _flights(folder, result), ""
    except StoopError as error:
        flights, missing = (), str(error)
    files: dict[str, bytes] = {}
    for place in (folder / name for name in (*ARCHIVES, *ATTACHED)):
        try:
            files[place.name] = read_bounded(place, MAX_ATTACHED)
        except FileNotFoundError:
            continue
        except OSError as error:
            raise StoopError(f"{place}: cannot be read ({error.strerror}); remove it, or fit again") from None
    count = len(result.maneuvers)
    curves = Curves(tuple(without_curves(count)))
    if CURVES in files:
        curves = unpacked_curves(files[CURVES], count, str(folder / CURVES))
    return FittedModel(
        vehicle,
        result,
        flights,
        curves.traces,
        archive=files.get(ESTIMATE, b""),
        convergence=curves.convergence,
        command=curves.command,
        attachments={name: content for name, content in files.items() if name in ATTACHED},
        folder=folder,
        missing=missing,
    )


def _flights(folder: Path, result: Result) -> tuple[Flight, ...]:
    """Return the flights of a folder, those without a window last; raises `StoopError` if one is missing."""
    names = tuple(dict.fromkeys(m.flight for m in result.maneuvers))
    alone, several = folder / flight_file("", 1), [folder / flight_file(name, 2) for name in names]
    if len(names) == 1 and (alone.exists() or not several[0].exists()):
        places = {names[0]: alone}
    else:
        others = [p for p in flight_places(folder) if p != alone and p not in several]
        unused = {p.stem.removeprefix("flight-"): p for p in others}
        places = dict(zip(names, several, strict=True)) | unused
    return tuple(replace(load_flight(place), name=name) for name, place in places.items())


def _check(result: Result, file: Path) -> None:
    """Refuse a result that no fit writes: a file that was edited, or cut and mended."""
    estimates, covariance, noise = result.parameters, result.covariance, result.noise_covariance
    lost = next((name for name, p in estimates.items() if not np.isfinite(p.estimate)), None)
    scalars = [[p.estimate, p.std_error, p.prior_mean, p.prior_std] for p in estimates.values()]
    roots = (np.sqrt(np.abs(matrix)).ravel() for matrix in (covariance.matrix, noise.matrix))
    sizes = np.concatenate([np.abs(np.ravel(scalars)), *roots])
    tiny = any(0.0 < p.std_error < 1.0 / MAX_NUMBER for p in estimates.values())
    variances = np.diag(covariance.matrix)
    apart = covariance.matrix[np.ix_(*[np.isfinite(variances)] * 2)]
    whole = np.allclose(apart, apart.T) and not (variances < 0.0).any()
    rows = ((len(covariance.matrix), len(covariance.names)), (len(noise.matrix), len(noise.channels)))
    process, plain = result.process_noise, result.uncertainty.get("cramer_rao")
    driven = all(0.0 < x < np.inf for x in process.intensities) and 0.0 <= process.share <= 1.0
    driven = driven and len(process.intensities) == len(process.states)
    places = {b.maneuver for b in result.biases} | {i.maneuver for i in result.initial_states}
    positive = is_covariance(noise.matrix * noise.inflation)
    unnamed = places - set(range(len(result.maneuvers)))
    checks = (
        (lost is not None, f"has no estimate of {lost}"),
        (set(covariance.names) - set(estimates), "has a covariance of other parameters than its estimates"),
        *((n != names, f"has a covariance of {n} rows for {names} names") for n, names in rows),
        (tiny or (sizes[np.isfinite(sizes)] > MAX_NUMBER).any(), "has numbers out of range (1e-30 to 1e30)"),
        (not whole, "has a covariance that is not symmetric, has holes or negative variances"),
        (not positive, "has a noise covariance that is not positive definite"),
        (not driven, "has process noise without positive intensities"),
        (any(p.prior_std <= 0.0 for p in estimates.values()), "has a prior without a standard deviation"),
        (plain and set(estimates) - set(plain.parameters), "lacks the intervals of some of its estimates"),
        (all(m.role != "fit" for m in result.maneuvers), "names no maneuver that was fitted"),
        (unnamed, "has biases or initial states of a maneuver that it does not name"),
    )
    for wrong, text in checks:
        if wrong:
            raise StoopError(f"{file}: {text}; write it again with stoop identify")
