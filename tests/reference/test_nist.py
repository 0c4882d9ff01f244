"""All certified regressions of NIST StRD, from both starts: 9 digits of each parameter and of each deviation."""

from pathlib import Path

import numpy as np
import pytest

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
