"""Vehicle files: TOML -> :class:`Vehicle`, and back with the estimates in place."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from stoop.base.schema_errors import first_complaint
from stoop.base.toml import parse_source, read_source
from stoop.errors import VehicleError
from stoop.vehicle import checks, terms
from stoop.vehicle.defaults import COEFFICIENTS, EQUATION_1
from stoop.vehicle.quantity import tied
from stoop.vehicle.schema import CHANNELS, WIND, Control, VehicleFile
from stoop.vehicle.vehicle import Vehicle

STANDARD_CONTROLS = ("elevator", "aileron", "rudder")
_SENSOR_DEFAULTS = {
    "vn": (3.0, 0.1), "ve": (3.0, 0.1), "vd": (0.5, 0.1), "V": (1.0, 0.3), "alpha": (0.02, 0.005), "beta": (0.02, 0.005),
    "p": (0.02, 0.01), "q": (0.02, 0.01), "r": (0.02, 0.01),
    "phi": (0.02, 0.01), "theta": (0.02, 0.01), "psi": (0.02, 0.01),
    "ax": (0.2, 0.1), "ay": (0.2, 0.1), "az": (0.2, 0.1),
}  # fmt: skip


def load_vehicle(path: Path | str) -> Vehicle:
    """Read a vehicle file.

    Raises
    ------
    VehicleError
        One line that names the file, the key and what to write instead.
    """
    return parse_vehicle(read_source(path, "vehicle", VehicleError), str(path))


def parse_vehicle(text: str, where: str) -> Vehicle:
    """Read a vehicle from TOML text; ``where`` names it in messages."""
    raw = parse_source(text, where, VehicleError)
    _complete(raw, where)
    try:
        file = VehicleFile.model_validate(raw)
    except ValidationError as error:
        raise VehicleError(f"{where}: {first_complaint(error, raw, VehicleFile)}") from None
    _check_terms(file, where)
    vehicle = Vehicle(file=file, text=text, where=where)
    checks.check(vehicle)
    return vehicle


def _complete(raw: dict[str, Any], where: str) -> None:
    """Write into the raw file what it leaves to the defaults."""
    has_rotors = bool(raw.get("rotor"))
    if has_rotors and "aerodynamics" not in raw:
        raw.update(aerodynamics={"default": False}, controls=raw.get("controls") or {})
    elif not raw.get("controls"):
        raw["controls"] = {name: {} for name in STANDARD_CONTROLS}
    if isinstance(raw.get("controls"), dict):
        _complete_terms(raw, where)
    sensors = raw.setdefault("sensors", {})
    if isinstance(sensors, dict):
        for channel in (*CHANNELS, *(WIND if has_rotors else ())):
            _complete_sensor(sensors, channel)


def _complete_sensor(sensors: dict[str, Any], channel: str) -> None:
    sensor = sensors.setdefault(channel, {})
    if not isinstance(sensor, dict):
        return
    prior, sigma = _SENSOR_DEFAULTS[channel]
    sensor.setdefault("sigma", sigma)
    bias = sensor.setdefault("bias", {})
    if isinstance(bias, int | float) and not isinstance(bias, bool):
        sensor["bias"] = {"value": bias, "prior": prior}
    elif isinstance(bias, dict) and "tie" not in bias:
        bias.setdefault("prior", prior)


def _complete_terms(raw: dict[str, Any], where: str) -> None:
    aerodynamics = raw.setdefault("aerodynamics", {})
    if not isinstance(aerodynamics, dict):
        return
    default = aerodynamics.get("default", True)
    for coefficient in COEFFICIENTS:
        written = aerodynamics.setdefault(coefficient, {})
        if not isinstance(written, dict):
            continue
        known = {k: t for k, (t, _, _) in EQUATION_1[coefficient].items()}
        present = {k: t for k, t in known.items() if _has_control(t, raw["controls"])} if default else {}
        merged: dict[str, Any] = {name: {"term": text} for name, text in present.items()} | written
        aerodynamics[coefficient] = {
            name: _term(value, known.get(name), f"{where}: aerodynamics.{coefficient}.{name}")
            for name, value in merged.items()
            if value is not False
        }


def _has_control(term: str, controls: Mapping[str, Any]) -> bool:
    return term not in STANDARD_CONTROLS or term in controls


def _term(value: Any, known: str | None, where: str) -> Any:
    """Give a bare number or a table without a term the term of eq. (1) that has its name."""
    if isinstance(value, int | float) and not isinstance(value, bool):
        value = {"value": value}
    elif isinstance(value, str):
        value = {"tie": _tied(value, where)}
    if isinstance(value, dict) and "term" not in value:
        if known is None:
            raise VehicleError(
                f"{where}: not a term of eq. (1); say what it multiplies, "
                'e.g. { term = "alpha*elevator", value = 0.0 }'
            )
        value = {**value, "term": known}
    return value


def _tied(text: str, where: str) -> str:
    try:
        return tied(text)
    except ValueError as error:
        raise VehicleError(f"{where}: {error}") from None


def _each_term(file: VehicleFile) -> Iterator[tuple[str, str, str]]:
    for coefficient in COEFFICIENTS:
        for name, term in getattr(file.aerodynamics, coefficient).items():
            yield coefficient, name, term.term


def _check_terms(file: VehicleFile, where: str) -> None:
    names = set(terms.STATE_VARIABLES) | set(file.controls)
    clash = set(terms.STATE_VARIABLES) & set(file.controls)
    if clash:
        raise VehicleError(
            f"{where}: controls.{min(clash)}: the name is taken by a flight variable; choose another"
        )
    seen: set[str] = set()
    for coefficient, name, text in _each_term(file):
        if name in seen:
            raise VehicleError(
                f"{where}: aerodynamics.{coefficient}.{name}: the name is used twice; choose another"
            )
        seen.add(name)
        terms.parse(text, names, f"{where}: aerodynamics.{coefficient}.{name}")


__all__ = ["Control", "load_vehicle", "parse_vehicle"]
