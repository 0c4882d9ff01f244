"""Optimizers of optional packages: pymoo, cma and pygmo keep what `test_libraries` checks of SciPy's."""

from __future__ import annotations

import numpy as np
import pytest
from naive.landscapes import Only, ellipsoid, sphere
from unit.optimize import test_libraries as libraries

from stoop.errors import IdentificationError


@pytest.mark.parametrize("name", libraries.EXTRA)
def test_packages(name, oscillation, near, tmp_path, monkeypatch, capfd):
    folder = tmp_path / "empty"
    folder.mkdir()
    libraries.check_target_and_interrupt(name)
    capfd.readouterr()  # the import of a package may warn
    libraries.check_budget_and_process(name, oscillation(), folder, monkeypatch)
    assert capfd.readouterr() == ("", "")
    libraries.check_repetition(name, lambda: Only(ellipsoid, 2), tmp_path, monkeypatch)
    libraries.check_infinite_costs(name)
    start = near(1.0)[:4]
    outcome = libraries.first_run(name, oscillation(), start)
    if name == "cma":  # begins about its first mean, not at it
        assert np.abs(outcome.z[:4] - start).max() < 0.5
    else:
        assert outcome.status == "target"


def test_cma_refuses_a_single_variable() -> None:
    with pytest.raises(IdentificationError, match="one variable"):
        libraries.search("cma", Only(sphere, 1))
