"""By every method: an estimate comes back from its arrays with the same bits, and a divergence while it searches is a value."""

import io
import itertools
import json
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from helpers.fits import fit_by
from helpers.flown import maneuver, with_few_free

from stoop import Flight, Vehicle, load_vehicle, simulate_flight
from stoop.assessment.assessment import pack
from stoop.assessment.error_bars import ErrorBars
from stoop.assessment.goodness_of_fit import left_out_residuals, press_notices
from stoop.base.npz import read_arrays
from stoop.errors import IdentificationError, StoopError
from stoop.estimate import methods, shooting_windows
from stoop.estimate.estimate import Estimate
from stoop.flight.flight import from_columns
from stoop.kernels import filtering
from stoop.kernels.kernel import Kernel
from stoop.prediction.predict import expected_biases, predict, predictor
from stoop.problem.windows import Window
from stoop.vehicle import parse_vehicle, trajectories

from .regression.test_aircraft import TRUTH, WOBBLE, flown

FREE = ("CLalpha", "Cmalpha", "Cmq", "Cmelevator")
QUADROTOR = [(m, "quadrotor") for m in ("multiple-shooting", "equation-error")]
MANEUVER = maneuver(8.0, ("elevator", "3-2-1-1", 0.5, 0.4, 0.05))


Problem = tuple[Vehicle, dict[str, Flight], list[Window]]


@pytest.fixture(scope="module")
def aircraft() -> Problem:
    late = parse_vehicle(load_vehicle("twin-boom").text + "[sensors.alpha]\ndelay = 0.033\n", "late")
    vehicle, out = with_few_free(late.reduced("longitudinal"), FREE), {}
    for seed, name in enumerate(("a", "b")):
        record = simulate_flight(vehicle, MANEUVER, seed=seed, name=name)
        columns = {c: record.column(c).copy() for c in record.names}
        columns["q"][[50, 170]] += 3.0
        out[name] = from_columns(name, record.time, columns)
    return vehicle, out, [Window("a", 0.0, 8.0)]


@pytest.fixture(scope="module")
def quadrotor() -> Problem:
    vehicle = with_few_free(load_vehicle("quad-x"), TRUTH)
    noise = dict(zip("pqr", np.random.default_rng(1).normal(0.0, WOBBLE, (3, 400)), strict=True))
    flights = {n: replace(flown(vehicle, False, TRUTH, **noise), name=n) for n in "ab"}
    return vehicle, flights, [Window("a", 0.0, 3.99)]


def same(one: Any, other: Any) -> None:
    if isinstance(one, Mapping):
        assert list(one) == list(other)
        same(list(one.values()), list(other.values()))
    elif isinstance(one, list | tuple) and not all(isinstance(x, float | str) for x in one):
        assert len(one) == len(other)
        for pair in zip(one, other, strict=True):
            same(*pair)
    else:
        np.testing.assert_array_equal(one, other)


def saved(found: Estimate) -> dict[str, Any]:
    file = io.BytesIO()
    np.savez_compressed(file, **found.state())
    return read_arrays(file, 2**28)


def compared(found: Estimate) -> list[Any]:
    bars, evidence = ErrorBars.of(found), found.evidence
    observed = bars.uncertainty.coloring.observed
    return [
        found.z, found.cost, found.estimates, [[p.residual, p.jacobian, p.continuity_residuals] for p in evidence.pieces],
        evidence.prior, bars.covariance, found.readings, found.residuals, found.measurement_noise, found.inflation,
        found.disagreement, found.deviations(bars.covariance) or (), () if observed is None else observed,
        list(found.responses().pieces), left_out_residuals(found) or (), [p.measured for p in found.prepared.pieces],
    ]  # fmt: skip


@pytest.mark.parametrize(("method", "kind"), [(m, "aircraft") for m in methods.names()] + QUADROTOR)
def test_an_estimate_comes_back_with_the_same_bits(method: str, kind: str, request: Any) -> None:
    problem = request.getfixturevalue(kind)
    found = fit_by(method, *problem)
    again = methods.restore(method, saved(found), "model.npz")
    same(compared(again), compared(found))
    assert type(again) is type(found)
    for name in ("unknowns", "notices", "process_noise"):
        assert getattr(again, name) == getattr(found, name), name
    assert (again.prepared.notices, press_notices(again)) == (found.prepared.notices, press_notices(found))
    assert pack(again.refit_problem, {}) == pack(found.refit_problem, {})
    window, ahead = [Window("b", 1.0, 3.5)], []
    for one in (again, found):
        model = predictor(one, ErrorBars.of(one).covariance)
        found_ahead = predict(model, problem[1], window, [expected_biases(one, "b")])
        ahead.append([found_ahead.readings, found_ahead.deviations, found_ahead.innovations or ()])
    same(*ahead)


def changed(arrays: Mapping[str, Any], **entries: Any) -> dict[str, Any]:
    head = json.loads(arrays["head"].tobytes())
    head["problem"] |= entries
    return {**arrays, "head": np.frombuffer(json.dumps(head).encode(), np.uint8)}


def test_damaged_arrays_are_refused_in_one_line(aircraft: Problem) -> None:
    """Each array of the state shorter, longer, with another dimension, as text, and absent; those of another method."""
    whole, other = (saved(fit_by(method, *aircraft)) for method in ("output-error", "equation-error"))
    longer, text = (lambda x: np.concatenate([x, x[:1]])), (lambda x: x.astype("U3"))
    changes = (lambda x: x[:-1], longer, lambda x: x[None], text)
    mutated = ("z", "time.0", "inputs.0", "measured.0", "recorded.0", "covariance", "root")
    damaged = [whole | {name: change(whole[name])} for name in mutated for change in changes]
    damaged += [{k: x for k, x in whole.items() if k != name} for name in mutated]
    entries: list[dict[str, Any]] = [{"pieces": []}, {"ladder": []}, {"measured": ["nothing"]}]
    entries += [{"ladder": [rung]} for rung in ([], [0], [10**6], [1, 1], ["a"])]
    damaged += [changed(whole, **one) for one in entries]
    damaged += [whole | {"head": np.frombuffer(text, np.uint8)} for text in (b"[" * 100_000, b"{")]
    refused = r"^m\.npz: holds no estimate of output-error .*fit again$"
    for arrays in (*damaged, {}, other):
        with pytest.raises(IdentificationError, match=refused):
            methods.restore("output-error", arrays, "m.npz")


FREE_DIVERGING = ("Cmalpha", "Cmq", "Cmelevator")
MANEUVER_DIVERGING = maneuver(4.0, ("elevator", "3-2-1-1", 0.5, 0.3, 0.05))
STATUSES = {"converged", "stalled", "budget", "generations", "interrupted", "target"}
#: entry points of the compiled model, through which every trajectory of an estimator comes
ENTRIES = (
    (Kernel, "cost"), (Kernel, "trajectories"), (Kernel, "evaluate"), (filtering, "innovations"), (Kernel, "step"),
    (shooting_windows, "windows"), (trajectories, "innovations"),
)  # fmt: skip


@pytest.fixture(scope="module")
def problem() -> tuple[Vehicle, Flight]:
    vehicle = with_few_free(load_vehicle("twin-boom").reduced("longitudinal"), FREE_DIVERGING)
    return vehicle, simulate_flight(vehicle, MANEUVER_DIVERGING, seed=1, name="a")


def lost(found: Any) -> Any:
    return tuple(map(lost, found)) if isinstance(found, tuple) else np.full_like(found, np.nan)


class Diverging:
    """Counts the calls of the compiled model, and makes some of them diverge."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch, chosen: Callable[[int], bool]) -> None:
        self.calls = 0
        for owner, name in ENTRIES:
            monkeypatch.setattr(owner, name, self.wrapped(getattr(owner, name), chosen))

    def wrapped(self, entry: Callable[..., Any], chosen: Callable[[int], bool]) -> Callable[..., Any]:
        def run(*arguments: Any, **keywords: Any) -> Any:
            found = entry(*arguments, **keywords)
            self.calls += 1
            return lost(found) if chosen(self.calls - 1) else found

        return run


def fitted(method: str, vehicle: Vehicle, flight: Flight) -> Estimate:
    return fit_by(method, vehicle, {"a": flight}, [Window("a", 0.0, 4.0)], generations=6, budget=400.0)


def ends_as_a_value(method: str, vehicle: Vehicle, flight: Flight) -> None:
    try:
        found = fitted(method, vehicle, flight)
    except StoopError as error:
        assert "; " in str(error)  # noqa: PT017 - what is wrong, and what to do
    else:
        assert found.outcome.status in STATUSES
        assert np.isfinite(found.z).all()


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@pytest.mark.parametrize("method", methods.names())
def test_a_divergence_ends_no_fit_by_another_exception(method: str, problem: tuple[Vehicle, Flight]) -> None:
    """Of one trajectory, or of all from then on; at last of the starting values."""
    with pytest.MonkeyPatch.context() as clean:
        count = Diverging(clean, lambda call: False)
        fitted(method, *problem)
    places = {0, 1, count.calls // 3, count.calls // 2, count.calls - 2, count.calls - 1}
    for place, lasting in itertools.product(sorted(places), (False, True)):
        with pytest.MonkeyPatch.context() as patch:
            Diverging(patch, lambda call, at=place, on=lasting: call >= at if on else call == at)  # type: ignore[misc]
            ends_as_a_value(method, *problem)
    vehicle, flight = problem
    far = {"value": 60.0, "bounds": (-10.0, 80.0)}
    ends_as_a_value(method, vehicle.with_numbers({"Cmalpha": far}), flight)
