"""A quadrotor, flown by its autopilot: short windows and accelerations find it, and a log that tells nothing is said so."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from stoop.checks.excitation import in_ratio, ratios
from stoop.checks.rotors import foreign_motors, rotor_notices
from stoop.errors import FlightError, IdentificationError
from stoop.estimate import methods
from stoop.estimate.fit import Options, estimation_problem
from stoop.flight import from_columns
from stoop.problem.windows import Window
from stoop.simulation.fly import simulate_flight
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import resolve_vehicle
from stoop.workflow import identify

WINDOW = [Window("sim", 0.0, 16.0)]
WIND = (2.0, -1.0, 0.0)
MANEUVER = """
duration = 16.0
rate = 100.0
wind = [2.0, -1.0, 0.0]
"""
INPUTS = (
    ("roll", "doublet", 1.0, 0.15, 8.0),
    ("pitch", "doublet", 2.0, 0.15, 8.0),
    ("yaw", "doublet", 3.0, 0.4, 1.5),
    ("heave", "3-2-1-1", 4.0, 0.25, 2.0),
    ("north", "doublet", 6.0, 2.0, 2.5),
    ("east", "doublet", 8.0, 2.0, 2.5),
    ("down", "doublet", 9.5, 2.0, 1.0),
    ("roll", "doublet", 13.0, 0.15, -8.0),
    ("pitch", "doublet", 14.0, 0.15, -8.0),
)
WRONG = {
    "rotors.T1": 0.8, "rotors.T2": 1.2, "rotors.inflow": 1.3, "rotors.drag": 0.7, "rotors.torque_ratio": 1.25,
    "rotors.lag": 1.3,
}  # fmt: skip


def maneuver_text() -> str:
    names = ("control", "shape", "start", "step", "amplitude")
    tables = [
        "[[input]]\n"
        + "\n".join(
            f'{n} = "{v}"' if isinstance(v, str) else f"{n} = {v}" for n, v in zip(names, one, strict=True)
        )
        for one in INPUTS
    ]
    return MANEUVER + "\n".join(tables)


@pytest.fixture(scope="module")
def quad():
    text = resolve_vehicle("quad-x").text.replace("lag = ", "delay = 0.012\nlag = ", 1)
    return parse_vehicle(text.replace("# front left\n", "# front left\nfactor = 0.85\n", 1), "quad.toml")


@pytest.fixture(scope="module")
def flight(quad):
    return simulate_flight(quad, parse_maneuver(maneuver_text(), "m"), seed=1, name="sim")


@pytest.fixture(scope="module")
def start(quad):
    wrong = {n: {"value": quad.value(n) * f, "free": True} for n, f in WRONG.items()}
    more = {"rotors.delay": {"value": 0.02, "free": True}, "rotor.m3.factor": {"value": 1.0, "free": True}}
    return quad.with_numbers({**wrong, **more})


@pytest.fixture(scope="module")
def job(start, flight):
    return identify(start, flight, ["0:11"], validate=["11.5:16"])


def off(quad, parameters) -> np.ndarray:
    return np.array([(p.estimate - quad.value(n)) / p.std_error for n, p in parameters.items()])


def test_windows_are_the_default_and_find_the_truth(quad, job):
    result = job.result
    assert result.method == "multiple-shooting"
    assert result.status == "converged"
    assert np.abs(off(quad, result.parameters)).max() < 3.5
    assert result.parameters["rotor.m3.factor"].estimate == pytest.approx(0.85, abs=0.01)
    assert result.parameters["rotors.delay"].estimate == pytest.approx(0.012, abs=1e-3)
    for channel, blown in zip(("vn", "ve", "vd"), WIND, strict=True):
        bias = result.biases[0].values[channel]
        assert abs(bias.estimate - blown) < 4.0 * bias.std_error


def test_what_was_not_fitted_is_predicted_window_by_window(job):
    fitted, predicted = job.result.maneuvers
    assert (fitted.role, predicted.role) == ("fit", "validation")
    for channel in ("p", "q", "r", "az"):
        assert predicted.channels[channel].theil < 0.3, channel
    assert predicted.channels["az"].theil < predicted.channels["az"].baseline_theil
    result = job.result
    assert "predicted-in-windows" in [n.code for n in result.data_notices]
    assert "multiple-shooting-rotors" in [n.code for n in result.basis]


def test_motors_that_were_logged_slowly_are_fitted_by_their_accelerations(start, flight):
    sources = {name: replace(s, rate=43.0) if "motor" in name else s for name, s in flight.sources.items()}
    found = identify(start, replace(flight, sources=sources), ["0:16"])
    assert found.result.method == "equation-error"
    (why,) = [n for n in found.result.basis if n.code == "motors-logged-slowly"]
    assert why.values["rate"] == 43.0


def test_the_folder_is_written_whole(job, tmp_path):
    job.save(tmp_path / "out")
    page = (tmp_path / "out" / "report.html").read_text()
    assert "multiple shooting" in page
    assert "rotors.T2" in page


def test_accelerations_alone_come_close(quad, start, flight):
    found = identify(start, flight, ["0:16"], options=Options(method="equation-error")).result.parameters
    for name in ("rotors.T2", "rotors.torque_ratio", "rotors.drag", "rotor.m3.factor", "rotors.delay"):
        assert found[name].estimate == pytest.approx(quad.value(name), rel=0.1), name
    with pytest.raises(IdentificationError, match="equation-error or multiple-shooting"):
        methods.find("frequency-domain").fitter()(start, {"sim": flight}, WINDOW, Options())


def test_a_hopeless_start_is_searched_for(start, flight, monkeypatch, resumed):
    """Without the regression's start, and with thrust and torque far off, the optimizer takes over; it may be interrupted."""
    from stoop.estimate import multiple_shooting as method

    monkeypatch.setattr(
        method, "starts", lambda problem, _: problem.layout.unit(np.array([p.value for p in problem.layout.parameters]))[None]
    )  # fmt: skip
    held = {
        p.name: {"free": False}
        for p in start.parameters
        if p.free and p.name.startswith(("rotors.", "rotor.", "body_drag."))
    }
    lost = start.with_numbers(
        held
        | {
            "rotors.T2": {"value": 0.7, "free": True, "bounds": (0.1, 20.0)},
            "rotors.T1": {"value": 0.5, "free": True, "bounds": (0.0, 10.0)},
        }
    )
    right = {n: {"value": v} for n, v in (("rotors.delay", 0.012), ("rotor.m3.factor", 0.85))}
    right |= {
        n: {"value": start.value(n) / f} for n, f in WRONG.items() if n not in ("rotors.T1", "rotors.T2")
    }
    options = Options(budget=900.0)
    window = [Window("sim", 0.0, 8.0)]
    fit = resumed(method.fit, lost.with_numbers(right), {"sim": flight}, window, options)
    assert fit.outcome.optimizer == "ps-gde-lm"
    assert fit.estimates["rotors.T2"] == pytest.approx(6.0, rel=0.02)
    assert "global-start" in [n.code for n in fit.notices]


def test_without_mass_and_inertia_ratios_are_told(quad, flight):
    free = {n: {"free": True} for n in ("mass.mass", *(f"mass.inertia.{a}" for a in ("xx", "yy", "zz")))}
    unknown = quad.with_numbers({**free, "mass.mass": {"value": 3.0, "free": True}})
    problem, _ = estimation_problem(unknown, {"sim": flight}, WINDOW, Options())
    names = [p.name for p in problem.layout.parameters]
    assert "mass.mass" not in names
    assert "mass.inertia.xx" in names
    said = ratios(problem.layout.vehicle, {"rotors.T2": (12.0, 0.3)})
    assert "rotors.T2 4 +/- 0.1 N/kg" in said
    free_of = "drag_inflow = { value = 0.001, free = %s }"
    told, held = (
        parse_vehicle(quad.text.replace("[rotors]", f"[rotors]\n{free_of % word}", 1), "quad").with_numbers(
            free
        )
        for word in ("true", "false")
    )
    assert "rotors.drag_inflow" in {p.name for p in in_ratio(told)}
    assert not in_ratio(held)  # a force that is known tells the mass
    weighed = unknown.with_numbers({"mass.mass": {"value": 1.5, "prior": 0.1}})
    assert not in_ratio(weighed)
    known = quad.with_numbers({"mass.mass": {"free": True}})  # inertia is known, and tells it
    assert not in_ratio(known)


@pytest.mark.parametrize("seed", range(4))
def test_a_hostile_start_without_attitude_ends_in_a_value_or_in_one_line(quad, flight, ends_well, seed):
    """Attitude and velocity of windows follow from nothing; the former grew to 1e60 and ended in a traceback."""
    rng, blank = np.random.default_rng(seed), np.full(len(flight.time), np.nan)
    imu = changed(flight, **dict.fromkeys(("vn", "ve", "vd", "phi", "theta", "psi"), blank))
    wild = {
        p.name: {"value": p.value * 10.0 ** rng.uniform(-2.0, 2.0), "free": True, "bounds": [1e-9, 1e4]}
        for p in quad.parameters
        if p.name.startswith(("rotors.T", "rotors.lag", "mass.inertia.xx", "mass.inertia.yy"))
        and p.value > 0.0
    }
    options = Options(method="multiple-shooting", budget=1500.0)
    args = (quad.with_numbers(wild), {"sim": imu}, [Window("sim", 0.0, 6.0)], options)
    ends_well(lambda: methods.find("multiple-shooting").fitter()(*args))


def changed(flight, **columns):
    kept = {str(n): flight.column(str(n)) for n in flight.data.data_vars}
    return replace(from_columns("sim", flight.time, {**kept, **columns}, ()), sources=flight.sources)


def test_a_log_without_rates_is_refused(start, flight):
    blank = np.full(len(flight.time), np.nan)
    with pytest.raises(IdentificationError, match=r"none of the rates p, q, r was recorded.*\[variables\]"):
        estimation_problem(start, {"sim": changed(flight, p=blank, q=blank, r=blank)}, WINDOW, Options())


def test_motors_off_are_no_flight(start, flight):
    off = {f"motor_{i}": np.where(flight.time < 12.0, 0.01 * i, 0.6 + 0.01 * i) for i in range(1, 5)}
    with pytest.raises(IdentificationError, match=r"motors are off in 75% .*rotors\.idle"):
        estimation_problem(start, {"sim": changed(flight, **off)}, WINDOW, Options())
    partly = {n: np.where(flight.time < 3.0, 0.0, flight.column(n)) for n in off}
    problem, _ = estimation_problem(start, {"sim": changed(flight, **partly)}, WINDOW, Options())
    (one,) = (one for one in rotor_notices(problem) if one.code == "motors-off")
    assert one.values["first"] == pytest.approx(3.0, abs=0.02)


def test_saturation_and_stillness_are_said(start, flight):
    full = np.where(flight.time < 4.0, 1.0, flight.column("motor_2"))
    problem, _ = estimation_problem(start, {"sim": changed(flight, motor_2=full)}, WINDOW, Options())
    (one,) = (one for one in rotor_notices(problem) if one.code == "command-saturated")
    assert (one.subject, one.values["end"]) == ("motor_2", "upper")
    assert one.values["share"] == pytest.approx(0.25, abs=0.005)
    rng = np.random.default_rng(0)
    still = {f"motor_{i}": 0.6 + 1e-4 * rng.standard_normal(len(flight.time)) for i in range(1, 5)}
    still |= {c: 0.01 * rng.standard_normal(len(flight.time)) for c in "pqr"}
    problem, _ = estimation_problem(start, {"sim": changed(flight, **still)}, WINDOW, Options())
    codes = [one.code for one in rotor_notices(problem)]
    assert codes.count("axis-not-excited") == 3
    assert "lift-not-excited" in codes


def test_a_pulse_in_a_long_window_is_excitation(start):
    """What is rms over the whole window says less of it the longer the window is."""
    pulse = '[[input]]\ncontrol = "{}"\nshape = "doublet"\nstart = {}\nstep = 0.4\namplitude = {}\n'
    axes = (("roll", 3, 4.0), ("pitch", 6, 4.0), ("yaw", 9, 0.7), ("heave", 12, 1.0))
    text = "duration = 60.0\nrate = 100.0\n" + "".join(pulse.format(*one) for one in axes)
    flown = simulate_flight(start, parse_maneuver(text, "m"), seed=1, name="sim")
    for window, silent in ((Window("sim", 2.0, 59.0), True), (Window("sim", 20.0, 59.0), False)):
        problem, _ = estimation_problem(start, {"sim": flown}, [window], Options())
        assert (rotor_notices(problem) == []) is silent
    inputs = np.concatenate(
        [
            p.inputs
            for p in estimation_problem(start, {"sim": flown}, [Window("sim", 2.0, 59.0)], Options())[
                0
            ].pieces
        ]
    )
    assert np.std(inputs.sum(axis=1)) < 0.01 * np.mean(inputs.sum(axis=1)), "quiet in the mean"


def test_the_log_of_another_vehicle_is_recognized(start, flight):
    hexa = resolve_vehicle("hexa-x")
    with pytest.raises(FlightError, match=r"input .motor_5., .motor_6. is not in this flight.*\[rotor\.m5\]"):
        estimation_problem(hexa, {"sim": flight}, WINDOW, Options())
    constant = {n: np.full(len(flight.time), 0.0) for n in ("motor_5", "motor_6")}
    with pytest.raises(
        IdentificationError, match=r"motor_5, motor_6 never change.*\[rotor\.m5\], \[rotor\.m6\]"
    ):
        estimation_problem(hexa, {"sim": changed(flight, **constant)}, WINDOW, Options())
    moving = {n: flight.column("motor_1") for n in constant}
    (one,) = foreign_motors(start, changed(flight, **moving), WINDOW)
    assert (one.code, one.values["channels"]) == ("foreign-motors", ("motor_5", "motor_6"))


@pytest.mark.parametrize(("name", "wrong"), [("mass.mass", 1.2), ("mass.inertia.xx", 1.5)])
def test_a_wrong_mass_or_inertia_is_named_and_its_value_comes_out(quad_and_flight, name, wrong):
    """Thrust takes up the error silently: thrust nearly independent of the command, and much more drag."""
    vehicle, calm = quad_and_flight
    off = vehicle.with_numbers({name: {"value": wrong * vehicle.value(name)}})
    given = identify(off, calm, ["0:11"], validate=["11.5:16"]).result
    assert given.extensions.found[0].name == name
    assert name == "mass.inertia.xx" or given.verdict.grade == "do not use"
    longer = identify(off, calm, ["0:11"], validate=["11.5:16"], extend=True).result
    assert longer.parameters[name].estimate == pytest.approx(vehicle.value(name), rel=0.01)
    assert longer.verdict.grade == "usable"


@pytest.fixture(scope="module")
def quad_and_flight():
    vehicle = resolve_vehicle("quad-x")
    return vehicle, simulate_flight(vehicle, parse_maneuver(maneuver_text(), "m"), seed=1, name="sim")
