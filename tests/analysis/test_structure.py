"""`stoop structure`: the file that it writes is a vehicle with the chosen terms, comments and all, and identify takes it."""

import csv
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from naive.regression import best_subset, press, rss

from stoop.cli.main import main
from stoop.errors import IdentificationError, TermError
from stoop.estimate.regression.least_squares import FrequencyDomain
from stoop.flight import Flight, save_flight
from stoop.problem.windows import Window
from stoop.simulation import trim
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle import Vehicle, load_vehicle, parse_vehicle, terms
from stoop.vehicle.terms import parameter_name
from stoop_analysis.structure import (
    Model,
    PartialF,
    Press,
    Regression,
    determine,
    orthogonal,
    parents,
    parse_candidates,
    standard_candidates,
    stepwise,
)
from stoop_analysis.workflow.structure import FILES, structure

BAND = FrequencyDomain(0.04, 1.5)
NOISE = {"V": 0.1, "alpha": 0.002, "q": 0.005, "theta": 0.005, "ax": 0.03, "az": 0.03}


@pytest.fixture(scope="module")
def aircraft() -> Vehicle:
    """A longitudinal aircraft whose pitching moment is curved; alpha counts from its trim."""
    base = load_vehicle("twin-boom")
    level = trim(base, None, 200.0).start["alpha"]
    text = base.text
    for old, new in (
        ("alpha = 0.0", f"alpha = {level:.4f}"), ("Cm0 = 0.194", "Cm0 = -0.0235 # at trim"), ("CL0 = 0.385", "CL0 = 0.876"),
        ("CD0 = 0.06", "CD0 = 0.104"), ("CmV = 0.0", 'CmV = 0.0\nCmcurve = { term = "alpha^2", value = -4.0 }'),
    ):  # fmt: skip
        text = text.replace(old, new)
    vehicle = parse_vehicle(text, "curved").reduced("longitudinal")
    thrust = trim(vehicle, None, 200.0).changes["propulsion.thrust"]
    return vehicle.with_numbers({"propulsion.thrust": {"value": thrust}})


@pytest.fixture(scope="module")
def flight(aircraft: Vehicle) -> Flight:
    return flown(aircraft, NOISE, 1)


def flown(vehicle: Vehicle, noise: dict[str, float], seed: int) -> Flight:
    shape = {"control": "elevator", "shape": "multisine", "start": 0.0, "duration": 60.0}
    table = shape | {"amplitude": 0.2, "band": 1.2, "first": 6}
    maneuver = Maneuver.model_validate({"duration": 60.0, "rate": 50.0, "input": [table], "noise": noise})
    return simulate_flight(vehicle, maneuver, seed, name="sim")


def ignorant(aircraft: Vehicle) -> Vehicle:
    """Return a file that lacks the curvature and knows no derivative."""
    thrust = aircraft.value("propulsion.thrust")
    text = aircraft.text.replace("Cmcurve", "# Cmcurve").replace("value = 220.87", f"value = {thrust:.6f}")
    text = text.replace("Cmq = -47.6", "Cmq = { value = -1.0, bounds = [-20.0, 0.0] } # a guess")
    return parse_vehicle(text + '\n[model]\nreduce = "longitudinal"\n', "ignorant")


def test_the_true_terms_are_found_and_written(aircraft: Vehicle, flight: Flight) -> None:
    vehicle = ignorant(aircraft)
    found = structure(vehicle, {"sim": flight}, ["0:60"], standard_candidates(vehicle), stepwise, BAND)
    assert set(found.structure.chosen["Cm"].terms) == {"alpha", "q", "elevator", "alpha^2"}
    assert set(found.structure.chosen["CD"].terms) == {"alpha"}
    written = parse_vehicle(found.vehicle.text, "written")
    assert set(written.terms["Cm"].values()) == {"1", "alpha", "q", "elevator", "alpha^2"}
    assert written.value("Cmalpha2") == pytest.approx(-4.0, rel=0.15)
    assert written.value("Cmalpha") == pytest.approx(-2.12, rel=0.05)
    assert written.value("Cmq") == pytest.approx(-47.6, rel=0.1)  # beyond its bounds, which were widened
    assert "CmV" not in written.terms["Cm"]
    assert "# at trim" in found.vehicle.text
    assert "# a guess" in found.vehicle.text
    assert all(written.parameters[written.rows[n]].free for n in found.names["Cm"].values())


def test_other_coefficients_stay_as_they_are(aircraft: Vehicle, flight: Flight) -> None:
    vehicle = ignorant(aircraft)
    found = structure(vehicle, {"sim": flight}, ["0:60"], {"Cm": ("alpha", "q", "elevator")}, stepwise, BAND)
    assert tuple(found.structure.chosen) == ("Cm",)
    assert found.vehicle.terms["CL"] == vehicle.terms["CL"]
    assert found.vehicle.value("CLalpha") == vehicle.value("CLalpha")


def test_what_moves_together_is_said(aircraft: Vehicle, flight: Flight) -> None:
    candidates = {"Cm": ("alpha", "q", "elevator", "2*elevator", "beta")}
    found = determine(aircraft, {"sim": flight}, [Window("sim", 0.0, 60.0)], candidates, stepwise, BAND)
    notices = {n.code: n.values for n in found.chosen["Cm"].notices}
    assert notices["candidates-correlated"]["terms"] == ("elevator", "2*elevator")
    assert notices["candidate-constant"]["terms"] == ("beta",)
    assert len({"elevator", "2*elevator"} & set(found.chosen["Cm"].terms)) == 1


def test_short_windows_and_candidates_of_another_model_are_refused(aircraft: Vehicle, flight: Flight) -> None:
    flights, short, long = {"sim": flight}, Window("sim", 0.0, 1.0), Window("sim", 0.0, 60.0)
    with pytest.raises(IdentificationError, match="too short"):
        determine(aircraft, flights, [short], standard_candidates(aircraft), stepwise, BAND)
    with pytest.raises(IdentificationError, match="no coefficient of the longitudinal model has a candidate"):
        determine(aircraft, flights, [long], {"Cn": ("beta",)}, stepwise, BAND)
    with pytest.raises(IdentificationError, match=r"--keep CLqq: .*CLq"):
        structure(aircraft, flights, ["0:60"], {"CL": ("alpha",)}, stepwise, BAND, ["CLqq"])


def test_lines_of_candidates(aircraft: Vehicle) -> None:
    lines = ["# what we think", "Cm: alpha, q,elevator , alpha", "", "CL: alpha^2 # curved"]
    found = {"Cm": ("alpha", "q", "elevator"), "CL": ("alpha^2",)}
    assert parse_candidates(lines, aircraft, "c.txt") == found
    for line, error, words in (
        ("alpha, q", IdentificationError, "write a line per"), ("CX: alpha", IdentificationError, "write a line per"),
        ("Cm:", IdentificationError, "names no candidate"), ("Cm: flaps", TermError, "unknown variable 'flaps'"),
        ("Cm: __import__('os')", TermError, "not allowed"),
    ):  # fmt: skip
        with pytest.raises(error, match=words):
            parse_candidates([line], aircraft, "c.txt")


def test_names_of_parameters() -> None:
    assert parameter_name("Cm", "alpha^2") == "Cmalpha2"
    assert parameter_name("Cl", "alpha*aileron") == "Clalphaaileron"
    assert parameter_name("Cm", "alpha^2", ["Cmalpha2"]) == "Cmalpha2_2"
    assert len(parameter_name("Cm", "+".join(["alpha"] * 30))) <= 40


def test_verb(aircraft: Vehicle, flight: Flight, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source, log, out = tmp_path / "v.toml", tmp_path / "sim.nc", tmp_path / "out"
    source.write_text(ignorant(aircraft).text, encoding="utf-8")
    save_flight(flight, log)
    words = f"structure {source} {log} --maneuver 0:60 --band 0.04:1.5 -o {out}".split()
    assert main(words) == 0
    assert "next: stoop identify" in capsys.readouterr().out
    assert sorted(p.name for p in out.iterdir()) == sorted(FILES)
    rows = list(csv.DictReader((out / "structure.csv").read_text(encoding="utf-8").splitlines()))
    assert {r["coefficient"] for r in rows} == {"CL", "CD", "Cm"}
    assert np.isfinite([float(r["PRESS"]) for r in rows]).all()
    assert load_vehicle(out / "vehicle.toml").reduce == "longitudinal"
    assert main(words) == 2
    assert "--overwrite" in capsys.readouterr().err
    fitted = f"identify {log} --vehicle {out / 'vehicle.toml'} --maneuver 0:60 --method frequency-domain"
    assert main([*fitted.split(), "-o", str(tmp_path / "result")]) == 0
    assert "Cmalpha2" in capsys.readouterr().out


def test_what_is_left_out_and_biases_its_neighbors_is_said_and_can_be_kept(aircraft: Vehicle) -> None:
    vehicle = aircraft.with_numbers({"CLq": {"value": 5.0}})
    flight = flown(vehicle, {"V": 0.2, "alpha": 0.004, "q": 0.01, "theta": 0.01, "ax": 0.3, "az": 0.3}, 4)
    candidates = {"CL": ("alpha", "q", "elevator")}
    plain = structure(vehicle, {"sim": flight}, ["0:60"], candidates, stepwise, BAND)
    (told,) = [n for n in plain.structure.chosen["CL"].notices if n.code == "term-left-out"]
    assert (told.subject, told.values["term"]) == ("CLq", "q")
    assert "--keep CLq" in str(told)
    kept = structure(vehicle, {"sim": flight}, ["0:60"], candidates, stepwise, BAND, ["CLq"])
    assert "q" in kept.structure.chosen["CL"].terms
    assert not [n for n in kept.structure.chosen["CL"].notices if n.subject == "CLq"]
    own = plain.names["CL"]
    for term, move in zip(told.values["moved"], told.values["moves"], strict=True):
        (value, error), (with_it, _) = (f.estimates[own[term]] for f in (plain, kept))
        assert (with_it - value) / error == pytest.approx(move, rel=0.25, abs=0.4)


def rows(y: np.ndarray, X: np.ndarray) -> Regression:
    """Return a regression whose residuals count as white."""
    return Regression(y, X, (slice(0, len(y)),), 1.0, FrequencyDomain())


def drawn(seed: int, n: int = 120, k: int = 8) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    X = rng.standard_normal((n, k)) @ (np.eye(k) + 0.3 * rng.standard_normal((k, k)))
    return rng.standard_normal(n), X


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 10_000))
def test_press_is_the_sum_of_squares_of_rows_left_out(seed: int) -> None:
    y, X = drawn(seed, 25, 4)
    assert Model(rows(y, X), (0, 1, 3)).press == pytest.approx(press(y, X[:, [0, 1, 3]]), rel=1e-9)


def test_the_partial_f_is_the_square_of_students_t() -> None:
    y, X = drawn(3)
    columns = (0, 1, 5)
    inverse = np.linalg.inv(X[:, columns].T @ X[:, columns])
    estimate = inverse @ X[:, columns].T @ y
    variance = rss(y, X[:, columns]) / (len(y) - 3) * np.diag(inverse)
    found = [Model(rows(y, X), columns).partial_f(c) for c in columns]
    np.testing.assert_allclose(found, estimate**2 / variance, rtol=1e-9)


@pytest.mark.parametrize("seed", range(5))
def test_a_clear_set_is_found(seed: int) -> None:
    noise, X = drawn(seed)
    y = X[:, [1, 4, 6]] @ [3.0, -2.0, 4.0] + 0.1 * noise
    assert tuple(sorted(stepwise(rows(y, X)).model.columns)) == (1, 4, 6) == best_subset(y, X, 3)
    assert {1, 4, 6} <= set(orthogonal(rows(y, X)).model.columns)  # which takes nothing back


def test_terms_that_cancel_are_found_on_the_way_down() -> None:
    """Alone none of the three explains a thing; the way up from nothing stops at once."""
    rng = np.random.default_rng(2)
    a, b = rng.standard_normal((2, 150))
    small = 0.25 * rng.standard_normal(150)
    X = np.column_stack([a, b, -(a + b) + small, *rng.standard_normal((3, 150))])
    y = X[:, :3].sum(axis=1) + 0.01 * rng.standard_normal(150)
    assert sorted(stepwise(rows(y, X)).model.columns) == [0, 1, 2]


def test_chance_alone_brings_in_a_term_as_seldom_as_is_said() -> None:
    """A significance of 0.2 among six candidates: Bonferroni holds it to at most 0.2, and to little less."""
    rule = PartialF(0.2)
    hits = sum(bool(stepwise(rows(*drawn(seed, 60, 6)), rule).model.columns) for seed in range(150))
    assert 0.08 * 150 < hits < 0.28 * 150


def test_products_and_powers_stand_on_their_variables() -> None:
    known = {"alpha", "beta", "q", "elevator", "rudder"}
    plain = ("alpha^3", "alpha", "elevator", "alpha*elevator", "beta^2", "abs(alpha)", "2*alpha")
    found = parents([terms.parse(name, known, "test") for name in (*plain, "rudder*elevator")])
    assert found == ((1,), (), (), (1, 2), (), (), (), (2,))


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000))
def test_nothing_is_chosen_without_what_it_stands_on(seed: int) -> None:
    noise, X = drawn(seed, 60, 3)
    columns = np.column_stack([X, X[:, 0] ** 2, X[:, 1] ** 3, X[:, 0] * X[:, 2]])
    y = columns @ np.random.default_rng(seed).choice([0.0, 1.0], 6) + noise
    data = replace(rows(y, columns), parents=((), (), (), (0,), (1,), (0, 2)))
    for criterion in (stepwise, orthogonal, lambda r: stepwise(r, Press())):
        model = criterion(data).model
        assert all(set(data.parents_of(c)) <= set(model.columns) for c in model.columns)
