"""A fleet of two real quadrotors, from their logs: shares of the rotors, what was read before, what is broken."""

from pathlib import Path

import pandas as pd
import pytest

from stoop.cli.main import main

VEHICLE = Path(__file__).parents[2] / "examples" / "crazyflie.toml"
NAMES = (
    *(f"normal_flight__E8_log0{i}" for i in range(3)), *(f"normal_flight__E9_log0{i}" for i in range(5)),
    *(f"cut_propeller_M3_2mm_2mm_43mm__E8_log0{i}" for i in (3, 5, 6)),
    *(f"cut_propeller_M3_{cut}__E8_log0{i}" for cut in ("3mm_3mm_41mm", "4mm_4mm_39mm") for i in range(3)),
)  # fmt: skip


def test_the_cut_propeller_of_a_real_quadrotor_is_a_change(shared_data, tmp_path, capsys):
    """A day each, healthy flights first."""
    logs = [str(shared_data / "crazypad-propeller-damage" / f"{name}.usd") for name in NAMES]
    rows = [(name, name.partition("__")[2][:2], f"2026-01-{i:02}") for i, name in enumerate(NAMES, start=1)]
    pd.DataFrame(rows, columns=["flight", "vehicle", "time"]).to_csv(tmp_path / "flights.csv", index=False)
    table = ["--flights", str(tmp_path / "flights.csv"), "--vehicle", str(VEHICLE)]
    assert main(["fleet", *logs, *table, "-o", str(tmp_path / "store"), "--workers", "1"]) == 3
    head, *told = capsys.readouterr().out.splitlines()
    assert head == "2 vehicles, 17 flights, 7 figures; 1 false alarms a year"
    (alarm,) = [line for line in told if line.startswith("E")]
    assert alarm.startswith("E8 share.M3: drift of 0.0"), "it was cut shorter and shorter"
    first = "cut_propeller_M3_2mm_2mm_43mm__E8_log03"
    assert f"found in {first}: " in alarm, "the first flight after the first cut"
    figures = pd.read_parquet(tmp_path / "store" / "figures" / "logs.parquet").set_index(["flight", "figure"])
    share = figures.value.unstack()[[f"share.M{i}" for i in (1, 2, 3, 4)]]
    assert share.mean(axis=1).to_numpy() == pytest.approx(1.0, abs=1e-9)
    conditions = ("normal_flight__E8", "43mm", "41mm", "39mm")
    means = [share["share.M3"].filter(like=name).mean() for name in conditions]
    assert means == sorted(means), "the shorter the propeller, the more is asked of it (SOURCE.md)"
    assert means[-1] > 1.15 * means[0]
