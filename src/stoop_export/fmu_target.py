"""Target ``fmu``: Functional Mock-up Units of both versions of the interface, flown by FMPy where it is installed."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np

from stoop.extend.arrays import FloatArray
from stoop.extend.errors import StoopError
from stoop.extend.notices import notice
from stoop.extend.text import printable
from stoop.extend.verbs import install
from stoop_export import fmu
from stoop_export.agreement import Compared, loads_of_path
from stoop_export.exporter import Exported, Exporter, installed, written
from stoop_export.jsbsim_flight import file_name
from stoop_export.reference_flight import ReferenceFlight, slopes

INSTALL: Final = install("fmi")


def fly_unit(place: Path, flight: ReferenceFlight, variables: Sequence[str] = ()) -> FloatArray:
    """Return variables (n, k) of a unit at the samples of a flight, its readings where none are named, by FMPy.

    The communication step is the sample period.

    Raises
    ------
    StoopError
        FMPy is not installed, or the unit has no library for this platform.
    """
    try:
        import fmpy as imported
    except ModuleNotFoundError:
        raise StoopError(f"FMPy: the package is not installed; {INSTALL}") from None
    fmpy: Any = imported
    vehicle = flight.vehicle
    known = {v.name for v in fmpy.read_model_description(str(place)).modelVariables}
    names = [n for n in vehicle.inputs if n in known and f"{n}.slope" in known]
    columns = [vehicle.inputs.index(n) for n in names]
    signals = np.zeros(
        len(flight.time), dtype=[(n, float) for n in ("time", *names, *(f"{n}.slope" for n in names))]
    )
    rates = slopes(flight.inputs, flight.dt)
    for name, column in zip(names, columns, strict=True):
        signals[name], signals[f"{name}.slope"] = flight.inputs[:, column], rates[:, column]
    read = [*(variables or vehicle.outputs)]
    out = np.full((len(flight.time), len(read)), np.nan)
    unpacked = fmpy.extract(str(place))
    try:
        for part in flight.parts():
            local = signals[part].copy()
            local["time"] = flight.time[part] - flight.time[part.start]
            start = {
                f"start.{n}": x
                for n, x in zip(vehicle.states, flight.states[part.start].tolist(), strict=True)
            }
            found = fmpy.simulate_fmu(
                unpacked, stop_time=float(local["time"][-1]), step_size=flight.dt, output_interval=flight.dt,
                input=local, output=read, start_values=start, fmi_type="CoSimulation",
            )  # fmt: skip
            out[part] = np.column_stack([found[n] for n in read])
    except Exception as error:  # FMPy raises Exception itself
        raise StoopError(f"FMPy: {printable(str(error))}") from None
    finally:
        shutil.rmtree(unpacked, ignore_errors=True)
    return out


class FMU(Exporter):
    """Units with the equations, for co-simulation."""

    @cached_property
    def compiler(self) -> str | None:
        """The C compiler; None where there is none."""
        return fmu.find_compiler()

    def files(self) -> Exported:
        """Return a unit of each version."""
        unit, name = (
            fmu.make_unit(self.vehicle, self.point, self.model.covariance),
            file_name(self.vehicle.name),
        )
        files = {f"{name}-fmi{v[0]}.fmu": fmu.unit_bytes(unit, v, self.compiler) for v in fmu.VERSIONS}
        return Exported(files, f"{name}-fmi3.fmu", self.model.unidentified)

    def lacks(self) -> list[str]:
        """Return dead zones, rate limits and delays, and what they make."""
        return self.without_actuators(
            lambda numbers: str(notice("functions-without-actuators", numbers=numbers))
        )

    def fly(self, made: Exported) -> Exported:
        """Fly both units along the reference flight."""
        if self.compiler is None:
            return made.with_notes(
                ["The units hold sources only, no C compiler was found: fmpy compile NAME.fmu"]
            )
        if not installed("fmpy"):
            return made.with_notes([f"Not flown: the package fmpy is not installed; {INSTALL}."])

        def compare(made: Exported, flight: ReferenceFlight) -> Exported:
            outputs, states, flown = self.vehicle.outputs, self.vehicle.states, []
            read = (*outputs, *(f"state.{name}" for name in states))
            axes, own = loads_of_path(flight, flight.states)
            with written(made.files) as root:
                for version, place in zip(fmu.VERSIONS, made.files, strict=True):
                    found = fly_unit(root / place, flight, read)
                    names, ours = (*axes, *outputs), np.hstack([own, flight.readings])
                    loads = loads_of_path(flight, found[:, len(outputs) :])[1]
                    theirs = np.hstack([loads, found[:, : len(outputs)]])
                    flown.append(Compared(f"FMI {version} in FMPy", flight.title, names, ours, theirs))
            return made.with_flights(flown)

        return self.along_reference(made, self.point, compare)
