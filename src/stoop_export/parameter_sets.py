"""Parameter sets for domain randomization: draws of a fitted model, as a simulator's own numbers.

Each set is computed from one draw of all parameters, so that the correlations of the estimates are kept.
"""

from __future__ import annotations

import io
import json
from abc import abstractmethod
from collections.abc import Mapping
from dataclasses import replace
from functools import cached_property
from typing import Any, Final

import numpy as np

from stoop import Vehicle
from stoop.extend.arrays import FloatArray
from stoop.extend.errors import SimulationError, VehicleError
from stoop.extend.motion import Trim
from stoop.extend.text import count
from stoop_export.exporter import Exported, FullExporter

FORMAT: Final = "stoop-draws/1"
FILES: Final = ("draws.json", "draws.npz")


class RandomizedExporter(FullExporter):
    """A target that takes parameter sets."""

    @abstractmethod
    def numbers_of(self, vehicle: Vehicle) -> Mapping[str, Any]:
        """Return the simulator's numbers of a vehicle: scalars and arrays; SimulationError where it has no steady flight."""

    def steady(self, vehicle: Vehicle) -> Trim:
        """Return the steady flight of another vehicle at the condition."""
        return replace(self.full, vehicle=vehicle).trim(self.condition)

    @cached_property
    def drawn(self) -> tuple[dict[str, FloatArray], int]:
        """The numbers (D, ...) of the parameter sets, and how many draws have no steady flight."""
        names = [n for n in self.model.draws if n in self.vehicle.rows]
        sets: list[dict[str, FloatArray]] = []
        values = np.column_stack([self.model.draws[n] for n in names])
        for row in values.tolist():
            changes = {n: {"value": x} for n, x in zip(names, row, strict=True)}
            try:
                vehicle = self.vehicle.with_numbers(changes)
                sets.append({n: np.asarray(x) for n, x in self.numbers_of(vehicle).items()})
            except (SimulationError, VehicleError):
                continue
        lost = len(values) - len(sets)
        if not sets:
            raise SimulationError(
                f"{self.vehicle.where}: none of {lost} draws has a steady flight; fit again, or fix what the report calls not "
                "identifiable"
            )
        return {n: np.array([s[n] for s in sets]) for n in sets[0]}, lost

    def with_draws(self, made: Exported) -> Exported:
        """Return the files with the parameter sets; SimulationError where these hold no number."""
        if not self.model.draws:
            return made
        sets, lost = self.drawn
        if not sets:
            raise SimulationError(
                f"{self.vehicle.where}: the draws differ from the estimates in no number of the simulator; leave --draws out"
            )
        number = len(next(iter(self.model.draws.values()))) - lost
        content = {"format": FORMAT, "vehicle": self.vehicle.name, "draws": number}
        lists = {n: x.tolist() for n, x in sets.items()}
        table, arrays = io.BytesIO(), json.dumps({**content, "numbers": lists}, allow_nan=False) + "\n"
        np.savez_compressed(table, allow_pickle=False, **sets)
        notes = [f"{count(number, 'parameter set')} with correlations: {', '.join(FILES)}."]
        notes += [f"{count(lost, 'draw')} without a steady flight left out."] if lost else []
        files = dict(zip(FILES, (arrays.encode(), table.getvalue()), strict=True))
        return replace(made, files={**made.files, **files}, notes=(*made.notes, *notes))
