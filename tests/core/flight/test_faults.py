"""Suspected faults: each kind is found where it was put, and none where there is only noise."""

from dataclasses import replace

import numpy as np
import pytest

from stoop.base.arrays import FloatArray
from stoop.flight import from_columns
from stoop.flight.faults import at_rest, recorded_faults, rest_faults
from stoop.flight.gridding import Channels

SIZE = 2000
TIME = 0.01 * np.arange(SIZE)


def noise(seed: int, scale: float = 1.0) -> FloatArray:
    return scale * np.random.default_rng(seed).normal(size=SIZE)


def found(**values: FloatArray) -> list[tuple[str, str]]:
    return [(fault.kind, fault.variable) for fault in recorded_faults([Channels("x", TIME, values)])]


def test_what_is_no_fault() -> None:
    for seed in range(20):
        assert found(p=noise(seed), theta=np.cumsum(noise(seed + 1)) * 0.01, V=20.0 + noise(seed)) == []
    gap = np.where((TIME >= 5.0) & (TIME < 7.0), np.nan, noise(0))
    coarse = np.round(np.sin(TIME) * 20.0) / 20.0 + 1e-3 * (np.arange(SIZE) % 2)
    still = {"elevator": np.zeros(SIZE), "pwm_3": np.full(SIZE, 1500.0), "voltage": np.full(SIZE, 12.0)}
    assert found(p=gap, theta=coarse, **still) == []


def test_stuck_and_clipped() -> None:
    p = noise(0)
    p[500:700] = p[500]
    (fault,) = recorded_faults([Channels("x", TIME, {"p": p})])
    assert (fault.kind, fault.notice.code) == ("stuck", "constant-reading")
    assert (fault.start, fault.stop) == (5.0, 6.99)
    assert found(p=np.clip(noise(1), -1.5, 1.5)) == [("clipped", "p"), ("clipped", "p")]
    assert found(q=np.minimum(noise(1), 1.0)) == [("clipped", "q")]
    assert found(az=np.maximum(noise(1), -1.0)) == [("clipped", "az")]
    for x, side in ((np.minimum(noise(1), 1.0), 1.0), (np.maximum(noise(1), -1.0), -1.0)):
        faults = tuple(recorded_faults([Channels("x", TIME, {"p": x})]))
        blanked = replace(from_columns("f", TIME, {"p": x}), faults=faults).without_faults().column("p")
        assert np.isnan(blanked[x == side]).all()
        assert np.isnan(blanked).sum() <= np.sum(x == side) + 10  # and what is as good as there


def at_standstill(moving: slice, **offsets: float) -> dict[str, FloatArray]:
    names = ("vn", "ve", "vd", "p", "q", "r", "ax", "ay", "az", "airspeed_pitot")
    data = {name: noise(k, 1e-3) for k, name in enumerate(names)}
    data["az"] -= 9.81
    data["vn"][moving] = 15.0
    for name, offset in offsets.items():
        data[name] = data[name] + offset
    return data


def test_rest_is_slow_and_lasting() -> None:
    data = at_standstill(slice(800, 1500))
    data["q"][1600] = 1.0  # touched
    rest = at_rest(data, 100.0)
    assert rest[:800].all()
    assert not rest[800:1601].any()  # the second after it is too short
    assert rest[1601:].all()
    moving = slice(800, 1500)
    assert rest_faults(TIME, at_standstill(moving), 100.0) == []
    for name, offset, value in (("airspeed_pitot", -3.0, -3.0), ("q", 0.04, 0.04), ("az", 1.0, 8.81)):
        (fault,) = rest_faults(TIME, at_standstill(moving, **{name: offset}), 100.0)
        assert (fault.kind, fault.variable) == ("offset at rest", name)
        assert fault.value == pytest.approx(value, rel=0.02)
    (fault,) = rest_faults(TIME, at_standstill(moving, airspeed_pitot=4.0), 100.0)
    assert fault.notice.code == "pitot-at-rest"
    assert rest_faults(TIME, at_standstill(slice(0, SIZE), airspeed_pitot=-3.0), 100.0) == []  # always flying
    assert rest_faults(TIME, {"p": noise(0)}, 100.0) == []
