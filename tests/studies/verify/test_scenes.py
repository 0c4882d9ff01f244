import numpy as np
import pytest

from stoop.assessment.error_bars import ErrorBars
from stoop.estimate import methods
from stoop.estimate.fit import Options
from stoop_studies.verify import closed_loop
from stoop_studies.verify.defects import RIGHT, defects, fly, late, truth, turned, user_file
from stoop_studies.verify.scenes import Scene, aircraft, maneuvers, with_biases


def test_recorded_surfaces_follow_the_recorded_motion() -> None:
    rng, maneuver = np.random.default_rng(3), maneuvers()["roll"]
    vehicle = with_biases(aircraft(), rng)
    flight = closed_loop.fly(vehicle, maneuver, rng, "roll")
    fed = flight.column("aileron") - maneuver.deflections()["aileron"]
    law = sum(gain * flight.column(c) for c, gain in closed_loop.LAW["aileron"].items())
    np.testing.assert_allclose(np.diff(fed[1:]), np.diff(law[:-1]), atol=1e-12)


def test_a_file_is_wrong_in_one_thing() -> None:
    for name, defect in defects().items():
        a, b = ({n: q.value for n, q in v.quantities.items()} for v in (truth(name), user_file(name)))
        differing = {n for n in a.keys() | b.keys() if a.get(n) != b.get(n)}
        if name in RIGHT or defect.record is not None:
            assert not differing, name
        else:
            tables = {n.rpartition(".")[0] for n in differing}
            assert len(tables) == 1 or (tables and name in ("lag-all", "gusts")), name


def worst(scene: Scene, method: str) -> float:
    fitter = methods.find(method).fitter()
    fit = fitter(scene.start, scene.flights, scene.windows, Options(method=method), None, None)
    std = dict(zip(fit.estimates, ErrorBars.of(fit).std, strict=False))
    return float(max(abs(fit.estimates[n] - v) / std[n] for n, v in scene.truth.items()))


def test_flights_are_those_of_their_seed() -> None:
    once, again, other = fly("none", 1), fly("none", 1), fly("none", 2)
    for flight in once.flights:
        q, same, different = (s.flights[flight].column("q") for s in (once, again, other))
        assert np.array_equal(q, same)
        assert np.abs(q - different).max() > 0.05
    assert once.start.values.tolist() == again.start.values.tolist()


def test_instruments_deceive_as_said() -> None:
    flight = fly("none", 1).flights["first"]
    theta = late(("theta",), 0.06)(flight).column("theta")
    assert np.array_equal(theta[3:], flight.column("theta")[:-3])
    # Turned to the right about its z axis, a gyro reads the body's roll rate as p cos + q sin.
    body = turned(0.0, 0.0, 0.1)(flight)
    p, q = flight.column("p"), flight.column("q")
    assert body.column("p") == pytest.approx(p * np.cos(0.1) + q * np.sin(0.1), abs=1e-12)
    assert body.column("q") == pytest.approx(q * np.cos(0.1) - p * np.sin(0.1), abs=1e-12)
    assert np.array_equal(body.column("r"), flight.column("r"))


def test_a_defect_does_harm_and_the_right_file_none() -> None:
    assert worst(fly("none", 3), "output-error") < 4.0
    assert worst(fly("lag-aileron", 3), "output-error") > 8.0
