"""JSBSim as truth: its aircraft and quadrotor are identified, and the whole loop by files, from a log to a better model."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from helpers.flown import maneuver

from stoop import load_maneuver, load_vehicle
from stoop.cli.main import main
from stoop.simulation.maneuver import Maneuver
from stoop.vehicle.builtin import builtin_text
from stoop_export.jsbsim_autopilot import fly_in_jsbsim
from stoop_plan.flight_logs import save_flight_as
from stoop_studies.verify import jsbsim, multirotor


@pytest.mark.parametrize("case", ["trainer", "quadrotor, by its speeds", "quadrotor, by its commands"])
def test_a_vehicle_is_found_from_its_outputs(case: str) -> None:
    """Every number within three standard errors or 2 %; those of an airplane together scatter as they say."""
    recorded = multirotor.SPEEDS if "speeds" in case else multirotor.COMMANDS
    flown: Any = jsbsim.flown_case("T37") if case == "trainer" else multirotor.flown_case(recorded)
    told, names = flown.estimates(flown.flight(seed=0)), np.array(list(flown.truth))
    truth, found, sigma = (np.array([told[k][n] for n in names]) for k in ("truth", "estimate", "sigma"))
    off = np.abs(found - truth)
    agree = off <= np.maximum(jsbsim.SIGMAS * sigma, jsbsim.SHARE * np.abs(truth))
    assert agree.all(), names[~agree]
    if case == "trainer":
        assert 0.4 < np.mean((off / sigma) ** 2) < 2.0, "36 normal squares, were they independent"


TRUTH = load_vehicle("twin-boom")
NAMES = [p.name for p in TRUTH.parameters if p.free and p.value]


def flown(folder: Path, name: str, maneuver: Maneuver, seed: int, model: Path) -> Path:
    """Fly it in JSBSim, by an autopilot that knows the poor model, and write a log."""
    save_flight_as(fly_in_jsbsim(TRUTH, maneuver, load_vehicle(model), seed), folder / name)
    return folder / name


def errors(folder: Path) -> tuple[np.ndarray, np.ndarray]:
    found = json.loads((folder / "result.json").read_text())["parameters"]
    both = [(found[n]["estimate"] - TRUTH.value(n), found[n]["std_error"]) for n in NAMES]
    off, sigma = np.array(both, dtype=float).T
    return off, sigma


def test_the_loop_from_log_to_a_better_model(tmp_path: Path) -> None:
    model, text, rng = tmp_path / "guess.toml", builtin_text("twin-boom"), np.random.default_rng(3)
    for name in NAMES:  # every derivative is off, and priors say so
        value = TRUTH.value(name) * (1.0 + 0.2 * float(rng.choice([-1.0, 1.0])))
        number = f"{name} = {{ value = {value!r}, prior = {0.3 * abs(value)!r} }}"
        text, count = re.subn(rf"^{name} = .*$", number, text, flags=re.M)
        assert count == 1, name
    model.write_text(text)
    pilot = [(c, "doublet", t, 1.0, 0.01) for c, t in (("elevator", 2.0), ("aileron", 7.0), ("rudder", 12.0))]
    before = flown(tmp_path, "before.ulg", maneuver(20.0, *pilot, rate=100.0, airspeed=35.0), 1, model)
    known = ["--vehicle", str(model), "--maneuver", "0.2:19.8"]
    assert main(["identify", str(before), *known, "-o", str(tmp_path / "first")]) == 0

    shape = ["--shape", "square", "--evaluations", "60"]
    design = ["design", str(tmp_path / "first"), *shape, "-o", str(tmp_path / "next")]
    assert main([*design, "--for", "ardupilot", "--throw", "elevator=25", "aileron=20", "rudder=25"]) == 0
    after = flown(tmp_path, "flown.ulg", load_maneuver(tmp_path / "next" / "maneuver.toml"), 2, model)
    assert main(["identify", str(after), *known, "-o", str(tmp_path / "second")]) == 0

    guessed = np.array([load_vehicle(model).value(n) - TRUTH.value(n) for n in NAMES])
    (off_first, sigma_first), (off, sigma) = errors(tmp_path / "first"), errors(tmp_path / "second")
    score = np.abs(off / sigma)
    assert np.mean(score < 1.96) > 0.85, "a normal sample of this size has 0.95 ± 0.04"
    assert np.max(score) < 4.0, NAMES[int(np.argmax(score))]
    assert np.median(sigma / sigma_first) < 0.5
    assert np.median(np.abs(off)) < 0.5 * np.median(np.abs(off_first))
    assert np.median(np.abs(off / guessed)) < 0.2
