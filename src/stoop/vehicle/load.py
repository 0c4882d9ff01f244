"""Vehicle files: TOML -> :class:`Vehicle`, with the defaults filled in."""

from __future__ import annotations

from typing import Any

from pydantic import ValidationError

from stoop.base.schema_errors import first_complaint
from stoop.base.toml import parse_source
from stoop.base.variables import POSITION, RATES, SPECIFIC_FORCE
from stoop.errors import VehicleError
from stoop.vehicle import terms
from stoop.vehicle.checks import check
from stoop.vehicle.defaults import COEFFICIENTS, EQUATION_1
from stoop.vehicle.schema import CHANNELS, WIND, VehicleFile, tied
from stoop.vehicle.usual import ADVICE, usual_size
from stoop.vehicle.vehicle import Vehicle

STANDARD_CONTROLS = ("elevator", "aileron", "rudder")
_SENSOR_DEFAULTS = {
    **dict.fromkeys(POSITION, (0.01, 0.002)),
    "vn": (3.0, 0.1), "ve": (3.0, 0.1), "vd": (0.5, 0.1), "V": (1.0, 0.3), "alpha": (0.02, 0.005), "beta": (0.02, 0.005),
    **dict.fromkeys(("p", "q", "r", "phi", "theta", "psi"), (0.02, 0.01)), **dict.fromkeys(("ax", "ay", "az"), (0.2, 0.1)),
}  # fmt: skip
"""Prior of the bias and noise, standard deviations in the channel's unit."""


def parse_vehicle(text: str, where: str) -> Vehicle:
    """Read a vehicle from TOML text; ``where`` names it in messages."""
    raw = parse_source(text, where, VehicleError)
    if raw.get("rotor") and "aerodynamics" not in raw:
        raw.update(aerodynamics={"default": False}, controls=raw.get("controls") or {})
    elif not raw.get("controls"):
        raw["controls"] = {name: {} for name in STANDARD_CONTROLS}
    if isinstance(raw["controls"], dict) and isinstance(raw.setdefault("aerodynamics", {}), dict):
        _complete_terms(raw["aerodynamics"], raw["controls"], where)
    if isinstance(raw.setdefault("sensors", {}), dict):
        placed = POSITION if set(POSITION) & raw["sensors"].keys() else ()
        _complete_sensors(raw["sensors"], (*CHANNELS, *(WIND if raw.get("rotor") else ()), *placed))
    _without_zero_lags(raw)

    def usual(key: str) -> str:
        size = usual_size(key, raw)
        return f"{size}; {ADVICE}" if size else ""

    try:
        file = VehicleFile.model_validate(raw)
    except ValidationError as error:
        raise VehicleError(f"{where}: {first_complaint(error, raw, VehicleFile, usual)}") from None
    _check_terms(file, where)
    vehicle = Vehicle(file=file, text=text, where=where)
    check(vehicle)
    return vehicle


def _complete_sensors(sensors: dict[str, Any], channels: tuple[str, ...]) -> None:
    """Add the noise of instruments, and prior and freedom of their biases; a bias with a prior of its own is free.

    The air is still where a position is measured.
    """
    inertial = (*RATES, *SPECIFIC_FORCE) if sensors.get("estimate_biases", True) else ()
    for channel in channels:
        sensor = sensors.setdefault(channel, {})
        if not isinstance(sensor, dict):
            continue
        prior, sigma = _SENSOR_DEFAULTS[channel]
        sensor.setdefault("sigma", sigma)
        bias = sensor.setdefault("bias", {})
        if isinstance(bias, int | float) and not isinstance(bias, bool):
            bias = sensor["bias"] = {"value": bias}
        if isinstance(bias, dict) and not {"tie", "prior"} & bias.keys():
            free = channel in (*inertial, *(() if "pn" in channels else WIND))
            sensor["bias"] = {"free": free, **bias, "prior": prior}


def _without_zero_lags(raw: dict[str, Any]) -> None:
    """Remove lags of zero, by which a file says that a servo or a motor has none."""
    controls = raw.get("controls")
    for table in (*(controls.values() if isinstance(controls, dict) else ()), raw.get("rotors")):
        lag = table.get("lag") if isinstance(table, dict) else None
        if lag == 0.0 and not isinstance(lag, bool):
            del table["lag"]


def _complete_terms(aerodynamics: dict[str, Any], controls: dict[str, Any], where: str) -> None:
    """Add the terms of eq. (1) whose controls the vehicle has, unless the file removes them."""
    for coefficient in COEFFICIENTS:
        written = aerodynamics.setdefault(coefficient, {})
        if not isinstance(written, dict):
            continue
        known = {name: term for name, (term, _, _) in EQUATION_1[coefficient].items()}
        missing = {c for c in STANDARD_CONTROLS if c not in controls}
        default = aerodynamics.get("default", True)
        merged: dict[str, Any] = {n: {"term": t} for n, t in known.items() if default and t not in missing}
        kept = {name: value for name, value in (merged | written).items() if value is not False}
        place = f"{where}: aerodynamics.{coefficient}"
        aerodynamics[coefficient] = {n: _term(x, known.get(n), f"{place}.{n}") for n, x in kept.items()}


def _term(value: Any, known: str | None, where: str) -> Any:
    """Add the term of eq. (1) of the same name to a bare number or a table without a term."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = {"value": value}
    elif isinstance(value, str):
        try:
            value = {"tie": tied(value)}
        except ValueError as error:
            raise VehicleError(f"{where}: {error}") from None
    if isinstance(value, dict) and "term" not in value:
        if known is None:
            raise VehicleError(
                f"{where}: not a term of eq. (1); write what it multiplies, "
                'e.g. { term = "alpha*elevator", value = 0.0 }'
            )
        value = {**value, "term": known}
    return value


def _check_terms(file: VehicleFile, where: str) -> None:
    variables, controls = set(terms.STATE_VARIABLES), set(file.controls)
    if variables & controls:
        raise VehicleError(
            f"{where}: controls.{min(variables & controls)}: the name is taken by a flight variable; choose another"
        )
    names: set[str] = set()
    for coefficient in COEFFICIENTS:
        for name, term in getattr(file.aerodynamics, coefficient).items():
            place = f"{where}: aerodynamics.{coefficient}.{name}"
            if name in names:
                raise VehicleError(f"{place}: the name is used twice; choose another")
            names.add(name)
            terms.parse(term.term, variables | controls, place)
