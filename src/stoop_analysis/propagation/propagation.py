"""What the uncertainty of a result means: its draws carried into what the model says, as one labelled object."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from stoop import Notice, Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.notices import notice
from stoop.extend.text import number, printable, table
from stoop_analysis.draws import Draws
from stoop_analysis.propagation.expressions import Expression, parse_expressions
from stoop_analysis.propagation.quantities import (
    PERCENTILES,
    Curve,
    Figure,
    conditional_draws,
    figure,
    variance_removed,
)
from stoop_analysis.propagation.rotor_figures import rotor_figures
from stoop_analysis.propagation.wing_figures import FEW, Domain, Found, Grouped, wing_figures

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

FORMAT: Final = "stoop-propagation/1"
EXPRESSIONS: Final = "Expressions"


@dataclass(frozen=True, eq=False)
class Propagation:
    """Quantities of a model with their uncertainty; SI and rad."""

    vehicle: str
    result: str  #: where the model comes from
    source: str  #: of the draws: "posterior" or "covariance"
    count: int  #: of the draws
    seed: int
    domain: Domain
    figures: tuple[Figure, ...]
    curves: tuple[Curve, ...]
    samples: Mapping[str, FloatArray]  #: (D,), the draws of every figure
    notices: tuple[Notice, ...]
    expressions: Mapping[str, str] = field(default_factory=dict)
    undetermined: tuple[str, ...] = ()
    #: m/s, stretches of the curves outside of what was fitted
    extrapolated: tuple[tuple[float, float], ...] = ()
    seconds: float = 0.0

    def __getitem__(self, name: str) -> Figure:
        """Return a figure by its name."""
        found = {one.name: one for one in self.figures}
        return found[name]

    def to_dataframe(self) -> pd.DataFrame:
        """Return the figures, one a row, by their names."""
        import pandas as pd

        keys = [one.name for one in fields(Figure) if one.name not in ("name", "sources")]
        rows = {one.name: {key: getattr(one, key) for key in keys} for one in self.figures}
        return pd.DataFrame.from_dict(rows, orient="index", columns=keys).rename_axis("quantity")

    def to_xarray(self) -> xr.Dataset:
        """Return the curves over the airspeed with their percentiles, each with its unit."""
        import xarray as xr

        parts = []
        for one in self.curves:
            units = {"units": one.unit}
            variables: dict[str, Any] = {one.name: ("airspeed", one.estimate, units)}
            variables[f"{one.name} bands"] = (("percentile", "airspeed"), one.bands, units)
            speeds = ("airspeed", one.airspeed, {"units": "m/s"})
            coordinates = {"airspeed": speeds, "percentile": list(PERCENTILES)}
            parts.append(xr.Dataset(variables, coordinates))
        return xr.merge(parts, join="outer")

    def document(self) -> dict[str, Any]:
        """Return all but the draws for JSON, SI and rad."""
        curves = []
        for c in self.curves:
            bands = {f"p{p:g}": band for p, band in zip(PERCENTILES, c.bands, strict=True)}
            columns = {"airspeed": c.airspeed, "estimate": c.estimate, "failed": c.failed, **bands}
            curves.append({"name": c.name, "unit": c.unit, **{k: x.tolist() for k, x in columns.items()}})
        return {
            "format": FORMAT,
            "vehicle": self.vehicle,
            "result": self.result,
            "source": self.source,
            "draws": self.count,
            "seed": self.seed,
            "condition": asdict(self.domain),
            "expressions": dict(self.expressions),
            "figures": [asdict(one) for one in self.figures],
            "curves": curves,
            "undetermined": list(self.undetermined),
            "extrapolated": [list(one) for one in self.extrapolated],
            "notices": [one.to_dict() for one in self.notices],
            "seconds": self.seconds,
        }

    def __repr__(self) -> str:
        """Return the size on one line."""
        return printable(
            f"<Propagation of {self.vehicle}: {len(self.figures)} figures, {len(self.curves)} curves, {self.count} draws>"
        )

    def _repr_html_(self) -> str:
        rows = []
        for f in self.figures:
            interval = f"{number(f.ci95_lower)} … {number(f.ci95_upper)}"
            rows.append((f.name, number(f.estimate), number(f.std_error), interval, f.unit))
        return table(repr(self).strip("<>"), ("quantity", "estimate", "std error", "95 %", "unit"), rows)


def propagate_draws(
    vehicle: Vehicle,
    draws: Draws,
    domain: Domain,
    expressions: Mapping[str, str] | None = None,
    result: str = "",
    seed: int = 0,
) -> Propagation:
    """Return what a vehicle at its estimates, and draws of its parameters, say.

    Raises
    ------
    StoopError
        An expression with an unknown name, or nothing trims at the estimates.
    """
    begun = time.perf_counter()
    parsed = parse_expressions(expressions or {}, vehicle)
    found, grouped = _quantities(vehicle, draws.names, draws.values, domain, parsed)
    figures = figures_of(
        vehicle, draws, grouped, lambda values: _quantities(vehicle, draws.names, values, domain, parsed)[1]
    )
    notices = [*draws.notices, *found.notices, *_figure_notices(figures, draws.undetermined)]
    return Propagation(
        vehicle.name, result, draws.source, len(draws.values), seed, domain,
        figures, found.curves, {s.name: s.draws for _, s in grouped},
        tuple(notices), dict(expressions or {}), draws.undetermined, found.extrapolated,
        time.perf_counter() - begun,
    )  # fmt: skip


def figures_of(
    vehicle: Vehicle,
    draws: Draws,
    grouped: Sequence[Grouped],
    again: Callable[[FloatArray], Sequence[Grouped]],
) -> tuple[Figure, ...]:
    """Return quantities of draws with their uncertainty, and the share of it that is that of priors and bounds.

    Parameters
    ----------
    grouped : the quantities of the draws
    again : the quantities of other values (D, k) of the same parameters
    """
    known, shares = np.isin(draws.names, draws.undetermined), dict[str, float]()
    if known.any():
        at = np.array([vehicle.value(name) for name in draws.names])
        held = conditional_draws(draws.values, known, at)
        given = {one.name: one.draws for _, one in again(held)}
        none = np.full(len(held), np.nan)
        shares = {
            s.name: variance_removed(s.draws, given.get(s.name, none), int(known.sum())) for _, s in grouped
        }
    return tuple(figure(g, s, draws.names, draws.values, shares.get(s.name, 0.0)) for g, s in grouped)


def _quantities(
    vehicle: Vehicle,
    names: Sequence[str],
    values: FloatArray,
    domain: Domain,
    parsed: Mapping[str, Expression],
) -> tuple[Found, list[Grouped]]:
    """Return what a vehicle says at its estimates and with the values (D, k) of the parameters named, expressions included."""
    changes = dict(zip(names, values.T, strict=True))
    rows = np.hstack([vehicle.parameter_rows(), vehicle.parameter_rows(changes, len(values))])
    found = (rotor_figures if vehicle.rotors else wing_figures)(vehicle, rows, domain)
    return found, [*found.figures, *((EXPRESSIONS, one.samples(rows)) for one in parsed.values())]


def _figure_notices(figures: Sequence[Figure], undetermined: tuple[str, ...]) -> Iterator[Notice]:
    """Yield one notice of the figures that rest on priors, and one of those that do not exist for some of the draws."""
    if on_prior := tuple(one.name for one in figures if one.rests_on_prior):
        yield notice("propagate-rests-on-priors", figures="; ".join(on_prior), parameters=undetermined)
    if failed := {one.name: one.failed for one in figures if one.failed > FEW}:
        yield notice("propagate-figure-failed", figures="; ".join(failed), share=max(failed.values()))
