"""`stoop linearize`: the same matrices in JSON and on the page, modes that NumPy confirms."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from stoop.cli.main import main


def document(capsys: pytest.CaptureFixture[str], *words: str) -> dict[str, Any]:
    assert main(["linearize", *words, "--json", "-"]) == 0
    out, err = capsys.readouterr()
    assert err == ""
    return dict(json.loads(out))


@pytest.mark.parametrize("words", [[], ["--reduce", "longitudinal"], ["--reduce", "lateral"]])
def test_modes_are_the_eigenvalues(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    model = document(capsys, "twin-boom", *words)
    A = np.array(model["A"])
    kept = [i for i, name in enumerate(model["states"]) if name not in ("psi", "h")]
    expected = [s for s in np.linalg.eigvals(A[np.ix_(kept, kept)]) if s.imag >= 0.0]
    found = [complex(m["eigenvalue"]["real"], m["eigenvalue"]["imag"]) for m in model["modes"]]
    assert sorted(found, key=abs) == pytest.approx(sorted(expected, key=abs), abs=1e-9)
    assert A.shape == (len(model["states"]),) * 2
    assert np.shape(model["B"]) == (len(model["states"]), len(model["inputs"]))
    assert np.shape(model["C"]) == (len(model["outputs"]), len(model["states"]))
    assert np.shape(model["D"]) == (len(model["outputs"]), len(model["inputs"]))


def test_modes_of_the_paper_aircraft(capsys: pytest.CaptureFixture[str]) -> None:
    """The free choices of chord and inertia were made for 5.1 rad/s and a damping of 0.50."""
    modes = {m["name"]: m for m in document(capsys, "twin-boom")["modes"]}
    assert set(modes) == {"short period", "phugoid", "Dutch roll", "roll", "spiral"}
    assert modes["short period"]["frequency"] == pytest.approx(5.1, abs=0.1)
    assert modes["short period"]["damping"] == pytest.approx(0.50, abs=0.02)
    assert modes["spiral"]["time_constant"] < 0.0


def test_page_shows_what_json_holds(capsys: pytest.CaptureFixture[str]) -> None:
    model = document(capsys, "twin-boom", "--reduce", "longitudinal")
    assert main(["linearize", "twin-boom", "--reduce", "longitudinal"]) == 0
    out = capsys.readouterr().out
    tables = out.split("\n\n")
    for name, rows in (
        ("A", model["states"]),
        ("B", model["states"]),
        ("C", model["outputs"]),
        ("D", model["outputs"]),
    ):
        head, *lines = next(t for t in tables if t.startswith(f"{name} ")).splitlines()
        assert head.split()[1:] == (model["states"] if name in "AC" else model["inputs"])
        assert [line.split()[0] for line in lines] == rows
        shown = np.array([[float(x) for x in line.split()[1:]] for line in lines])
        np.testing.assert_allclose(shown, model[name], rtol=5.001e-4, atol=1e-9)
    assert "halves in" in out


def test_unstable_mode_doubles(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["linearize", "twin-boom"]) == 0
    spiral = next(line for line in capsys.readouterr().out.splitlines() if line.startswith("spiral"))
    assert spiral.endswith("doubles in 17.64 s")


def test_writes_a_file_but_not_over_another(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "model.json"
    words = ["linearize", "twin-boom", "--reduce", "longitudinal", "--json", str(path)]
    assert main(words) == 0
    assert capsys.readouterr().out.startswith(f"wrote {path}")
    first = path.read_bytes()
    assert json.loads(first)["format"] == "stoop-linear-model/1"
    assert main(words) == 2
    assert "--overwrite" in capsys.readouterr().err
    assert main([*words, "--overwrite"]) == 0
    assert path.read_bytes() == first


def test_a_hover_has_modes_and_units_of_its_own(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["linearize", "quad-x"]) == 0
    out = capsys.readouterr().out
    for name in ("pitch and speed", "roll and speed", "yaw", "heave", "lag"):
        assert f"\n{name} " in out
    assert "x: u m/s, v m/s, w m/s, p rad/s" in out
    assert "m4.lag\n" in out
