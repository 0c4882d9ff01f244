"""A priori derivatives beside published ones: errors of the handbook and of AeroSandbox in their own standard deviations."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path
from typing import Any, Final

import numpy as np
from scipy.io import loadmat

from stoop.base.arrays import FloatArray
from stoop.errors import StoopError
from stoop.vehicle.defaults import EQUATION_1
from stoop_draft.vehicle_draft import aerosandbox, handbook
from stoop_draft.vehicle_draft.apriori import Apriori
from stoop_draft.vehicle_draft.geometry import Geometry
from stoop_studies.findings import Claim, Findings, Setting, holds, table_of
from stoop_studies.verify import study

RMS: Final = (0.75, 1.25)  #: where the root mean square of z must lie, pooled
WITHIN_2: Final = 0.9  #: least share of |z| below 2, pooled
UNCOUNTED: Final = "estimate"  #: kind of derivatives that are shown and not counted
NEVER_EXACT: Final = 0.05  #: least scale of left-out airplanes' standard deviations
METHODS: Final = {
    "measured": "handbook, measured geometry",
    "lattice": "AeroSandbox, measured geometry",
    "sizes": "handbook, mass, span and chord only",
}


@cache
def airplanes() -> Mapping[str, Any]:
    """Return the published airplanes by key."""
    return tomllib.loads(study.data_text("published.toml"))


def published(key: str, folder: Path | None) -> dict[str, float]:
    """Return the published derivatives of an airplane, from the table or from a folder of published data."""
    airplane = airplanes()[key]
    if "data" not in airplane:
        return dict(airplane["derivatives"])
    path = None if folder is None else folder / airplane["data"]
    if path is None or not path.is_file():
        raise StoopError(
            f"handbook: {path or 'no folder is named'}; name the folder that holds {airplane['data']} by --data DIR"
        )
    numbers = _matlab(path) if path.suffix == ".mat" else _yaml(path)
    return {name: factor * numbers[own] for name, (own, factor) in airplane["published"].items()}


def _matlab(path: Path) -> dict[str, float]:
    """Return the numbers of a file of MATLAB."""
    return {n: float(v.item()) for n, v in loadmat(path).items() if isinstance(v, np.ndarray) and v.size == 1}


def _yaml(path: Path) -> dict[str, float]:
    """Return the numbers of the first table of a YAML file of two levels."""
    found: dict[str, float] = {}
    for line in path.read_text(encoding="utf-8").splitlines()[1:]:
        if line and not line[0].isspace() and not line.startswith("#"):
            break
        name, _, value = line.strip().partition(":")
        if value and not name.startswith("#"):
            found[name] = float(value)
    return found


def sizes(geometry: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a file of mass, span and chord would hold; with the side to which a V-tail points."""
    wing = {k: geometry["wing"][k] for k in ("area", "span", "chord") if k in geometry["wing"]}
    kept = {"template": geometry["template"], "mass": geometry["mass"], "wing": wing}
    return kept | {"tail": dict(geometry["tail"])} if geometry["template"] == "v-tail" else kept


@study.work
def compare(case: str, seed: int, data: str) -> dict[str, Any]:
    """Return the rows of one airplane: published, and value, standard deviation and z by each method."""
    airplane = airplanes()[case]
    truth = published(case, Path(data) if data else None)
    found = {m: _derived(airplane, m) for m in METHODS}
    rows = []
    for name in (n for group in EQUATION_1.values() for n in group if n in truth):
        about = {"airplane": airplane["name"], "kind": airplane["kind"]}
        row: dict[str, Any] = {**about, "derivative": name, "published": truth[name]}
        for method, derivatives in found.items():
            a = derivatives.get(name)
            row[method] = a and a.value
            row[f"{method}_std"] = a and a.std
            row[f"{method}_z"] = a and (a.value - truth[name]) / a.std
        rows.append(row)
    return {"rows": rows}


def _derived(airplane: Mapping[str, Any], method: str) -> dict[str, Apriori]:
    only_sizes = len(airplane["geometry"]["wing"]) <= 3
    if only_sizes and method != "sizes":
        return {}
    raw = sizes(airplane["geometry"]) if method == "sizes" else airplane["geometry"]
    derive = aerosandbox.derivatives if method == "lattice" else handbook.derivatives
    geometry = Geometry.of(raw, airplane["name"])
    return derive(geometry, airplane["airspeed"], airplane.get("alpha"), airplane["density"])


def left_out(rows: Sequence[Mapping[str, Any]], method: str) -> FloatArray:
    """Return z of each row with the standard deviation of its derivative scaled to the errors of other airplanes."""
    z = np.array([r[f"{method}_z"] for r in rows])
    scaled = []
    for value, row in zip(z, rows, strict=True):
        same = [r["derivative"] == row["derivative"] and r["airplane"] != row["airplane"] for r in rows]
        others = z[np.array(same, dtype=bool)]
        # few airplanes say little of a scale: one more whose error is as the table has it
        scale = np.sqrt((1.0 + np.sum(others**2)) / (1.0 + len(others)))
        scaled.append(value / max(scale, NEVER_EXACT))
    return np.array(scaled)


def show(setting: Setting, samples: study.Samples) -> Findings:
    """Return how the errors compare with their standard deviations."""
    rows = [row for results in samples.values() for row in results[0]["rows"]]
    counted = [r for r in rows if r["kind"] != UNCOUNTED]
    own = {m: [r for r in counted if r[f"{m}_z"] is not None] for m in METHODS}
    pooled = [_pooled(method, own[method]) for method in METHODS]
    each = [table_of(words, by_derivative(own[m], m)) for m, words in METHODS.items()]
    tables = (*each, table_of("Root mean square of z by airplane", by_airplane(rows)))
    claims = [c for record in pooled for c in _claims(record)]
    title = "A priori derivatives beside published ones"
    return Findings.of(title, claims, rows, {"pooled": pooled}, figures=tables)


def _pooled(method: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    z, out = np.array([r[f"{method}_z"] for r in rows]), left_out(rows, method)
    return {
        "method": METHODS[method],
        "airplanes": len({r["airplane"] for r in rows}),
        "count": len(rows),
        "rms_z": _rms(z),
        "within_2": 100.0 * float(np.mean(np.abs(z) < 2.0)),
        "left_out_rms": _rms(out),
        "left_out_within_2": 100.0 * float(np.mean(np.abs(out) < 2.0)),
    }


def _claims(record: Mapping[str, Any]) -> Iterator[Claim]:
    low, high = RMS
    for head, words in (("", ""), ("left_out_", ", each airplane by the errors of the others")):
        rms, share = record[f"{head}rms" if head else "rms_z"], record[f"{head}within_2"]
        yield holds(
            f"By {record['method']}{words}: rms z is {low:g} to {high:g}, and at least {100 * WITHIN_2:.0f} % are within 2",
            low <= rms <= high and share >= 100.0 * WITHIN_2,
            f"{rms:.2f} and {share:.1f} % of {record['count']} derivatives of {record['airplanes']} airplanes",
        )


def by_derivative(rows: Sequence[Mapping[str, Any]], method: str) -> list[dict[str, Any]]:
    """Return the errors of a method by derivative."""
    records = []
    for name in (n for group in EQUATION_1.values() for n in group):
        own = [r for r in rows if r["derivative"] == name]
        if own:
            z = np.array([r[f"{method}_z"] for r in own])
            error = np.array([r[method] - r["published"] for r in own])
            shares = {
                "bias": float(z.mean()),
                "rms_z": _rms(z),
                "within_2": 100.0 * float(np.mean(np.abs(z) < 2.0)),
            }
            records.append({"derivative": name, "count": len(own), "rms_error": _rms(error), **shares})
    return records


def by_airplane(rows: Sequence[Mapping[str, Any]]) -> list[dict[str, Any]]:
    """Return the root mean square of z of each method by airplane."""
    records = []
    for name in dict.fromkeys(r["airplane"] for r in rows):
        own = [r for r in rows if r["airplane"] == name]
        z = {m: [r[f"{m}_z"] for r in own if r[f"{m}_z"] is not None] for m in METHODS}
        rms = {f"{m}_rms": _rms(np.array(values)) if values else None for m, values in z.items()}
        records.append({"airplane": name, "kind": own[0]["kind"], **rms})
    return records


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(values**2)))


EXPERIMENT: Final = study.Verification(
    "handbook", show, work="compare", cases=tuple(airplanes()), parts=("pooled",), reads_data=True
)
