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
LOG = Recording(
    Path("log"),
    "mat",
    {
        "a": Stream(T, {"x": np.sin(T), "y": np.full(300, np.inf), "z": np.full(300, np.nan), "t": T * 1e3}),
        "b/1": Stream(T + 5.0, {"x": 1e300 * np.cos(T), "y": 0.0 * T, "t": -T}),
    },
)
NAMES = """a b b/1 x y z t p q r az phi theta psi q{0..3} pwm_1 pwm_{1..16} rotor_{1..4} b/{0..3} x{0..2} deg rad/s m/s2 us
s ms 1 flu enu ned px4 ardupilot first fastest psi_dot turning v-tail elevon elevator {9..1} vn"""
WORDS = st.sampled_from([*NAMES.split(), "", "most moved"])
LEAVES = st.one_of(
    WORDS, st.integers(), st.floats(), st.booleans(), st.text(max_size=5), st.just(10**400), st.integers(1, 4)
)
LISTS = st.lists(st.one_of(LEAVES, st.lists(LEAVES, max_size=3)), max_size=5)
USED = """variables columns column unit scale offset valid stamp stamp_unit frame instance partial unused sources choose stream
file with using longest drift points degree from kind left right optional"""
KEYS = st.sampled_from(USED.split())
INNER = st.dictionaries(st.one_of(KEYS, WORDS), st.one_of(LEAVES, LISTS), max_size=6)
DEEP = st.dictionaries(KEYS, st.one_of(LEAVES, LISTS, st.lists(INNER, max_size=3)), max_size=7)
TABLES = st.dictionaries(WORDS, st.one_of(LEAVES, INNER, DEEP), max_size=3)
TOP = "time clock variables group calibration surface mixer align extends files"
MAPPINGS = st.dictionaries(st.sampled_from(TOP.split()), st.one_of(TABLES, INNER, LEAVES), max_size=5)


@settings(max_examples=300, deadline=None, suppress_health_check=list(HealthCheck))
@given(MAPPINGS)
def test_anything(content: dict[str, Any]) -> None:
    with suppress(StoopError):
        apply_mapping(flight_mapping("m.toml", content), LOG)


SOME = st.sampled_from(["p", "q", "phi", "vn", "ve", "vd", "az", "pwm_1", "pwm_2"])


@settings(max_examples=200, deadline=None, suppress_health_check=list(HealthCheck))
@given(st.lists(SOME, min_size=1, max_size=3, unique=True), st.data())
def test_nearly_right(names: list[str], data: st.DataObject) -> None:
    columns = [data.draw(st.sampled_from(["x", "y", "z"])) for _ in names]
    group = {"variables": names, "stream": data.draw(st.sampled_from(["a", "b/1", ""])), "columns": columns}
    group |= data.draw(st.fixed_dictionaries({}, optional={
        "scale": st.sampled_from([1.0, -1e9, 1e-9]), "frame": st.sampled_from(["flu", "enu"]), "unused": st.just(0),
        "partial": st.booleans(), "stamp": st.sampled_from(["t", "x"]), "valid": st.just("y"), "instance": st.just("most moved"),
    }))  # fmt: skip
    points = [
        [data.draw(st.floats(-1e9, 1e9)), data.draw(st.floats(-2, 2))]
        for _ in range(data.draw(st.integers(1, 5)))
    ]
    content: dict[str, Any] = {"group": {"g": group}}
    if "pwm_1" in names:
        degree = data.draw(st.fixed_dictionaries({}, optional={"degree": st.integers(0, 4)}))
        content["calibration"] = {"pwm_1": {"points": points, **degree}}
        content["surface"] = {"elevator": {"from": {"pwm_1": 1.0}}}
    content["align"] = data.draw(st.sampled_from([{}, {"b/1": {"with": "a", "drift": True}}]))
    with suppress(StoopError):
        apply_mapping(flight_mapping("m.toml", content), LOG)
