"""The page on the paper's experiments says what the committed tables and pages say."""

from __future__ import annotations

import csv
import re

import numpy as np
import pytest

from docs.pages import DOCS, table
from stoop_studies.cli.reproduce import NAMES
from stoop_studies.reproduce import lateral, longitudinal
from stoop_studies.reproduce.registry import EXPERIMENTS
from stoop_studies.reproduce.suite import METHODS

PAGE = DOCS / "reproduce.md"
SHOWN = {registered: shown for shown, registered in METHODS.items()}


def test_experiments_and_their_runs() -> None:
    listed = table(PAGE, "The paper, run again", "experiment")
    assert listed.column("experiment") == list(NAMES)
    assert listed.column("runs") == [str(EXPERIMENTS[name].runs) for name in NAMES]


def test_table_1_is_the_one_that_was_written() -> None:
    written = records("table1")
    shown = table(PAGE, "What table 1 shows", "method").rows
    assert len(shown) == len(written)
    for (method, *cells), row in zip(shown, written, strict=True):
        assert method == SHOWN[row["method"]]
        counts = [row["iterations"], row["successful"], row["within_1e-6"]]
        numbers = [100.0 * float(row["mean_error"]), float(row["median_fitness"])]
        assert cells == [*counts, *(f"{x:.2g}" for x in numbers), row["median_evaluations_to_target"]]


def test_what_is_said_of_it() -> None:
    rows = {(r["method"], int(r["iterations"])): r for r in records("table1")}
    for iterations in (500, 1000, 1500, 2000):
        errors = [float(rows[m, iterations]["mean_error"]) for m in ("ga", "pso", "ps-gde")]
        assert errors == sorted(errors, reverse=True)
        assert (
            rows["ps-gde", iterations]["within_1e-6"] == rows["ps-gde-lm", iterations]["within_1e-6"] == "50"
        )
    assert rows["pso", 1500]["successful"] == "50"
    early = 100.0 * float(rows["ps-gde", 500]["mean_error"])
    assert f"the mean error of PS-GDE is {early:.2g} % at 500 iterations" in text()
    assert float(rows["ps-gde", 1000]["mean_error"]) < 1e-14, "rounding"
    hits = float(rows["ps-gde", 500]["median_evaluations_to_target"])
    assert hits == pytest.approx(5752.0, rel=0.1), "the prototype's"


def test_ablation_is_the_one_that_was_written() -> None:
    written = records("ablation")
    assert list(table(PAGE, "Which idea helps", "variant").rows) == [
        (
            r["variant"], r["reached"], r["median_evaluations"], rounded(r["expected_running_time"], ".0f"),
            rounded(r["p_holm"], ".1g"),
        )
        for r in written
    ]  # fmt: skip
    by_name = {r["variant"]: r for r in written}
    medians = {name: float(r["median_evaluations"] or "inf") for name, r in by_name.items()}
    whole = medians["PS-GDE"]
    assert medians["without chaos"] < whole
    assert medians["without local search"] < whole
    assert whole < medians["without sorting"]
    assert medians["Levenberg-Marquardt search"] < 0.2 * whole
    plain = {n: m for n, m in medians.items() if n != "Levenberg-Marquardt search"}
    assert min(plain, key=lambda n: plain[n]) == "sorting alone"
    assert all(float(r["p_holm"]) < 0.05 for r in written if r["p_holm"])


def test_sweep_says_what_was_written() -> None:
    rows = {(r["parameter"], r["value"]): r for r in records("sweep")}
    assert (rows["F", "0.5"]["reached"], rows["F", "0.4"]["reached"]) == ("14", "0")
    assert float(rows["F", "0.7"]["median_evaluations"]) > 1.5 * float(rows["F", "0.6"]["median_evaluations"])
    assert float(rows["CR", "0.95"]["median_evaluations"]) < float(rows["CR", "0.9"]["median_evaluations"])
    assert rows["CR", "1"]["reached"] == "14"
    nc = [float(rows["NC", n]["expected_running_time"]) for n in ("2", "5", "10", "20", "40", "80")]
    assert nc == sorted(nc, reverse=True), "the rarer the local search, the better"


def test_noise_is_the_one_that_was_written() -> None:
    own = [r for r in records("noise") if r["method"] == "ps-gde-lm"]
    written = [r for r in own if r["parameter"] != "pooled"]
    shown = table(PAGE, "What noise does", "method").rows
    assert [row[1:] for row in shown] == [
        (
            r["parameter"],
            f"{100.0 * float(r['bound']) / abs(float(r['truth'])):.2f}",
            f"{float(r['scatter_over_bound']):.3f}",
            f"{float(r['mean_error_over_standard_error']):.2f}",
        )
        for r in written
    ]
    ratios = np.array([float(r["scatter_over_bound"]) for r in written])
    (pooled,) = (float(r["scatter_over_bound"]) for r in own if r["parameter"] == "pooled")
    assert np.sqrt(np.mean(ratios**2)) == pytest.approx(pooled)
    assert f"Pooled the default's scatter is {pooled:.3f} of the bound." in text()
    assert ratios.min() > 0.85
    assert ratios.max() < 1.15
    assert 2.0 * float(written[2]["bound"]) / float(written[2]["truth"]) > 0.1, "box N begins at 0.1 of CLq"


def test_what_is_said_of_noise() -> None:
    pooled = {r["method"]: r for r in records("noise") if r["parameter"] == "pooled"}
    assert [r["runs"] for r in pooled.values()] == ["200", "200"]
    assert pooled["ps-gde-lm"]["elsewhere"] == "0"
    assert "No run of the 200 ended in a wrong optimum" in text()
    wrong, scatter = pooled["ps-gde"]["elsewhere"], float(pooled["ps-gde"]["scatter_over_bound"])
    assert f"PS-GDE has {wrong} runs that are not at the optimum after 500 iterations" in text()
    assert f"which makes its scatter {scatter:.0f} times the bound" in text()


@pytest.mark.parametrize(
    ("name", "terms", "default", "published"), [("lateral", 18, 20, 13), ("longitudinal-full", 14, 20, 20)]
)
def test_what_the_rest_of_equation_1_takes(name: str, terms: int, default: int, published: int) -> None:
    page = (DOCS / "reproduce" / f"{name}.html").read_text(encoding="utf-8")
    for method, found in (("default", default), ("PS-GDE", published)):
        told = rf"{method}: all {terms} values without noise, [^:]*: {found} of 20"
        assert re.search(told, page)
    assert "lateral and directional terms from one maneuver in 20 of 20 runs without noise" in text()
    assert (
        "PS-GDE with 2000 iterations in 13, and all 14 longitudinal terms are found by both in every run"
        in text()
    )


def test_what_v_terms_catch() -> None:
    fits = {r["model"]: r for r in records("longitudinal-full-propulsion") if r["noise"] != "yes"}
    zero, free = fits["V terms zero"], fits["V terms free"]
    share = 1.0 - float(free["cost"]) / float(zero["cost"])
    assert f"falls by {longitudinal.thrust(34.5) - longitudinal.thrust(35.5):.1f} N for each m/s" in text()
    assert (
        f"free V terms take up {100.0 * share:.0f} % of the misfit, CDV comes out at {float(free['CDV']):.3f} "
        f"where the thrust slope looks like {float(fits['first order']['CDV']):.3f} to first order"
    ) in text()
    errors = [100.0 * float(r["largest_error"]) for r in (zero, free)]
    assert (
        f"largest error of the other ten coefficients falls from {errors[0]:.0f} to {errors[1]:.1f} %"
        in text()
    )


def test_what_asymmetry_terms_absorb() -> None:
    fits = {(r["biased"], r["model"]): r for r in records("lateral-biases") if r["noise"] == "no"}
    share = {
        case: 100.0
        * (1.0 - float(fits[case, "terms free"]["cost"]) / float(fits[case, "terms zero"]["cost"]))
        for case, _ in fits
    }
    assert (
        f"take up {share['beta']:.0f} % of the misfit for beta, {share['ay']:.0f} % for ay, {share['phi']:.0f} % for "
        f"phi and nothing for p and r; of all five together {share['all']:.0f} %."
    ) in text()
    assert max(share["p"], share["r"]) < 0.5
    free, zero, biases = (
        float(fits["all", m]["error_rms"]) for m in lateral.MODELS[1::-1] + lateral.MODELS[2:]
    )
    assert f"stay {free:.1f} standard deviations wrong, against {zero:.1f} without the terms" in text()
    assert biases < 1e-3, "altogether"


def test_multirotors_are_those_that_were_written() -> None:
    last = {(r["case"], r["method"]): r for r in records("multirotor")}
    assert list(table(PAGE, "Multirotors", "case").rows) == [
        (
            case, SHOWN[method], r["iterations"], f"{r['reached_target']} of {r['runs']}",
            format(100.0 * float(r["mean_error"]), ".2g") if r["mean_error"] else "",
            f"{float(r['median_fitness']):.6g}", rounded(r["median_evaluations_to_target"], ".0f"),
        )
        for (case, method), r in last.items()
    ]  # fmt: skip


def test_what_is_said_of_multirotors() -> None:
    rows = records("multirotor-parameters")

    def rms(method: str) -> float:
        own = [r["rms_relative_error"] for r in rows if (r["case"], r["method"]) == ("noise", method)]
        return 100.0 * float(np.sqrt(np.mean(np.square([float(e) for e in own]))))

    real = {r["parameter"]: r for r in rows if (r["case"], r["method"]) == ("real", "ps-gde-lm")}
    assert f"off by {rms('ps-gde-lm'):.1f} % (root mean square of all ten)" in text()
    assert f"multiple shooting of the same flights by {rms('multiple-shooting'):.1f} %" in text()
    for name, said in (("rotors.lag", "lag of {:.3f} ± {:.3f} s"), ("rotors.T2", "T2 of {:.1f} ± {:.1f} N")):
        values = [float(real[name][c]) for c in ("truth_or_best", "deviation")]
        assert said.format(*values) in text()
    page = (DOCS / "reproduce" / "multirotor.html").read_text(encoding="utf-8")
    assert "--data ../shared/data" in page


@pytest.mark.parametrize("name", NAMES)
def test_pages_are_those_of_the_commands_and_tell_nothing_of_the_machine(name: str) -> None:
    page = (DOCS / "reproduce" / f"{name}.html").read_text(encoding="utf-8")
    experiment = EXPERIMENTS[name]
    command = f"stoop reproduce {name} --runs {experiment.runs} --seed 0 --box {experiment.box}"
    assert command in page
    assert f"[page](reproduce/{name}.html)" in PAGE.read_text(encoding="utf-8")
    assert command in (DOCS / "reproduce" / "index.html").read_text(encoding="utf-8")
    assert not re.search(r"/(home|tmp|work|root|Users)/", page)
    assert len(page) < 300_000


def text() -> str:
    """Return the page with single spaces."""
    return " ".join(PAGE.read_text(encoding="utf-8").split())


def records(name: str) -> list[dict[str, str]]:
    with (DOCS / "reproduce" / f"{name}.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


def rounded(text: str, how: str) -> str:
    return format(float(text), how) if text else ""
