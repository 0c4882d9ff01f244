"""Results as labelled tables and arrays: pandas, xarray and ArviZ, each imported when it is asked for."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.extras import install
from stoop.base.html import table
from stoop.base.numbers import number, rounded_to_error
from stoop.errors import StoopError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from stoop.results.result import ManeuverTrace, Result

COLUMNS = (
    "estimate", "std_error", "ci95_lower", "ci95_upper", "unit", "identifiable", "at_bound", "start",
    "bound_lower", "bound_upper", "prior_mean", "prior_std",
)  # fmt: skip


def to_dataframe(result: Result) -> pd.DataFrame:
    """Return one row for each parameter, indexed by its name; columns are those of `ParameterEstimate`."""
    import pandas as pd

    rows = [[getattr(one, column) for column in COLUMNS] for one in result.parameters.values()]
    return pd.DataFrame(rows, index=pd.Index(result.parameters, name="parameter"), columns=list(COLUMNS))


def to_xarray(
    result: Result, traces: Sequence[ManeuverTrace], units: Mapping[str, str], vehicle: str
) -> xr.Dataset:
    """Return estimates, covariance, and measured and simulated readings of every maneuver of a vehicle.

    Returns
    -------
    xarray.Dataset
        ``estimate``, ``std_error`` over ``parameter``; ``covariance`` over (``parameter``, ``parameter_2``) in the products
        of the parameters' units; ``measured``, ``simulated``, ``residual`` over (``sample``, ``channel``), SI, NaN where
        nothing was measured; ``maneuver`` (index), ``role`` and ``time`` (s, the log's own clock) along ``sample``.
    """
    import xarray as xr

    names = list(result.parameters)
    channels = list(dict.fromkeys(c for trace in traces for c in trace.channels))
    lengths = [trace.time.size for trace in traces]

    def stacked(kind: str) -> FloatArray:
        """Return readings (n, n_y) of a kind, all maneuvers one after the other."""
        out = np.full((sum(lengths), len(channels)), np.nan)
        for rows, trace in zip(np.split(out, np.cumsum(lengths)), traces, strict=False):
            for channel, own in trace.channels.items():
                rows[:, channels.index(channel)] = getattr(own, kind)
        return out

    measured, simulated = stacked("measured"), stacked("simulated")
    index = np.repeat(np.arange(len(lengths)), lengths)
    roles = np.array([m.role for m in result.maneuvers])
    time = np.concatenate([trace.time for trace in traces]) if lengths else np.empty(0)
    matrix = np.full((len(names), len(names)), np.nan)
    place = [names.index(name) for name in result.covariance.names]
    matrix[np.ix_(place, place)] = result.covariance.matrix
    return xr.Dataset(
        {
            "estimate": ("parameter", [p.estimate for p in result.parameters.values()]),
            "std_error": ("parameter", [p.std_error for p in result.parameters.values()]),
            "covariance": (("parameter", "parameter_2"), matrix),
            "measured": (("sample", "channel"), measured),
            "simulated": (("sample", "channel"), simulated),
            "residual": (("sample", "channel"), measured - simulated),
        },
        coords={
            "parameter": names,
            "parameter_2": names,
            "unit": ("parameter", [p.unit for p in result.parameters.values()]),
            "channel": channels,
            "channel_unit": ("channel", [units.get(c, "") for c in channels]),
            "maneuver": ("sample", index),
            "role": ("sample", roles[index] if index.size else np.empty(0, dtype="U10")),
            "time": ("sample", time),
        },
        attrs={"vehicle": vehicle, "cost": result.cost, "method": result.method},
    )


def to_arviz(attachments: Mapping[str, bytes]) -> Any:
    """Return the draws of the posterior as `arviz.InferenceData`.

    Raises
    ------
    StoopError
        No posterior was drawn, or ArviZ is not installed.
    """
    content = attachments.get("posterior.nc")
    if content is None:
        raise StoopError("no posterior was drawn; assess the result with stoop.Posterior() first")
    try:
        import arviz
    except ImportError:
        raise StoopError(f"ArviZ is not installed; {install('posterior')}") from None
    with tempfile.TemporaryDirectory(prefix="stoop-") as folder, arviz.rc_context({"data.load": "eager"}):
        path = Path(folder) / "posterior.nc"
        path.write_bytes(content)
        return arviz.from_netcdf(str(path), engine="h5netcdf")


def html_table(result: Result) -> str:
    """Return the estimates as a small HTML table, for a notebook."""
    rows = []
    for name, one in result.parameters.items():
        value, error = rounded_to_error(one.estimate, one.std_error)
        ends = f"{number(one.ci95_lower)} … {number(one.ci95_upper)}"
        interval = ends if one.identifiable else "not identifiable"
        rows.append((name, value, error, "" if one.unit == "1" else one.unit, interval))
    heads = ("parameter", "estimate", "std. error", "unit", "95 % interval")
    return table(repr(result).strip("<>"), heads, rows)
