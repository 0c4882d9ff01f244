"""Scores of open-loop predictions: by hand, for a straight path, and for a linear system that ARX must find."""

import numpy as np

from stoop.base.variables import POSITION
from stoop.problem import Piece
from stoop.vehicle import Vehicle, parse_vehicle
from stoop.vehicle.builtin import load_vehicle
from stoop_studies.open_loop import ARX, LINE, channels_of, open_loop_scores, score

VEHICLE: Vehicle = parse_vehicle(load_vehicle("twin-boom").text + "\n[sensors.pn]\n", "twin-boom")
COUNT, DT = 400, 0.02


def piece(columns: dict[str, np.ndarray], inputs: np.ndarray, start: dict[str, float]) -> Piece:
    measured = np.full((len(inputs), len(VEHICLE.outputs)), np.nan)
    for name, x in columns.items():
        measured[:, VEHICLE.outputs.index(name)] = x
    return Piece(0, np.arange(len(inputs)) * DT, inputs, measured, start, {})


def test_a_score_is_the_mean_of_rms_errors_over_ranges() -> None:
    measured = np.column_stack([np.linspace(0.0, 2.0, 5), np.array([0.0, 1.0, 0.0, 1.0, 0.0])])
    assert score(measured, measured + np.array([0.5, -0.1])) == np.mean([0.25, 0.1])
    assert score(measured, np.full_like(measured, np.nan)) == np.inf
    still = np.column_stack([measured[:, 0], np.ones(5)])  # what does not move has no range
    assert score(still, still + np.array([0.5, 3.0])) == 0.25
    time = np.arange(COUNT) * DT
    start = {"V": 20.0, "alpha": 0.1, "beta": 0.0, "phi": 0.0, "theta": 0.1, "psi": 0.5}
    place = {"pn": 20.0 * np.cos(0.5) * time, "pe": 3.0 + 20.0 * np.sin(0.5) * time, "pd": -7.0 + 0.0 * time}
    flown = piece(place, np.zeros((COUNT, len(VEHICLE.inputs))), start)
    assert set(channels_of(VEHICLE, [flown])) == {*POSITION}
    (scores,) = open_loop_scores(VEHICLE, [flown], {}, [])
    assert scores[LINE] < 1e-12
    assert ARX not in scores


def test_an_autoregression_finds_a_linear_system() -> None:
    rng = np.random.default_rng(8)

    def flight() -> Piece:
        u = np.repeat(rng.standard_normal((COUNT // 20, len(VEHICLE.inputs))), 20, axis=0)
        q, psi = np.zeros(COUNT), np.zeros(COUNT)
        for k in range(1, COUNT):
            q[k] = 0.9 * q[k - 1] - 0.1 * psi[k - 1] + 0.05 * u[k - 1, 0]
            psi[k] = psi[k - 1] + DT * q[k - 1]
        return piece({"q": q, "psi": psi}, u, {"V": 20.0})

    predicted = flight()
    psi = np.arange(len(VEHICLE.outputs)) == VEHICLE.outputs.index("psi")
    readings = {n: [predicted.measured + n * np.pi * psi] for n in (0, 1, 2)}
    (scores,) = open_loop_scores(VEHICLE, [predicted], readings, [flight(), flight()])
    assert max(scores[0], scores[2]) < 1e-9, "whole turns are none"
    assert scores[1] > 0.1
    assert scores[ARX] < 1e-6
    assert scores[LINE] > 0.2
