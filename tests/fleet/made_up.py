"""A made-up fleet: thrusts of a rotor that is exchanged once, drags, a season and an update."""

from dataclasses import replace

import numpy as np

from stoop_fleet.analysis import DAY
from stoop_fleet.parts import Fitting, Parts
from stoop_fleet.table import FigureTable

VEHICLES, FLIGHTS = 8, 50
EXCHANGED, UPDATED = 20, 35  #: flights
LEVEL, PART, FLIGHT = 0.05, 0.02, 0.01  #: standard deviations
CHANGED = "v3"


def fleet(seed: int = 1) -> tuple[FigureTable, Parts]:
    rng, fittings, rows = np.random.default_rng(seed), [], []
    for v in range(VEHICLES):
        name, days = f"v{v}", np.sort(rng.uniform(0.0, 365.0, FLIGHTS))
        moment = float(days[EXCHANGED] * DAY - 1.0)
        fittings += [Fitting(name, "rotor_1", f"{name}a", -np.inf, moment),
                     Fitting(name, "rotor_1", f"{name}b", moment, np.inf)]  # fmt: skip
        for figure, place in (("thrust", "rotor_1"), ("drag", "")):
            level, part = LEVEL * rng.standard_normal(), PART * rng.standard_normal(2)
            for i, day in enumerate(days):
                season, error = np.sin(day / 58.0), rng.uniform(0.01, 0.03)
                own = part[int(i >= EXCHANGED)] if place else 0.0
                value = 1.0 + level + own + 0.03 * season + np.hypot(FLIGHT, error) * rng.standard_normal()
                software = "1.1" if i >= UPDATED else "1.0"
                rows.append((day * DAY, f"{name}-{i}", name, figure, software, place, value, error, season))
    time, *texts, value, error, season = zip(*sorted(rows), strict=True)
    names = ("flight", "vehicle", "figure", "software", "parts")
    numbers = {"time": np.array(time), "value": np.array(value), "std_error": np.array(error)}
    columns = dict(zip(names, texts, strict=True))
    table = FigureTable.of_columns(columns, numbers, {"season": np.array(season)})
    return table, Parts(tuple(fittings))


def changed(table: FigureTable, figure: str, first: int, size: float) -> FigureTable:
    own = [v == CHANGED and f == figure for v, f in zip(table.vehicle, table.figure, strict=True)]
    late = [int(flight.partition("-")[2]) >= first for flight in table.flight]
    return replace(table, value=table.value + size * (np.array(own) & np.array(late)))
