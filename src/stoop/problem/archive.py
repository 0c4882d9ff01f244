"""A problem as a JSON document and arrays, from which it comes back with the same bits."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict
from typing import Any, Final

from stoop.problem.color import Color, ColoredWeights
from stoop.problem.layout import Layout, Nuisance
from stoop.problem.misfit import Misfit, Piece
from stoop.problem.weights import Weights
from stoop.vehicle import Parameter, Vehicle
from stoop.vehicle.schema import VehicleFile

PIECE_ARRAYS: Final = ("time", "inputs", "measured")
OPTIONAL_ARRAYS: Final = ("interpolated", "before")  #: of a piece
PIECE_TUPLES: Final = ("moved", "relative_noise")


def problem_document(problem: Misfit) -> dict[str, Any]:
    """Return the problem without its arrays, as types of JSON."""
    layout = problem.layout
    # without bounds: the layout has them, and a set value may lie outside
    unbounded = layout.vehicle.with_numbers({p.name: {"bounds": None} for p in layout.vehicle.parameters})
    return {
        "vehicle": unbounded.file.model_dump(mode="json", exclude_unset=True),
        "where": layout.vehicle.where,
        "measured": layout.vehicle.measured,
        "parameters": [asdict(p) for p in layout.parameters],
        "nuisances": [asdict(n) for n in layout.nuisances],
        "pieces": [
            {"maneuver": p.maneuver, "start": dict(p.start), "changes": dict(p.changes)}
            | {name: getattr(p, name) for name in PIECE_TUPLES}
            for p in problem.pieces
        ],
        "ladder": problem.ladder,
    }


def problem_arrays(problem: Misfit) -> dict[str, Any]:
    """Return series of the pieces and weights."""
    series: dict[str, Any] = {}
    for names in (PIECE_ARRAYS, OPTIONAL_ARRAYS):
        for i, p in enumerate(problem.pieces):
            series |= {f"{n}.{i}": own for n in names if (own := getattr(p, n)) is not None}
    weights = problem.weights
    color = weights.color.arrays if isinstance(weights, ColoredWeights) else {}
    return {**series, **color, "covariance": weights.covariance, "root": weights.root}


def restored_problem(document: Mapping[str, Any], arrays: Mapping[str, Any]) -> Misfit:
    """Return the problem of a document and arrays; its vehicle has no text and no bounds, which the layout has."""
    file = VehicleFile.model_validate(document["vehicle"])
    vehicle = Vehicle(file, "", document["where"], tuple(document["measured"]))
    parameters = tuple(Parameter(**p) for p in document["parameters"])
    layout = Layout(vehicle, parameters, tuple(Nuisance(**n) for n in document["nuisances"]))
    pieces = []
    for i, p in enumerate(document["pieces"]):
        series = {name: arrays[f"{name}.{i}"] for name in PIECE_ARRAYS}
        series |= {name: arrays.get(f"{name}.{i}") for name in OPTIONAL_ARRAYS}
        pieces.append(Piece(**{**p, **series, **{name: tuple(p[name]) for name in PIECE_TUPLES}}))
    weights, color = Weights(arrays["covariance"], arrays["root"]), Color.restored(arrays)
    weights = weights if color is None else ColoredWeights(weights.covariance, weights.root, color)
    return Misfit(layout, tuple(pieces), weights, tuple(tuple(rung) for rung in document["ladder"]))
