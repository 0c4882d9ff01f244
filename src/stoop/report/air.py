"""Air data of whole flights: what the log says beside what was reconstructed."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from markupsafe import Markup

from stoop.base.arrays import FloatArray
from stoop.base.numbers import factor_and_unit
from stoop.report.charts import LARGE, plain_panel
from stoop.report.matches import Panel, sane
from stoop.results.result import AirDataTrace, Identification

HEIGHT: Final = 150.0  #: px
PAUSE: Final = 0.3  #: s without a sample break a curve
COLORS: Final = 4  #: classes air0, air1, ... of the style sheet


@dataclass(frozen=True)
class _Group:
    """Curves that share a drawing: name in the trace -> what the reader is told."""

    title: str
    unit: str
    curves: Mapping[str, str]


GROUPS: Final = (
    _Group(
        "Airspeed",
        "m/s",
        {
            "speed_inertial": "ground velocity minus wind",
            "pitot": "pitot as logged",
            "airspeed_pitot": "pitot as logged",
            "pitot_corrected": "pitot, corrected",
            "V": "V",
        },
    ),
    _Group("Wind as logged", "m/s", {"wind_n_log": "north", "wind_e_log": "east"}),
    _Group("Angle of attack", "rad", {"alpha": "alpha"}),
    _Group("Sideslip", "rad", {"beta": "reconstructed", "beta_from_force": "from lateral force"}),
)


def air_panels(identification: Identification) -> list[tuple[str, list[Panel]]]:
    """Return by flight the drawings of its air data; curves of no known kind get one each."""
    return [(air.flight, _panels(identification, air)) for air in identification.air_data]


def _panels(identification: Identification, air: AirDataTrace) -> list[Panel]:
    known = {name for group in GROUPS for name in group.curves}
    others = [
        _Group(name, identification.units.get(name, ""), {name: name})
        for name in air.curves
        if name not in known
    ]
    return [
        _panel(air, group) for group in (*GROUPS, *others) if any(name in air.curves for name in group.curves)
    ]


def _panel(air: AirDataTrace, group: _Group) -> Panel:
    factor, unit = factor_and_unit(group.unit)
    there = [name for name in group.curves if name in air.curves]
    time, curves = _broken(air.time, [sane(factor * air.curves[name]) for name in there])
    kinds = [f"air{i % COLORS}" for i in range(len(there))]
    # Later curves are drawn over earlier ones: what was reconstructed comes first and is drawn last.
    drawn = plain_panel(
        time, list(zip(kinds, curves, strict=True))[::-1], f"{group.title} over the flight.", LARGE, HEIGHT
    )
    keys = Markup(" ").join(
        Markup('<span class="key {}">{}</span>').format(kind, group.curves[name])
        for kind, name in zip(kinds, there, strict=True)
    )
    return Panel(Markup("{}").format(group.title), keys, unit, None, drawn)


def _broken(time: FloatArray, curves: list[FloatArray]) -> tuple[FloatArray, list[FloatArray]]:
    """Return time and curves with a NaN wherever nothing was recorded for a while."""
    steps = np.diff(time)
    pauses = np.flatnonzero(steps > max(PAUSE, 5.0 * float(np.median(steps)) if steps.size else PAUSE)) + 1
    return np.insert(time, pauses, np.nan), [np.insert(curve, pauses, np.nan) for curve in curves]
