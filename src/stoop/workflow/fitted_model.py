"""A fitted model: a vehicle at its estimates, the result, the flights and the evidence, and what can be done with them.

The verbs of a fitted model are functions of this package, imported at their first use. Everything happens in memory; the folder
of a model is what `FittedModel.save` writes and `stoop.load` reads.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from functools import cached_property
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stoop.assessment.assessment import Assessment
from stoop.assessment.verdict import verdict
from stoop.base.arrays import FloatArray
from stoop.base.notices import Notice, notice
from stoop.base.text import Names, printable, printable_lines
from stoop.errors import StoopError
from stoop.estimate import methods
from stoop.estimate.estimate import Estimate
from stoop.flight import Flight
from stoop.prediction.initial_state import BiasPrior, bias_priors
from stoop.prediction.predict import ForceFigures, force_figures
from stoop.problem import Piece
from stoop.problem.prepare import Prepared, decoupled
from stoop.problem.windows import Window
from stoop.results.decisions import switched_off
from stoop.results.result import AirDataTrace, ManeuverTrace, ParameterEstimate, Quantity, Result, Role
from stoop.results.uncertainty import Components
from stoop.results.verdict import Verdict
from stoop.vehicle import Vehicle
from stoop.vehicle.notation import symbols
from stoop.workflow.archive import packed, unpacked
from stoop.workflow.curves import channel_units
from stoop.workflow.model_methods import ModelMethods, add_methods
from stoop.workflow.outputs import ESTIMATE, RESULT, check_folder, place_outputs
from stoop.workflow.summary import refusal

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from stoop.report.identification import Plots


@dataclass(frozen=True, eq=False, repr=False)
class FittedModel(ModelMethods):
    """A fitted model, as :func:`stoop.fit` returns it and :func:`stoop.load` reads it.

    Attributes
    ----------
    vehicle : Vehicle
        With its free numbers at their estimates.
    result : Result
        Estimates, covariance, noise, figures and verdict: the content of ``result.json``.
    flights : tuple of Flight
        As they were fitted, air data reconstructed; none if the folder has lost them, see `missing`.
    traces : tuple of ManeuverTrace
        Measured and simulated readings of each of ``result.maneuvers``.
    fresh : Estimate, optional
        Of a fit of this session; that of a folder is read from `archive` at its first use.
    archive : bytes
        State of the estimate, see :attr:`estimate`; empty for a folder of an older version.
    convergence : (k, 2) array
        Trajectories spent, and the best cost so far.
    command : str
        Command line that fitted the model, for the report.
    files : tuple of Path
        Files that were read; :meth:`save` never writes over them.
    attachments : mapping of str to bytes
        Further files of the folder, by name.
    folder : Path, optional
        Where the model was read from.
    missing : str
        Why there are no flights.
    """

    vehicle: Vehicle
    result: Result
    flights: tuple[Flight, ...] = ()
    traces: tuple[ManeuverTrace, ...] = ()
    fresh: Estimate | None = None
    archive: bytes = b""
    convergence: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    command: str = ""
    files: tuple[Path, ...] = ()
    attachments: Mapping[str, bytes] = field(default_factory=dict)
    folder: Path | None = None
    missing: str = ""

    @property
    def uncertainty(self) -> Components:
        """What each component adds to the variances of the parameters; prints as a table."""
        return self.result.components

    def assess(self, *assessments: Assessment, watch: Callable[[str], None] | None = None) -> FittedModel:
        """Return this model with the uncertainty by further methods.

        Parameters
        ----------
        *assessments : Bootstrap, Profile, Posterior, or one of your own
        watch : callable, optional
            Gets a line of progress now and then.

        Raises
        ------
        StoopError
            The folder of the model holds no evidence of the fit, or the method cannot be assessed so.
        """
        from stoop.assessment.assessment import assess
        from stoop.strategy.decision import test

        tested, cut = test(self.estimate, self.uncertainty.left_out)
        if cut:
            raise KeyboardInterrupt
        watch = watch or (lambda text: None)
        result, files = assess(self.result, self.estimate, tested.bars, assessments, watch)
        return replace(self.with_result(result), attachments={**self.attachments, **files})

    @cached_property
    def estimate(self) -> Estimate:
        """Evidence of the estimator: residuals, sensitivities and the problem near the optimum.

        Raises
        ------
        StoopError
            The folder of the model is of an older version, which kept none, or does not hold that of its result.
        """
        if self.fresh is not None:
            return self.fresh
        where = f"{self.source}: {ESTIMATE}"
        if not self.archive:
            raise StoopError(f"{where} is missing, so that the fit cannot be assessed; fit again")
        found = methods.restore(self.result.method, unpacked(self.archive, where), where)
        if found.estimates != {name: p.estimate for name, p in self.parameters.items()}:
            raise StoopError(f"{where}: holds another fit than {RESULT} beside it; fit again")
        return found

    @property
    def evidence(self) -> bytes:
        """State of the estimate as an archive; empty where there is none."""
        return self.archive or (packed(self.fresh.state()) if self.fresh else b"")

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields for pickle; the estimate of this session becomes its archive."""
        kept = {f.name: getattr(self, f.name) for f in fields(self)}
        return kept | {"fresh": None, "archive": self.evidence}

    def with_result(self, result: Result) -> FittedModel:
        """Return this model with another result, its verdict made anew."""
        return replace(self, result=replace(result, verdict=verdict(result, result.verdict.uses)))

    def save(self, folder: str | Path, overwrite: bool = False) -> Path:
        """Write ``result.json``, ``vehicle.toml``, ``flight.nc`` and ``report.html`` into a folder, which is returned.

        Raises
        ------
        OutputError
            The folder cannot be written, or holds a file of the model or an earlier result.
        """
        place = Path(folder)
        check_folder(place, [f.name for f in self.flights], overwrite, self.files, tuple(self.attachments))
        return place_outputs(self, place, overwrite)

    @property
    def verdict(self) -> Verdict:
        """Whether to use the model, for what, and why."""
        return self.result.verdict

    @property
    def parameters(self) -> Mapping[str, ParameterEstimate]:
        """Estimates by name, such as ``model.parameters["Clp"].std_error``."""
        return Names(self.result.parameters)

    @property
    def notices(self) -> tuple[Notice, ...]:
        """Findings about the data and the fit."""
        return self.result.notices

    @property
    def source(self) -> str:
        """Where the model comes from, for messages."""
        return f"the fit of {self.vehicle.name}" if self.folder is None else str(self.folder)

    @property
    def refusal(self) -> list[Notice]:
        """The warning that its verdict refuses it, if it does."""
        return refusal(self.result, self.source)

    @property
    def plot(self) -> Plots:
        """Plots, such as ``model.plot.maneuvers()``."""
        from stoop.report.identification import Plots

        return Plots(self)

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row for each parameter, indexed by its name."""
        return self.result.to_dataframe()

    def to_xarray(self) -> xr.Dataset:
        """Return estimates, covariance, measured and simulated readings, labeled; see `stoop.results.labelled`."""
        from stoop.results.labelled import to_xarray

        return to_xarray(self.result, self.traces, self.units, self.vehicle.name)

    def to_arviz(self) -> Any:
        """Return the draws of the posterior as `arviz.InferenceData`, once one was drawn."""
        from stoop.results.labelled import to_arviz

        return to_arviz(self.attachments)

    def __repr__(self) -> str:
        """Return vehicle, size and status on one line."""
        r = self.result
        return printable(f"<FittedModel of {self.vehicle.name}: {r.free_count}, {r.method}, {r.status}>")

    def _repr_html_(self) -> str:
        return f'<p style="white-space: pre-line">{escape(str(self.verdict))}</p>{self.result._repr_html_()}'

    def __str__(self) -> str:
        """Return the verdict with its strongest reasons, the decisions, and the estimates as a table."""
        from stoop.results.decisions import decision_lines
        from stoop.workflow.summary import estimates_table

        decisions = "\n".join(decision_lines(self.result.decisions))
        parts = str(self.verdict), decisions, estimates_table(self.result.parameters)
        return printable_lines("\n\n".join(filter(None, parts)))

    @property
    def by_name(self) -> dict[str, Flight]:
        """Flights by name; raises `StoopError` if the folder has lost them."""
        if self.missing:
            raise StoopError(self.missing)
        return {flight.name: flight for flight in self.flights}

    def windows(self, role: Role = "fit") -> list[Window]:
        """Return the windows that were fitted, or predicted beside the fit."""
        own = [m for m in self.result.maneuvers if m.role == role]
        return [Window(m.flight, m.start, m.stop, m.loading or None) for m in own]

    def extrapolation(self, *airspeeds: float) -> list[Notice]:
        """Return a notice where airspeeds, m/s, lie more than a tenth outside those of the fitted maneuvers."""
        fitted = [t for t, m in zip(self.traces, self.result.maneuvers, strict=True) if m.role == "fit"]
        speeds = [t.channels["V"].measured for t in fitted if "V" in t.channels]
        flown = np.concatenate([np.empty(0), *speeds])
        if not np.isfinite(flown).any():
            return []
        first, last = float(np.nanmin(flown)), float(np.nanmax(flown))
        if not (min(airspeeds) < 0.9 * first or max(airspeeds) > 1.1 * last):
            return []
        asked = " to ".join(f"{x:.4g}" for x in sorted(set(airspeeds)))
        return [notice("airspeed-not-flown", f"{asked} m/s", first=first, last=last)]

    @cached_property
    def coupled(self) -> Vehicle:
        """The vehicle as it was fitted: with the states that it leaves out taken from the record, unless that was off."""
        off = switched_off(self.result.decisions, "recorded-motion")
        return self.vehicle if self.missing or off else decoupled(self.vehicle, self.by_name, self.windows())

    def pieces(self) -> list[list[Piece]]:
        """Return the pieces of each fitted maneuver; raises `StoopError` if the flights are missing."""
        prepared = Prepared.of(self.coupled, self.by_name, self.windows())
        return [[prepared.pieces[i] for i in prepared.of_maneuver(m)] for m in range(len(prepared.windows))]

    def biases(self, flight: str | None) -> dict[str, BiasPrior]:
        """Return the prior of each sensor bias in a window of a flight, from the biases of the fitted maneuvers."""
        fitted = []
        for own in self.result.biases:
            values = {f"sensors.{name}.bias": one.estimate for name, one in own.values.items()}
            fitted.append((self.result.maneuvers[own.maneuver].flight, values))
        return bias_priors(fitted, flight, {p.name: p.prior or 1.0 for p in self.vehicle.parameters})

    @cached_property
    def forces(self) -> tuple[ForceFigures, ...]:
        """Residuals of the specific force in each window, of a vehicle with rotors."""
        windows = self.windows(), self.windows("validation")
        return () if self.missing else force_figures(self.coupled, self.by_name, *windows, self.biases)

    @property
    def equations(self) -> tuple[str, ...]:
        """Equations of the model as LaTeX."""
        return self.coupled.kernel().latex

    @cached_property
    def units(self) -> Mapping[str, str]:
        """Unit of every channel and input."""
        return channel_units(self.vehicle)

    @cached_property
    def symbols(self) -> Mapping[str, str]:
        """LaTeX symbol of each number."""
        return symbols(self.vehicle)

    @property
    def air_data(self) -> tuple[AirDataTrace, ...]:
        """Air data of each flight that they were reconstructed for, as logged and as reconstructed."""
        out = []
        for name, traces in ((f.name, dict(f.air.traces)) for f in self.flights if f.air is not None):
            if (time := traces.pop("time", None)) is not None:
                out.append(AirDataTrace(name, time, traces))
        return tuple(out)

    @property
    def body(self) -> Mapping[str, Quantity]:
        """Mass, inertia and reference values; the standard error is NaN where the vehicle file fixes them."""
        own = [p for p in self.vehicle.parameters if p.name.startswith(("mass.", "reference."))]
        given = {p.name: Quantity(p.value, np.nan, p.unit) for p in own}
        estimates = self.result.parameters.items()
        return given | {n: Quantity(p.estimate, p.std_error, p.unit) for n, p in estimates if n in given}


add_methods(FittedModel)
