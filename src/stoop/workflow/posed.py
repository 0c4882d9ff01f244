"""A fit's problem as one text: what a worker needs to refit it, wherever it runs."""

from __future__ import annotations

import base64
import io
import json
from collections.abc import Mapping
from dataclasses import asdict
from typing import Any

import numpy as np
from numpy.typing import NDArray

from stoop.base.arrays import FloatArray
from stoop.problem import Layout, Misfit, Nuisance, Piece, Weights
from stoop.vehicle import Parameter, Vehicle
from stoop.vehicle.schema import VehicleFile

_OF_PIECE = ("time", "inputs", "measured")


def pack(problem: Misfit, more: Mapping[str, NDArray[Any]]) -> str:
    """Return a problem, and arrays that belong to it, as text; the same problem gives the same text."""
    arrays: dict[str, Any] = {
        f"{name}.{i}": getattr(piece, name) for i, piece in enumerate(problem.pieces) for name in _OF_PIECE
    }
    arrays |= {"covariance": problem.weights.covariance, "root": problem.weights.root, **more}
    arrays["head"] = np.frombuffer(json.dumps(_head(problem)).encode(), dtype=np.uint8)
    buffer = io.BytesIO()
    np.savez_compressed(buffer, **arrays)
    return base64.b64encode(buffer.getvalue()).decode()


def unpack(text: str) -> tuple[Misfit, dict[str, FloatArray]]:
    """Return the problem that was packed, and all arrays."""
    with np.load(io.BytesIO(base64.b64decode(text)), allow_pickle=False) as file:
        arrays = {name: file[name] for name in file.files}
    head = json.loads(arrays.pop("head").tobytes())
    vehicle = Vehicle(VehicleFile.model_validate(head["vehicle"]), "", head["where"])
    parameters = tuple(Parameter(**p) for p in head["parameters"])
    layout = Layout(vehicle, parameters, tuple(Nuisance(**n) for n in head["nuisances"]))
    weights = Weights(arrays["covariance"], arrays["root"])
    ladder = tuple(tuple(rung) for rung in head["ladder"])
    pieces = tuple(_piece(p, arrays, i) for i, p in enumerate(head["pieces"]))
    return Misfit(layout, pieces, weights, ladder), arrays


def _head(problem: Misfit) -> dict[str, Any]:
    layout = problem.layout
    return {
        "vehicle": _unbounded(layout.vehicle).file.model_dump(mode="json", exclude_unset=True),
        "where": layout.vehicle.where,
        "parameters": [asdict(p) for p in layout.parameters],
        "nuisances": [asdict(n) for n in layout.nuisances],
        "pieces": [
            {"maneuver": p.maneuver, "start": dict(p.start), "changes": dict(p.changes)}
            for p in problem.pieces
        ],
        "ladder": problem.ladder,
    }


def _unbounded(vehicle: Vehicle) -> Vehicle:
    """Return the vehicle without bounds: the layout has them, and a value that was set may lie outside."""
    return vehicle.with_numbers({p.name: {"bounds": None} for p in vehicle.parameters})


def _piece(head: dict[str, Any], arrays: dict[str, FloatArray], index: int) -> Piece:
    time, inputs, measured = (arrays[f"{name}.{index}"] for name in _OF_PIECE)
    return Piece(head["maneuver"], time, inputs, measured, head["start"], head["changes"])
