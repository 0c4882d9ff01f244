"""`stoop linearize`: the same matrices in JSON and on the page, modes that NumPy confirms."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from stoop.cli.main import main

Done = Callable[..., str]


@pytest.mark.parametrize("more", ["", "--reduce longitudinal", "--reduce lateral"])
def test_modes_are_the_eigenvalues_and_the_page_shows_the_matrices(more: str, done: Done) -> None:
    model = json.loads(done(f"linearize twin-boom {more} --json -"))
    A, states, inputs, outputs = np.array(model["A"]), model["states"], model["inputs"], model["outputs"]
    kept = [i for i, name in enumerate(states) if name not in ("psi", "h")]
    expected = [s for s in np.linalg.eigvals(A[np.ix_(kept, kept)]) if s.imag >= 0.0]
    found = [complex(m["eigenvalue"]["real"], m["eigenvalue"]["imag"]) for m in model["modes"]]
    assert sorted(found, key=abs) == pytest.approx(sorted(expected, key=abs), abs=1e-9)
    page = done(f"linearize twin-boom {more}")
    for name, rows, columns in (("A", states, states), ("B", states, inputs), ("C", outputs, states),
                                ("D", outputs, inputs)):  # fmt: skip
        assert np.shape(model[name]) == (len(rows), len(columns))
        if more != "--reduce longitudinal":  # wider matrices are folded
            continue
        head, *lines = next(t for t in page.split("\n\n") if t.startswith(f"{name} ")).splitlines()
        assert head.split()[1:] == columns
        assert [line.split()[0] for line in lines] == rows
        shown = np.array([[float(x) for x in line.split()[1:]] for line in lines])
        np.testing.assert_allclose(shown, model[name], rtol=5.001e-4, atol=1e-9)


def test_modes_of_the_paper_aircraft(done: Done) -> None:
    """The free choices of chord and inertia were made for 5.1 rad/s and a damping of 0.50."""
    modes = {m["name"]: m for m in json.loads(done("linearize twin-boom --json -"))["modes"]}
    assert set(modes) == {"short period", "phugoid", "Dutch roll", "roll", "spiral"}
    assert modes["short period"]["frequency"] == pytest.approx(5.1, abs=0.1)
    assert modes["short period"]["damping"] == pytest.approx(0.50, abs=0.02)
    assert modes["spiral"]["time_constant"] < 0.0
    page = done("linearize twin-boom")
    doubles = np.log(2.0) * -modes["spiral"]["time_constant"]
    (spiral,) = (line for line in page.splitlines() if line.startswith("spiral"))
    assert spiral.endswith(f"doubles in {doubles:.2f} s")
    assert "halves in" in page


def test_writes_a_file_but_not_over_another(tmp_path: Path, done: Done) -> None:
    path = tmp_path / "model.json"
    words = ["linearize", "twin-boom", "--reduce", "longitudinal", "--json", str(path)]
    assert done(words).startswith(f"wrote {path}")
    first = path.read_bytes()
    assert json.loads(first)["format"] == "stoop-linear-model/1"
    assert main(words) == 2
    done([*words, "--overwrite"])
    assert path.read_bytes() == first


def test_a_hover_has_modes_and_units_of_its_own(done: Done) -> None:
    out = done("linearize quad-x")
    for name in ("pitch and speed", "roll and speed", "yaw", "heave", "lag"):
        assert f"\n{name} " in out
    assert "x: u m/s, v m/s, w m/s, p rad/s" in out
    assert "m4.lag\n" in out
