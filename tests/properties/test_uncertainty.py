"""One uncertainty: each error of the table is the square root of its variance in the covariance matrix."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose

from stoop.strategy import decision
from stoop.workflow import FittedModel
from stoop.workflow.summary import fit_warnings


def test_errors_of_the_table_are_those_of_the_covariance(lacking: FittedModel, tmp_path: Path) -> None:
    """By definition; of a model that lacks a term, so that all that widens an error bar takes part."""
    lacking.result.save(tmp_path / "result.json")
    written = json.loads((tmp_path / "result.json").read_text(encoding="utf-8"))
    names = written["covariance"]["names"]
    roots = np.sqrt(np.diag(np.array(written["covariance"]["matrix"], dtype=float)))
    table = lacking.to_dataframe()
    assert len(names) == 3
    for name, root in zip(names, roots, strict=True):
        assert written["parameters"][name]["std_error"] == pytest.approx(root, rel=1e-9), name
        assert table.loc[name, "std_error"] == pytest.approx(root, rel=1e-9), name
        assert lacking.parameters[name].std_error == pytest.approx(root, rel=1e-9), name
        parts = {c: own[name] for c, own in written["components"]["variances"].items()}
        assert sum(parts.values()) == pytest.approx(root**2, rel=1e-9), (name, parts)
    assert any(own > 0.0 for own in written["components"]["variances"]["model"].values())


def test_a_component_that_is_left_out_is_not_in_the_sum(lacking: FittedModel) -> None:
    """The other components stay; what is lacking moves all three numbers together."""
    less, result = decision.test(lacking.estimate, ("model",))[0].bars, lacking.result
    assert less.left_out == {"model"}
    flights = {flight.name: flight for flight in lacking.flights}
    told = fit_warnings(result.parameters, less, result.maneuvers, lacking.estimate, flights)
    assert [n.values["components"] for n in told if n.code == "components-left-out"] == [("model",)]
    held = {c: np.array([*own.values()]) for c, own in result.components.variances.items()}
    assert_allclose(less.std[:3] ** 2, sum(held[name] for name in held if name != "model"))
    moved = result.covariance.matrix - less.covariance[:3, :3]
    assert_allclose(np.diag(moved), held["model"])
    assert np.min(np.abs(moved / np.sqrt(np.outer(*[np.diag(moved)] * 2)))) > 0.5


def test_shares_of_the_components_are_printed_and_drawn(lacking: FittedModel, tmp_path: Path) -> None:
    shares = lacking.uncertainty.shares("Cmalpha")
    assert sum(shares.values()) == pytest.approx(1.0)
    row = next(line.split() for line in str(lacking.uncertainty).splitlines() if line.startswith("Cmalpha"))
    assert float(row[1]) == pytest.approx(lacking.parameters["Cmalpha"].std_error, rel=1e-3)
    assert [float(cell.rstrip("%")) for cell in row[2:]] == pytest.approx(
        [100.0 * s for s in shares.values()], abs=0.06
    )
    page = lacking.plot.uncertainty().save(tmp_path / "page.html").read_text(encoding="utf-8")
    drawn = re.search(r'aria-label="Cmalpha: noise[^"]*">(.*?)</svg>', page)
    assert drawn is not None
    wide = {
        kind: float(width)
        for width, kind in re.findall(r'width="([0-9.]+)" height="10" class="component-(\w+)"', drawn[1])
    }
    positive = {name: share for name, share in shares.items() if share > 1e-3}
    total = sum(share for share in shares.values() if share > 0.0)
    for name, share in positive.items():
        assert wide[name] == pytest.approx(240.0 * share / total, abs=0.6), name


def test_figures_are_carried_with_the_covariance_of_the_table(lacking: FittedModel) -> None:
    """Three expressions, against draws of NumPy from the matrix of the result."""
    written = {
        "margin": "-Cmalpha / CLalpha",
        "trim": "-(Cm0 + 0.05 * Cmalpha) / Cmelevator",
        "product": "Cmelevator * Cmalpha",
    }
    found = lacking.propagate(expressions=written, draws=400)
    names, estimates = lacking.result.covariance.names, {n: p.estimate for n, p in lacking.parameters.items()}
    drawn = np.random.default_rng(0).multivariate_normal(
        [*estimates.values()], lacking.result.covariance.matrix, 100_000
    )
    numbers = {"CLalpha": lacking.vehicle.value("CLalpha"), **dict(zip(names, drawn.T, strict=True))}
    Cm0, Cmalpha, Cmelevator = (numbers[n] for n in ("Cm0", "Cmalpha", "Cmelevator"))
    own = {
        "margin": -Cmalpha / numbers["CLalpha"],
        "trim": -(Cm0 + 0.05 * Cmalpha) / Cmelevator,
        "product": Cmelevator * Cmalpha,
    }
    for name, values in own.items():
        assert found[name].std_error == pytest.approx(np.std(values), rel=0.15), name
