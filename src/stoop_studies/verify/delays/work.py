"""One flight: its delays are drawn, looked for and compared."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from stoop.assess.error_bars import error_bars
from stoop.estimate.fit import Options, fit
from stoop.reconstruct.result import check
from stoop_studies.verify.delays.scene import RATE, late_sensors, late_vehicle


def identified(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[dict[str, Any]]:
    """Look for the delays of controls and sensors in an identification; see `stoop.parallel.Run`."""
    seed = int(arguments["seed"])
    scene, options = late_vehicle(seed), Options(seed=seed)
    done = fit(scene.start, scene.flights, scene.windows, options)
    std = error_bars(done).std
    places = {p.name: i for i, p in enumerate(done.problem.layout.parameters)}
    found = {name: (done.estimates[name], float(std[places[name]])) for name in scene.truth}
    return [_compared(found, scene.truth, done.outcome.status) for _ in stops]


def checked(arguments: Mapping[str, Any], stops: Sequence[int | None]) -> list[dict[str, Any]]:
    """Look for the delays of sensors in a compatibility check; see `stoop.parallel.Run`."""
    flight, delays = late_sensors(int(arguments["seed"]))
    result, estimate = check(flight)
    truth = {f"{name}.delay": value for name, value in delays.items()}
    found = {name: (result.findings[name].estimate, result.findings[name].std_error) for name in truth}
    return [
        _compared(found, truth, "converged" if estimate.rested else "weights did not rest") for _ in stops
    ]


def _compared(
    found: Mapping[str, tuple[float, float]], truth: Mapping[str, float], status: str
) -> dict[str, Any]:
    """Return errors and standard errors in samples, by the order of ``names``."""
    return {
        "names": list(truth),
        "truth": [RATE * value for value in truth.values()],
        "errors": [RATE * (found[name][0] - value) for name, value in truth.items()],
        "sigma": [RATE * s if np.isfinite(s := found[name][1]) else None for name in truth],
        "status": status,
    }
