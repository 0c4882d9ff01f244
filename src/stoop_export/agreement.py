"""How another tool's flight agrees with ours: slope, correlation and error of every axis and channel, and what is omitted."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray, rotations
from stoop.extend.reports import sheet
from stoop.extend.text import compact, factor_and_unit, number, without_rounding
from stoop.extend.variables import FAMILIES, VARIABLES
from stoop_export.jsbsim_flight import Record, differences, relative_differences
from stoop_export.reference_flight import ReferenceFlight

ROUNDING: Final = 1e-12  #: of the scale of a channel
EXPORT_PAGE: Final = "export.html"
AXES: Final = {"Fx": "N", "Fy": "N", "Fz": "N", "Mx": "N m", "My": "N m", "Mz": "N m"}
"""Force and moment about the center of gravity without gravity, body axes, as of `body_loads`."""
SPECIFIC: Final = ("fx", "fy", "fz")  #: specific force at the center of gravity, m/s2
EXPLANATION: Final = """\
Axes are force and moment without gravity, at the states of our simulation where the tool gives accelerations \
there, else from its own motion and ours by the same computation. Channels are those of the flight, which the other \
tool begins at our state. Slope and correlation are those of the tool's values over ours; the error is the root mean square of \
their difference, and beside it as a share of the standard deviation of ours: of an axis, what the tool does not express."""


def motion_loads(vehicle: Vehicle, states: FloatArray, rates: FloatArray) -> FloatArray:
    """Return force, N, and moment, N m, (6, B), that give states (n_x, B) their derivatives (n_x, B)."""
    at = {name: i for i, name in enumerate(vehicle.states)}
    velocity, omega, dot, turning = (
        array[[at[a] for a in axes]] for array in (states, rates) for axes in ("uvw", "pqr")
    )
    q = states[[at[f"e{i}"] for i in range(4)]].T
    down = rotations.to_body(q, np.array([0.0, 0.0, vehicle.value("environment.gravity")])).T
    force = vehicle.value("mass.mass") * (dot + np.cross(omega, velocity, axis=0) - down)
    return rigid_loads(vehicle, force, omega, turning)


def rigid_loads(vehicle: Vehicle, force: FloatArray, omega: FloatArray, turning: FloatArray) -> FloatArray:
    """Return force, N, and moment, N m, (6, B) from a force, rates, rad/s, and angular accelerations, rad/s2, (3, B) each."""
    inertia = vehicle.inertia_tensor()
    return np.vstack([force, inertia @ turning + np.cross(omega, inertia @ omega, axis=0)])


def body_loads(vehicle: Vehicle, rows: FloatArray, states: FloatArray, inputs: FloatArray) -> FloatArray:
    """Return force, N, and moment about the center of gravity, N m, (6, B) at states (n_x, B) and inputs (n_u, B).

    `rows` are kernel parameters (n_p, B).
    """
    rates, _ = vehicle.kernel().evaluate(rows, np.ascontiguousarray(states), np.ascontiguousarray(inputs))
    return motion_loads(vehicle, states, rates)


@dataclass(frozen=True, eq=False)
class Compared:
    """A flight by our simulation and by another tool.

    Attributes
    ----------
    tool, flight : str
        Titles.
    names : of the columns: :data:`AXES`, channels
    ours, theirs : (n, k), SI and rad
    """

    tool: str
    flight: str
    names: tuple[str, ...]
    ours: FloatArray
    theirs: FloatArray

    @property
    def spread(self) -> FloatArray:
        """Standard deviation (k,) of ours; NaN where all that moves is rounding beside :attr:`scale`."""
        spread = self._unwrapped.std(axis=0)
        return np.where(spread > ROUNDING * self.scale, spread, np.nan)

    @property
    def scale(self) -> FloatArray:
        """Largest magnitude (k,) of ours in all columns of the same unit."""
        largest, units = np.abs(self.ours).max(axis=0), [unit_of(name) for name in self.names]
        return np.array([max(x for x, u in zip(largest, units, strict=True) if u == unit) for unit in units])

    @property
    def _unwrapped(self) -> FloatArray:
        wrapped, out = [name in FAMILIES["circular"] for name in self.names], self.ours.copy()
        out[:, wrapped] = np.unwrap(out[:, wrapped], axis=0)
        return out

    @property
    def statistics(self) -> dict[str, FloatArray]:
        """Slope and correlation (k,) of theirs over ours, rms error (k,) and its share of the standard deviation of ours.

        The correlation is 0 where ours varies and theirs is constant: the tool has lost the axis.
        """
        error = differences(self.names, self.ours, self.theirs)
        ours, spread = self._unwrapped, self.spread
        theirs = ours + error
        shared = np.mean((ours - ours.mean(axis=0)) * (theirs - theirs.mean(axis=0)), axis=0)
        with np.errstate(invalid="ignore", divide="ignore"):
            correlation = shared / spread / theirs.std(axis=0)
        lost = np.isfinite(spread) & (theirs.std(axis=0) <= ROUNDING * spread)
        correlation = np.where(lost, 0.0, correlation)
        rms = np.sqrt(np.mean(error**2, axis=0))
        return {"slope": shared / spread**2, "correlation": correlation, "error": rms, "share": rms / spread}

    def __str__(self) -> str:
        """Return the largest difference of the channels, and the lowest correlation of all columns, as a sentence."""
        found = relative_differences(self.names, self.ours, self.theirs)
        error = np.abs(differences(self.names, self.ours, self.theirs)).max(axis=0)
        for name, e, scale in zip(self.names, error, self.scale, strict=True):
            found[name] *= float(e > ROUNDING * scale)  # a channel at rest differs by rounding
        worst = max((name for name in found if name not in AXES), key=lambda name: found[name])
        known = {
            n: r for n, r in zip(self.names, self.statistics["correlation"], strict=True) if np.isfinite(r)
        }
        lowest = min(known, key=lambda name: known[name], default="")
        correlation = f"; lowest correlation {known[lowest]:.3g} ({lowest})" if lowest else ""
        largest = without_rounding(found[worst], 1.0)
        within = f"{largest:.1e}" if largest else "0"
        return (
            f"{self.tool}, {self.flight}: within {within} of each channel's maximum ({worst}){correlation}."
        )


def unit_of(name: str) -> str:
    """Return the SI unit of an axis or a channel."""
    return AXES.get(name) or ("m/s2" if name in SPECIFIC else VARIABLES[name].unit)


def agreement_table(compared: Compared) -> sheet.Table:
    """Return the table of every axis and channel."""
    found, rows = compared.statistics, []
    columns = zip(compared.names, compared.scale, compared.spread, *found.values(), strict=True)
    for name, scale, spread, slope, correlation, error, share in columns:
        factor, unit = factor_and_unit(unit_of(name))
        sizes = (without_rounding(x, scale) for x in (spread, error))
        shown = (f"{compact(factor * x)} {unit}" if np.isfinite(x) else "–" for x in sizes)
        ratios = (number(without_rounding(x, 1.0), 3) for x in (slope, correlation))
        rows.append((name, *shown, percent(share), *ratios))
    head = ("", "standard deviation", "error, rms", "error, share", "slope", "correlation")
    return sheet.Table(f"{compared.tool}, {compared.flight}", head, tuple(rows))


def percent(share: float) -> str:
    """Return a share in percent; rounding errors as 0."""
    return f"{compact(100.0 * without_rounding(share, 1.0), 2)} %" if np.isfinite(share) else "–"


def loads_along(flight: ReferenceFlight, changes: Mapping[str, float] | None = None) -> FloatArray:
    """Return :data:`AXES` (n, 6) of a flight, with changed numbers at the same states."""
    rows = flight.vehicle.parameter_rows(changes, len(flight.states))
    return body_loads(flight.vehicle, rows, flight.states.T, flight.inputs.T).T


def loads_at(record: Record, states: FloatArray) -> FloatArray:
    """Return :data:`AXES` (n, 6) of a record at states (n, n_x), with its inputs as surfaces and rotors receive them."""
    vehicle, rows = record.vehicle, record.vehicle.parameter_rows(None, len(states))
    inputs = vehicle.late_inputs(record.inputs, vehicle.parameter_rows(), record.dt)
    return body_loads(vehicle, rows, states.T, inputs.T).T


def has_axes(vehicle: Vehicle) -> bool:
    """Return whether the equations have all of :data:`AXES`."""
    return vehicle.reduce == "full" and not vehicle.motion


def loads_of_path(flight: ReferenceFlight, states: FloatArray) -> tuple[tuple[str, ...], FloatArray]:
    """Return :data:`AXES` and their values (n, 6) from states (n, n_x) at the samples of a flight; none of reduced equations.

    The states are differentiated by central differences between restarts, which is the same for both simulations.
    """
    vehicle = flight.vehicle
    if not has_axes(vehicle):
        return (), np.zeros((len(states), 0))
    own = np.split(states, flight.restarts[1:])
    rates = np.concatenate([np.gradient(part, flight.dt, axis=0) for part in own])
    return tuple(AXES), motion_loads(vehicle, states.T, rates.T).T


def omitted_shares(flight: ReferenceFlight, omitted: Mapping[str, float]) -> dict[str, FloatArray]:
    """Return the share (6,) of each of :data:`AXES` that each omitted number makes along a flight.

    The share is the root mean square of the change over the standard deviation of the load; NaN for an axis without loads.

    Parameters
    ----------
    flight : ReferenceFlight
    omitted : mapping of number to the value at which it does nothing
    """
    whole = loads_along(flight)
    return {name: shares_of(loads_along(flight, {name: end}) - whole, whole) for name, end in omitted.items()}


def shares_of(change: FloatArray, loads: FloatArray) -> FloatArray:
    """Return the rms (6,) of a change of loads (n, 6) over their standard deviation; NaN for an axis without loads."""
    spread = Compared("", "", tuple(AXES), loads, loads).spread
    return np.asarray(np.sqrt(np.mean(change**2, axis=0)) / spread)


def omission(tool: str, name: str, shares: FloatArray) -> str:
    """Return the note on a term that a tool does not have, with its share of each axis."""
    kept = "of which it keeps the slope at the steady flight at most"
    return f"{tool} has no term for {name}, {kept}: {axis_shares(shares)} (rms along the compared flight)."


def axis_shares(shares: FloatArray) -> str:
    """Return shares (6,) of :data:`AXES` as text."""
    return ", ".join(f"{percent(x)} of {axis}" for axis, x in zip(AXES, shares, strict=True))


def agreement_page(title: str, compared: Sequence[Compared], notes: Sequence[str]) -> str:
    """Return the page of how a tool's flights agree with ours, as HTML."""
    sections = [sheet.Section("Agreement", (sheet.Prose(EXPLANATION), *map(agreement_table, compared)))]
    sections += [sheet.Section("Notes", (sheet.Bullets(notes),))] if notes else []
    return sheet.render_sheet(
        sheet.Sheet(title, "Every axis and channel, by our simulation and by the tool.", tuple(sections))
    )
