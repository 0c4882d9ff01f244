"""What an estimation assumes of numbers that every vehicle has and a file may leave out: lags, a delay, errors of thrust.

A servo that is moved by a command has a lag, and there is a delay between a command and what was measured of it. A model
without them puts the phase into damping and control derivatives. So they are free, with priors that cover the usual servos
and motors; a file that gives a lag (0 for none) or a delay decides for itself.
"""

from __future__ import annotations

from collections.abc import Mapping, Set
from typing import Any, Final

import tomlkit

from stoop.base.notices import Notice, notice
from stoop.vehicle.defaults import SHORTEST_LAG, full_command
from stoop.vehicle.document import with_entries
from stoop.vehicle.usual import USUAL
from stoop.vehicle.vehicle import Vehicle

_THRUST: Final = tuple(f"propulsion.{name}" for name in ("thrust", "scale", "CT0", "CT1", "CT2"))


def with_assumptions(vehicle: Vehicle, dt: float) -> tuple[Vehicle, tuple[Notice, ...]]:
    """Return a vehicle with free lags, a free delay and a free thrust where its file leaves them out, and what was assumed.

    Parameters
    ----------
    vehicle : Vehicle
    dt : float
        Time between samples, s: no lag is assumed where none could be told.
    """
    entries, found = dict[tuple[str, ...], Any](), list[Notice]()
    # of controls and of the rotors: the channels that move them, servos first
    tables = dict[tuple[str, ...], Set[str]]()
    tables |= {("controls", c): {*vehicle.channels_of(c)} for c in vehicle.controls}
    if vehicle.rotors:
        tables["rotors",] = {rotor.channel for rotor in vehicle.file.rotor.values()}
    lags = _without_lag(vehicle, tables) if USUAL.lag_samples * dt < USUAL.lag else []
    # servos of one channel have one delay: that of a file that describes one of them
    named = [k for k in tables if k not in lags or ".".join((*k, "delay")) in vehicle.rows]
    described = {channel for keys in named for channel in tables[keys]}
    late = [keys for keys in lags if not tables[keys] & described]
    delay = {"value": USUAL.delay, "prior": USUAL.delay_std}
    for kind, places, entry in (("lag", lags, _lag(dt)), ("delay", late, delay)):
        if places:
            first, *others = ((*keys, kind) for keys in places)
            entries |= {first: entry} | dict.fromkeys(others, "=" + ".".join(first))
            names = tuple(".".join(keys) for keys in places)
            values = {"value": entry["value"], "std": entry["prior"]}
            found.append(notice(f"{kind}-assumed", ".".join(first), places=names, **values))
    numbers, loadings = vehicle.quantities, vehicle.file.loadings.values()
    thrust = {
        name: {"prior": USUAL.thrust * abs(q.value)}
        for name in _THRUST
        if (q := numbers.get(name)) and q.value and q.free is None and q.prior is None
        if not any(name in changed for changed in loadings)  # an estimate holds for all maneuvers
    }
    if thrust:
        found.append(notice("thrust-assumed", "propulsion", places=tuple(thrust), share=USUAL.thrust))
    completed = with_entries(vehicle, entries) if entries else vehicle
    return completed.with_numbers(thrust) if thrust else completed, tuple(found)


def _lag(dt: float) -> dict[str, Any]:
    """Return the entry of a lag that the integration can follow."""
    own, least = {"value": USUAL.lag, "prior": USUAL.lag_std}, USUAL.lag_samples * dt
    return own if least <= 0.5 * SHORTEST_LAG else {**own, "bounds": [least, USUAL.lag + 5.0 * USUAL.lag_std]}


def _without_lag(vehicle: Vehicle, tables: Mapping[tuple[str, ...], Set[str]]) -> list[tuple[str, ...]]:
    """Return the tables of controls and rotors that commands move and for which the file gives no lag."""
    written = tomlkit.parse(vehicle.text).unwrap()

    def given(keys: tuple[str, ...]) -> bool:
        table = written
        for key in keys:
            table = table.get(key, {})
        return "lag" in table

    commanded = {keys for keys, own in tables.items() if all(full_command(c) is not None for c in own)}
    return [keys for keys in tables if keys in commanded and not given(keys)]
