"""`--extend`: a missing lag is added if a held-back window confirms it, and a right model stays as it is."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from core.assessment.test_extensions import DURATION, STEPS, flights

import stoop
from stoop.errors import IdentificationError, VehicleError
from stoop.estimate.fit import Options
from stoop.problem.windows import Window
from stoop.results.extensions import ExtensionTest, ExtensionTests
from stoop.strategy import Strategy
from stoop.strategy import extensions as extension
from stoop.strategy.extensions import _freed
from stoop.strategy.run import setup_of
from stoop.vehicle import load_vehicle
from stoop.vehicle.document import with_entries
from stoop.vehicle.extensions import extended

LAG = 0.04


@pytest.mark.parametrize("held_back", [True, False])
def test_missing_lag_is_added(tmp_path: Path, held_back: bool) -> None:
    base = load_vehicle("twin-boom")
    truth = with_entries(base, {("controls", "aileron", "lag"): LAG})
    every = [*flights(truth, 5).values(), replace(flights(truth, 7)["roll"], name="again")]
    windows, again = [f"{name}@0:{DURATION}" for name in STEPS], [f"again@0:{DURATION}"]
    maneuvers, validate = (windows, again) if held_back else (windows + again, [])
    job = stoop.fit(base, every, maneuvers, validate, Options(seed=1), extend=True)
    kept = next(n for n in job.notices if n.code.startswith("extension"))
    assert kept.code == "extension-kept"
    assert kept.subject in ("controls.aileron.lag", "controls.aileron.delay")
    name = kept.subject
    assert job.parameters[name].estimate == pytest.approx(LAG, rel=0.1)
    assert not job.result.extensions.found
    assert name in {p.name for p in load_vehicle(job.save(tmp_path / "out") / "vehicle.toml").parameters}
    for key in ("Clp", "Claileron"):
        one = job.parameters[key]
        assert abs(one.estimate - truth.value(key)) < 4.0 * one.std_error


@pytest.mark.parametrize("impossible", [False, True])
def test_after_a_refusal_the_next_is_tried(monkeypatch: pytest.MonkeyPatch, impossible: bool) -> None:
    """Of two defects the stronger is refused while the other is not there yet; or its method refuses it: a filter needs
    delays that are known. Vehicles are the sets of extensions that they have.
    """
    each = (("one", 9.0), ("two", 6.0))
    tests = [ExtensionTest(n, "scale", 1.08, 0.01, "1", t, 0.0, 1.0, n, change=0.08) for n, t in each]

    def fitted(setup: object, vehicle: set[str]) -> SimpleNamespace:
        if impossible and "one" in vehicle:
            raise IdentificationError("delays of sensors must be known")
        fit, ahead = SimpleNamespace(names=vehicle, correlation_time=1.0), np.full(4, float(len(vehicle)))
        return SimpleNamespace(vehicle=vehicle, fit=fit, bars=None, prediction=ahead)

    def missing(fit: SimpleNamespace, bars: None) -> ExtensionTests:
        return ExtensionTests(10, 0.01, tuple(t for t in tests if t.name not in fit.names))

    rise = {"one": 1.0 if impossible else -1.0}
    for name, one in {
        "_fit": fitted, "extension_tests": missing, "catalogue": lambda vehicle: tests,
        "_freed": lambda vehicle, added, change: vehicle | {added.name},
        "penalized_rise": lambda _, after: rise.get("".join(after.names), 1.0), "log_likelihood_rise": lambda *fits: (1.0, 1.0),
    }.items():  # fmt: skip
        monkeypatch.setattr(extension, name, one)
    setup = setup_of(Strategy.default(), cast("Any", set()), {}, [], [Window("held", 0.0, 1.0)])
    wanted = {"two"} if impossible else {"one", "two"}
    refused = ["extension-refused"] * (1 if impossible else 2)
    for vehicle, codes in ((wanted, ["extension-kept"] * len(wanted)), (set(), refused)):
        found = extension.extend(setup)
        assert found is not None
        assert (found.setup.vehicle, [n.code for n in found.setup.notices]) == (vehicle, codes)
        monkeypatch.setattr(extension, "penalized_rise", lambda before, after: -1.0)


def test_a_change_to_an_impossible_body_begins_nearer_the_present_value() -> None:
    """The linear test of one moment of inertia overshoots to less than the others' difference."""
    vehicle = load_vehicle("quad-x")
    own = vehicle.value("mass.inertia.xx")
    (inertia,) = (one for one in extended(vehicle)[1] if one.name == "mass.inertia.xx")
    change = next(c for c in (-0.9 * own, -0.9) if 0.0 < inertia.value(c) < 0.2 * own)
    with pytest.raises(VehicleError, match="principal moment"):
        with_entries(vehicle, inertia.free_entries(change))
    (xx,) = (p for p in _freed(vehicle, inertia, change).parameters if p.name == "mass.inertia.xx")
    assert xx.free
    assert 0.2 * own < xx.value < own
