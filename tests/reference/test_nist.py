"""All certified regressions of NIST StRD, from both starts: 9 digits of each parameter and of each deviation."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import sympy as sp
from core.optimize.conftest import Residuals
from scipy.optimize import least_squares

from stoop import optimize
from stoop.errors import StoopError
from stoop_studies.findings import Setting
from stoop_studies.verify.nist import EXPERIMENT, digits, fit_certified, problem_files, read_certified

NAMES = ("Chwirut1", "Chwirut2", "DanWood", "ENSO", "Gauss1", "Gauss2", "Gauss3", "Kirby2", "Lanczos2", "Lanczos3", "MGH17",
         "Misra1a", "Misra1b", "Misra1c", "Misra1d", "Nelson", "Rat42", "Roszman1")  # fmt: skip


def test_certified_digits_of_a_narrow_valley(shared_data: Path) -> None:
    test_certified_digits(shared_data, "MGH10")


@pytest.mark.parametrize("name", NAMES)
def test_certified_digits(shared_data: Path, name: str) -> None:
    known = read_certified(shared_data / "nist-strd" / f"{name}.dat")
    for start in (1, 2):
        found = fit_certified(known, start)
        assert found["ending"] == "converged"
        assert min(found[f"digits_{part}"] for part in ("parameters", "deviations", "rss")) >= 9.0, start


def test_every_file_is_run_and_digits_turn_round(shared_data: Path) -> None:
    folder = shared_data / "nist-strd"
    assert {p.stem for p in folder.glob("*.dat")} == {*NAMES, "MGH10"}
    assert len(problem_files(folder)) == len(problem_files(shared_data)) == len(NAMES) + 1
    assert digits(np.array([1.0, 2.002]), np.array([1.0, 2.0])) == pytest.approx(3.0)
    assert [digits(x, 1.0) for x in (1.0, np.nan, -5.0)] == [11.0, 0.0, 0.0]


def test_without_data_it_says_where_to_get_them(tmp_path: Path) -> None:
    for data, said in ((None, "give --data DIR"), (tmp_path, "holds none of its files")):
        with pytest.raises(StoopError, match=said):
            EXPERIMENT.findings(Setting(1, data=data), {})
    damaged = b"  b1 = 1 2 3 4\nResidual Sum of Squares: 1\n Lower Level of Difficulty\n"
    path = tmp_path / "Misra1a.dat"
    for content in (b"", b"\xff", damaged):
        path.write_bytes(content)
        with pytest.raises(StoopError, match=r"Misra1a\.dat: .*fetch it again"):
            read_certified(path)


class Regression(Residuals):
    """A NIST data set as a problem: the box spans starts and certified values with a margin."""

    def __init__(self, path: Path) -> None:
        known = read_certified(path)
        self.y, self.starts, self.certified, self.least = known.y, known.starts, known.values, known.least
        model = sp.lambdify([known.model.parameters, known.model.predictors], known.model.mean)
        self.model = lambda b: model(b, known.x)
        corners = np.vstack([self.starts, self.certified])
        margin = 0.2 * np.ptp(corners, axis=0) + 0.05 * np.abs(self.certified)
        self.low = corners.min(axis=0) - margin
        self.span = corners.max(axis=0) + margin - self.low
        self.dimension = len(self.low)

    def unit(self, b: np.ndarray) -> np.ndarray:
        return (b - self.low) / self.span

    def residuals(self, Z: np.ndarray, rung: int) -> np.ndarray:
        with np.errstate(all="ignore"):
            return np.array([self.model(self.low + z * self.span) - self.y for z in Z])

    def reference(self, rung: int) -> float:
        return float(((self.y - self.y[0]) ** 2).sum())


@pytest.fixture(scope="module")
def regression(shared_data: Path) -> Callable[[str], Regression]:
    return lambda name: Regression(shared_data / "nist-strd" / f"{name}.dat")


PATIENT = optimize.Settings(iterations=1000, gain=1e-14, predicted=0.0, stall=1000, stall_damping=0.0)
FAR = ["Misra1a", "Misra1d", "DanWood", "Chwirut2", "Rat42", "Gauss1", "Roszman1"]
CASES = [(n, 1) for n in (*FAR, "ENSO", "Kirby2", "Lanczos3", "MGH17")] + [(n, 0) for n in FAR]


@pytest.mark.parametrize(("name", "start"), CASES)
def test_local_refinements_end_at_the_certified_values(regression, name, start):
    problem = regression(name)
    end = optimize.refine(problem, problem.unit(problem.starts[start]), 0, PATIENT)
    assert end.converged
    assert end.cost == pytest.approx(problem.least, rel=1e-6)
    rel = 1e-3 if name == "Lanczos3" else 1e-5  # a sum of three exponentials is nearly degenerate
    assert problem.low + end.z * problem.span == pytest.approx(problem.certified, rel=rel)


def test_local_refinements_end_where_scipy_does_inside_bounds(regression):
    """The box ends between start and certified values, so that the answer lies on a bound."""
    for name in ("Misra1a", "Chwirut2", "Lanczos3", "Kirby2"):
        problem = regression(name)
        cut = 0.5 * (problem.starts[1] + problem.certified)[0]
        side = problem.starts[1][0] > problem.certified[0]
        high = problem.low + problem.span
        problem.low[0], high[0] = (cut, high[0]) if side else (problem.low[0], cut)
        problem.span = high - problem.low
        z = np.clip(problem.unit(problem.starts[1]), 0.0, 1.0)
        ours = optimize.refine(problem, z, 0, PATIENT)
        theirs = least_squares(
            lambda v, problem=problem: problem.residuals(v[None, :], 0)[0], np.clip(z, 1e-9, 1 - 1e-9),
            bounds=(0.0, 1.0), x_scale="jac", xtol=1e-15, ftol=1e-15, gtol=1e-15, max_nfev=3000,
        )  # fmt: skip
        assert ((ours.z >= 0.0) & (ours.z <= 1.0)).all(), name
        assert ours.cost <= 2.0 * theirs.cost * (1.0 + 1e-5), name


def test_default_search_needs_no_start(regression: Callable[[str], Regression]) -> None:
    for name in ("Misra1a", "Chwirut2", "DanWood", "Gauss1", "ENSO"):
        problem = regression(name)
        outcome = optimize.minimize(optimize.create(), problem, seed=1, stop=optimize.Stop(budget=5000))
        assert (outcome.status, outcome.cost) == ("converged", pytest.approx(problem.least, rel=1e-5))
