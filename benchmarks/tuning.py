"""Gains of an autopilot: margins over airspeeds and draws, and a proposal, in processor time of one core."""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import replace
from typing import Final

import numpy as np

from benchmarks.table import Row
from stoop.vehicle.builtin import builtin_vehicle
from stoop.vehicle.document import with_entries
from stoop_analysis.draws import Draws
from stoop_tune.control_laws.table import firmware_of
from stoop_tune.gain_search import DAMPING, Design, Specification, propose
from stoop_tune.tuning import conditions_of

PART = "tuning"
FLOWN: Final = {
    "FW_RR_P": 0.4, "FW_RR_I": 0.3, "FW_RR_FF": 0.3, "FW_R_TC": 0.4, "FW_PR_P": 0.8, "FW_PR_I": 0.6, "FW_PR_FF": 1.0,
    "FW_P_TC": 0.4, "FW_YR_P": 0.3, "FW_YR_I": 0.1, "FW_YR_FF": 0.0, "FW_AIRSPD_TRIM": 35.0, "FW_AIRSPD_MIN": 20.0,
    "FW_AIRSPD_MAX": 50.0,
}  # fmt: skip
THROW: Final = {"elevator": ("pitch", -0.35), "aileron": ("roll", 0.35), "rudder": ("yaw", -0.35)}
UNSURE: Final = ("Cmelevator", "Cmq", "Cmalpha", "Claileron", "Clp", "Cnrudder", "controls.elevator.lag")
SPREAD: Final = 0.05  #: standard deviation of each, share of it
AXES: Final = ("roll", "pitch", "yaw")


def run() -> list[Row]:
    """Judge and propose."""
    return list(_rows())


def _rows() -> Iterator[Row]:
    judged, _ = _timed(10, 2000)
    yield Row(
        PART, "margins of 3 axes, rate and attitude loop, 10 airspeeds, 2000 draws", judged, "s", at_most=10.0,
        note="linear models included; the second of two, compiled",
    )  # fmt: skip
    _, design = _timed(3, 1000)
    began = time.process_time()
    propose(replace(design, specification=DAMPING["MIL-F-9490D at VL"]))
    yield Row(PART, "gains proposed, 3 airspeeds, 1000 draws", time.process_time() - began, "s")


def _timed(airspeeds: int, draws: int) -> tuple[float, Design]:
    """Return the time of judging the gains that flew over airspeeds and draws, and the design."""
    entries = {("controls", s, "mix"): {f"control_{axis}": x} for s, (axis, x) in THROW.items()}
    entries |= {("controls", s, n): x for s in THROW for n, x in (("lag", 0.048), ("delay", 0.036))}
    vehicle, rng = with_entries(builtin_vehicle("twin-boom"), entries), np.random.default_rng(0)
    values = np.column_stack([vehicle.value(n) * (1.0 + SPREAD * rng.standard_normal(draws)) for n in UNSURE])
    drawn, firmware = Draws(UNSURE, values, "covariance"), firmware_of(FLOWN, rotors=False)
    speeds = np.linspace(25.0, 45.0, airspeeds).tolist()
    for _ in range(2):
        began = time.process_time()
        conditions = conditions_of(vehicle, firmware, FLOWN, speeds, 200.0, drawn)
        design = Design(firmware, FLOWN, AXES, conditions, Specification(), {})
        design.judged(FLOWN)
        taken = time.process_time() - began
    return taken, design
