"""A mapping is a file like any other: whatever stands in it, it is read, or refused in one line."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from stoop.errors import StoopError
from stoop.flight.apply_mapping import apply_mapping
from stoop.flight.mapping import flight_mapping
from stoop.logs import Recording, Stream

T = np.arange(300) * 0.02
STREAMS = {
    "a": Stream(T, {"x": np.sin(T), "y": np.full(300, np.inf), "z": np.full(300, np.nan), "t": T * 1e3}),
    "b/1": Stream(T + 5.0, {"x": 1e300 * np.cos(T), "y": 0.0 * T, "t": -T}),
}
SOME = st.sampled_from(["p", "q", "phi", "vn", "ve", "vd", "az", "pwm_1", "pwm_2"])


@settings(max_examples=80, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(SOME, min_size=1, max_size=3, unique=True), st.data())
def test_nearly_right(names: list[str], data: st.DataObject) -> None:
    columns = [data.draw(st.sampled_from(["x", "y", "z"])) for _ in names]
    group = {"variables": names, "stream": data.draw(st.sampled_from(["a", "b/1", ""])), "columns": columns}
    group |= data.draw(st.fixed_dictionaries({}, optional={
        "scale": st.sampled_from([1.0, -1e9, 1e-9]), "frame": st.sampled_from(["flu", "enu"]), "unused": st.just(0),
        "partial": st.booleans(), "stamp": st.sampled_from(["t", "x"]), "valid": st.just("y"), "instance": st.just("most moved"),
    }))  # fmt: skip
    content: dict[str, Any] = {"group": {"g": group}}
    if "pwm_1" in names:
        point = st.tuples(st.floats(-1e9, 1e9), st.floats(-2, 2)).map(list)
        degree = data.draw(st.fixed_dictionaries({}, optional={"degree": st.integers(0, 4)}))
        points = data.draw(st.lists(point, min_size=1, max_size=5))
        content["calibration"] = {"pwm_1": {"points": points, **degree}}
        content["surface"] = {"elevator": {"from": {"pwm_1": 1.0}}}
    content["align"] = data.draw(st.sampled_from([{}, {"b/1": {"with": "a", "drift": True}}]))
    with suppress(StoopError):
        apply_mapping(flight_mapping("m.toml", content), Recording(Path("log"), "mat", STREAMS))
