"""Figures that the README and the changelog take from the benchmark table stand in it."""

from __future__ import annotations

import re

import pytest

from docs.pages import DOCS, ROOT, Table, table


@pytest.fixture(scope="module")
def measured() -> dict[str, str]:
    whole = table(DOCS / "benchmarks.md", "Benchmarks", "part", "figure")
    return dict(zip(whole.column("figure"), whole.column("measured"), strict=True))


@pytest.fixture(scope="module")
def readme() -> Table:
    return table(ROOT / "README.md", "How it compares", "quantity")


def rounded(text: str) -> list[float]:
    return [float(n) for n in re.findall(r"(?<![\w/])\d+(?:\.\d+)?(?:e-\d+)?(?![\w/])", text)]


def test_odeint(readme: Table) -> None:
    notes = table(DOCS / "benchmarks.md", "Benchmarks", "part", "figure")
    said = dict(zip(notes.column("figure"), notes.column("note"), strict=True))
    lean, compiled = (
        said[f"times faster than odeint, {n} right-hand side"] for n in ("lean Python", "Numba")
    )
    _, own, beside = readme.rows[0]
    plain, quick = rounded(beside)
    assert lean.startswith(f"{plain:.1f} ms against {own};")
    assert compiled.startswith(f"{quick:.1f} ms against {own};")


@pytest.mark.parametrize(("row", "box"), [(1, "N"), (2, "W")])
def test_searches(readme: Table, measured: dict[str, str], row: int, box: str) -> None:
    _, own, beside = readme.rows[row]
    assert rounded(own)[0] == round(float(measured[f"box {box}: mean trajectories to 1e-6 J0"]))
    others = [measured[f"{name}, box {box}: median trajectories"] for name in ("ps-gde", "de-best-2-bin")]
    assert rounded(beside)[:2] == [float(n) for n in others]


def test_wrong_optima_and_accuracy(readme: Table, measured: dict[str, str]) -> None:
    wrong = [v for k, v in measured.items() if k.endswith("ended in a wrong optimum")]
    assert wrong
    assert set(wrong) == {readme.rows[3][1]}
    assert float(measured["largest error at 100 Hz, of the channel's maximum"]) == pytest.approx(
        2e-7, rel=0.2
    )


def test_changelog(measured: dict[str, str]) -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"{measured['step, 512 candidates']} per step" in text
    for box in "NW":
        assert f"{float(measured[f'box {box}: mean trajectories to 1e-6 J0']):.1f}" in text


def test_reading_of_logs(measured: dict[str, str]) -> None:
    text = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    assert f"read at {measured['file read per second']} (7 times as fast" in text
    assert float(measured["times faster than pyulog"]) > 7.0
    assert f"in {float(measured['largest memory over what is kept']):.1f} times the memory" in text
