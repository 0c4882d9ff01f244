"""All certified regressions of NIST StRD, from both starts: 9 digits of each parameter and of each deviation."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import sympy as sp

from stoop.errors import StoopError
from stoop_studies.findings import Setting
from stoop_studies.verify.nist import (
    EXPERIMENT,
    Regression,
    digits,
    fit_certified,
    problem_files,
    read_certified,
)

b1, b2, b3, b4, b5, b6, b7, b8, b9 = B = sp.symbols("b1:10", real=True)
x, x1, x2 = sp.symbols("x x1 x2", real=True)

_EXPONENTIALS = b1 * sp.exp(-b2 * x) + b3 * sp.exp(-b4 * x) + b5 * sp.exp(-b6 * x)
_GAUSSIANS = (
    b1 * sp.exp(-b2 * x) + b3 * sp.exp(-((x - b4) ** 2) / b5**2) + b6 * sp.exp(-((x - b7) ** 2) / b8**2)
)
_CHWIRUT = sp.exp(-b1 * x) / (b2 + b3 * x)


def _wave(period: sp.Expr, cosine: sp.Expr, sine: sp.Expr) -> sp.Expr:
    phase = 2 * sp.pi * x / period
    return cosine * sp.cos(phase) + sine * sp.sin(phase)


MODELS = {
    "Chwirut1": _CHWIRUT,
    "Chwirut2": _CHWIRUT,
    "DanWood": b1 * x**b2,
    "ENSO": b1 + _wave(sp.Integer(12), b2, b3) + _wave(b4, b5, b6) + _wave(b7, b8, b9),
    "Gauss1": _GAUSSIANS,
    "Gauss2": _GAUSSIANS,
    "Gauss3": _GAUSSIANS,
    "Kirby2": (b1 + b2 * x + b3 * x**2) / (1 + b4 * x + b5 * x**2),
    "Lanczos2": _EXPONENTIALS,
    "Lanczos3": _EXPONENTIALS,
    "MGH10": b1 * sp.exp(b2 / (x + b3)),
    "MGH17": b1 + b2 * sp.exp(-x * b4) + b3 * sp.exp(-x * b5),
    "Misra1a": b1 * (1 - sp.exp(-b2 * x)),
    "Misra1b": b1 * (1 - (1 + b2 * x / 2) ** -2),
    "Misra1c": b1 * (1 - 1 / sp.sqrt(1 + 2 * b2 * x)),
    "Misra1d": b1 * b2 * x / (1 + b2 * x),
    "Nelson": b1 - b2 * x1 * sp.exp(-b3 * x2),
    "Rat42": b1 / (1 + sp.exp(b2 - b3 * x)),
    "Roszman1": b1 - b2 * x - sp.atan(b3 / (x - b4)) / sp.pi,
}  # of each file, written again by hand


@pytest.mark.parametrize("start", [1, 2])
@pytest.mark.parametrize("name", MODELS)
def test_certified_digits(shared_data: Path, name: str, start: int) -> None:
    found = fit_certified(read_certified(shared_data / "nist-strd" / f"{name}.dat"), start)
    assert found["ending"] == "converged"
    assert found["digits_parameters"] >= 9.0
    assert found["digits_deviations"] >= 9.0
    assert found["digits_rss"] >= 9.0


@pytest.mark.parametrize("name", MODELS)
def test_models_are_those_of_the_files(shared_data: Path, name: str) -> None:
    """They are those written here, cost the certified sum of squares, and derivatives are those of differences."""
    known = read_certified(shared_data / "nist-strd" / f"{name}.dat")
    assert sp.simplify(known.model.mean - MODELS[name]) == 0
    assert known.model.response == (sp.log if name == "Nelson" else sp.Id)(sp.Symbol("y", real=True))
    problem = Regression(known, np.abs(known.values))
    z = known.values / problem.scale
    r = problem.residuals(z[None], 0)[0]
    assert digits(float(r @ r), known.least) >= 4.0 if name == "Lanczos2" else 9.0
    h = 1e-5
    steps = h * np.eye(len(z))
    difference = (problem.residuals(z + steps, 0) - problem.residuals(z - steps, 0)).T / (2 * h)
    J, _ = problem.jacobian(z, 0, r)
    assert difference == pytest.approx(J, abs=1e-5 * np.abs(J).max())


def test_every_file_is_run(shared_data: Path) -> None:
    folder = shared_data / "nist-strd"
    assert {p.stem for p in folder.glob("*.dat")} == set(MODELS)
    for place in (folder, shared_data):
        assert len(problem_files(place)) == len(MODELS)


def test_without_data_it_says_where_to_get_them(tmp_path: Path) -> None:
    with pytest.raises(StoopError, match=r"no folder is named; give --data DIR with the files of https"):
        EXPERIMENT.findings(Setting(1), {})
    with pytest.raises(StoopError, match="holds none of its files"):
        EXPERIMENT.findings(Setting(1, data=tmp_path), {})


@pytest.mark.parametrize(
    "content", [b"", b"\xff", b"  b1 = 1 2 3 4\nResidual Sum of Squares: 1\n Lower Level of Difficulty\n"]
)
def test_a_file_of_something_else(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "Misra1a.dat"
    path.write_bytes(content)
    with pytest.raises(StoopError, match=r"Misra1a\.dat: .*fetch it again"):
        read_certified(path)


def test_digits_turn_round() -> None:
    assert digits(np.array([1.0, 2.002]), np.array([1.0, 2.0])) == pytest.approx(3.0)
    assert digits(1.0, 1.0) == 11.0
    assert digits(np.nan, 1.0) == digits(-5.0, 1.0) == 0.0
