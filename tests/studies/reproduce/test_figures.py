"""The three figures: laws that the numbers must obey, and the pseudo-code as the paper prints it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from stoop_studies.findings import Findings, Setting
from stoop_studies.optimizers.evolution import chaos
from stoop_studies.optimizers.local_search import golden_section
from stoop_studies.outputs import write_index
from stoop_studies.problems.paper import paper
from stoop_studies.reproduce.figure2 import PAIR, Figure2, Recorder, both, printed_section, searched
from stoop_studies.reproduce.figures import Figure1, Figure3, histogram, measured
from stoop_studies.reproduce.suite import SUITE


def verdicts(found: Findings) -> list[str]:
    return [claim.verdict for claim in found.claims]


def test_the_logistic_map_follows_the_arcsine_law() -> None:
    orbit = chaos(40_000, 1, np.random.default_rng(1))[:, 0]
    _, share, law = histogram(orbit)
    assert law.sum() == pytest.approx(1.0)
    assert law[0] == pytest.approx(0.10108, abs=1e-5), "2 / pi asin(sqrt(1 / 40))"
    assert np.abs(share / law - 1.0).max() < 0.15


def test_a_chaotic_start_is_less_even_than_a_uniform_one() -> None:
    found = Figure1().findings(Setting(runs=20), {})
    assert verdicts(found) == ["reproduces", "does not reproduce", "does not reproduce"]


def test_even_populations_are_measured_as_even() -> None:
    def grid(number: int, dimension: int, generator: np.random.Generator) -> np.ndarray:
        points = (np.arange(number) + 0.5) / number
        return np.stack([generator.permutation(points) for _ in range(dimension)], axis=1)

    evenness = measured(grid, range(3))
    assert (evenness.empty == 0.0).all()
    assert (evenness.discrepancy < measured(chaos, range(3)).discrepancy).all()


@pytest.mark.parametrize("minimum", [0.002, 0.013, 0.03, 0.05, 0.08, 0.1])
def test_the_repaired_search_is_the_one_that_ships(minimum: float) -> None:
    def cost(t: float) -> float:
        return (t - minimum) ** 2

    line = searched(cost, golden_section)
    assert line.end == golden_section(cost, 0.0, 0.1, 0.01)
    assert line.cost == cost(line.end)


def test_as_printed_the_first_branch_ends_the_search() -> None:
    """By hand: i2 = 0.0618, i1 = 0.0382; the lower one is better, so i2 becomes i1 and the loop ends."""
    line = searched(lambda t: t, printed_section)
    assert line.points == pytest.approx([0.0618, 0.0382], abs=1e-4)
    assert line.end == pytest.approx(0.0382, abs=1e-4)
    rising: Callable[[float], float] = lambda t: -t  # noqa: E731 - a line of its own would hide it
    upper = searched(rising, printed_section)
    assert upper.end == searched(rising, golden_section).end, "the second branch is printed right"


def test_every_evaluation_of_a_local_search_is_recorded() -> None:
    recorder = Recorder(replace(paper(), names=PAIR))
    pair = both(recorder, np.array([0.2, 0.8]))
    own = 1 + 2  # the start, and a difference in each of two variables
    searches = sum(len(line.points) + 1 for line in pair.values())
    assert len(recorder.points) == own + searches + 2, "and the start again, to compare with"


def test_figure_2_holds_the_printed_code_against_the_repaired_one() -> None:
    found = Figure2().findings(Setting(runs=20), {})
    assert verdicts(found) == ["holds", "holds", "does not hold"]
    assert found.csv.startswith("search,CLalpha,Cmalpha,J,evaluations_so_far\r\n0,3.84,-1.6,")
    costs = [float(row.split(",")[3]) for row in found.csv.splitlines()[1:]]
    assert costs == sorted(costs, reverse=True), "a local search never ends above its start"


def test_figure_3_flies_the_printed_trim_and_excites_both_modes() -> None:
    found = Figure3().findings(Setting(runs=1), {})
    assert verdicts(found) == ["reproduces", "reproduces", "reproduces", "holds"]
    rows = found.csv.splitlines()
    assert rows[0] == "time_s,elevator_deg,V_m_per_s,alpha_deg,q_deg_per_s,theta_deg"
    assert len(rows) == 1501


def test_the_index_leads_to_every_page(tmp_path: Path) -> None:
    found = {"figure2": Figure2().findings(Setting(runs=3), {})}
    write_index(SUITE, found, [Setting(runs=3)], tmp_path)
    page = (tmp_path / "index.html").read_text(encoding="utf-8")
    assert page.count('<a href="figure2.html">figure2.html</a>') == page.count("figure2.html</a>") == 1
    assert "stoop reproduce figure2 --runs 3 --seed 0 --box N" in page
