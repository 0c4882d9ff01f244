"""`stoop simulate`: flies from trim, with the vehicle's noise, and tells what to do next."""

from __future__ import annotations

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from stoop.cli.main import main, parser_for
from stoop.cli.options import with_free
from stoop.flight import Flight, load
from stoop.vehicle import load_vehicle

TWIN_BOOM = Path(__file__).parents[3] / "src" / "stoop" / "data" / "twin_boom.toml"


def fly(examples: Path, target: Path, *words: str, maneuver: str = "maneuver_3211.toml") -> Flight:
    arguments = ["simulate", "twin-boom", "--maneuver", str(examples / maneuver), "-o", str(target), *words]
    assert main(arguments) == 0
    return load(target)


def test_flies_the_paper_maneuver(examples: Path, tmp_path: Path) -> None:
    """3-2-1-1 of 0.3 s and 11.46 deg from 1 s, then a pulse of 3 s."""
    flight = fly(examples, tmp_path / "a.nc", "--no-noise")
    t, elevator = flight.time, np.degrees(flight.column("elevator"))
    assert t[[0, -1]] == pytest.approx([0.0, 30.0])
    move = elevator - elevator[0]
    for start, stop, sign in ((1.0, 1.9, 1.0), (1.9, 2.5, -1.0), (2.5, 2.8, 1.0), (2.8, 3.1, -1.0)):
        inside = (t > start + 0.005) & (t < stop - 0.005)
        assert move[inside] == pytest.approx(sign * 11.46, abs=0.01)
    assert np.all(np.abs(move[(t > 3.105) & (t < 6.995)]) < 1e-12)
    held = np.abs(move) > 1e-9
    assert np.count_nonzero(held & (t > 5.0)) == 300
    alpha = np.degrees(flight.column("alpha"))
    assert alpha[t < 1.0] == pytest.approx(5.88, abs=0.005)
    assert 1.7 < alpha.min() < alpha.max() < 10.3  # the paper's Fig. 3 stays within 1.8 and 10.2 deg


def test_noise_is_the_vehicle_files_and_the_seeds(examples: Path, tmp_path: Path) -> None:
    clean = fly(examples, tmp_path / "clean.nc", "--no-noise")
    first = fly(examples, tmp_path / "a.nc", "--seed", "3")
    again = fly(examples, tmp_path / "b.nc", "--seed", "3")
    other = fly(examples, tmp_path / "c.nc", "--seed", "4")
    for channel, sigma in (("V", 0.3), ("alpha", 0.005), ("q", 0.01), ("az", 0.1)):
        error = first.column(channel) - clean.column(channel)
        assert np.std(error) == pytest.approx(sigma, rel=0.1)
        np.testing.assert_array_equal(first.column(channel), again.column(channel))
        assert np.any(first.column(channel) != other.column(channel))


def test_tells_what_it_wrote_and_what_to_do_next(
    examples: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "a flight's log.nc"
    fly(examples, target, maneuver="maneuver_lateral.toml")
    wrote, after = capsys.readouterr().out.splitlines()
    summary = r": 20 s at 100 Hz, \d+ channels, sensor noise of seed 0"
    assert re.fullmatch(re.escape(f"wrote {target}") + summary, wrote)
    start, *words = shlex.split(after)
    assert start == "next:"
    parsed = parser_for(words[1:]).parse_args(words[1:])
    assert parsed.flight == [target]
    assert main(["info", str(target)]) == 0  # one window finder serves all verbs
    (line,) = (line for line in capsys.readouterr().out.splitlines() if line.startswith("next: "))
    informed = parser_for(words[1:]).parse_args(shlex.split(line)[2:])
    assert (parsed.maneuver, parsed.validate) == (informed.maneuver, informed.validate)
    assert [float(w.split(":")[0]) for w in parsed.maneuver] == pytest.approx([0.5, 9.5], abs=0.11)


@pytest.mark.parametrize(
    ("thrust", "free", "first"),
    [
        ("220.87", [], False),
        ("{ value = 200.0, bounds = [100.0, 400.0] }", ["propulsion.thrust"], False),
        ("{ value = 200.0, bounds = [100.0, 400.0], free = true }", [], False),
        ("{ value = 200.0, bounds = [100.0, 210.0] }", [], True),
        ("200.0", ["propulsion.thrust"], False),
    ],
)
def test_a_thrust_that_the_trim_set_is_fitted_or_to_be_written(
    thrust: str,
    free: list[str],
    first: bool,
    examples: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    text = TWIN_BOOM.read_text().replace("thrust = { value = 220.87, free = false }", f"thrust = {thrust}")
    file, target = tmp_path / "v.toml", tmp_path / "a.nc"
    file.write_text(text)
    maneuver = str(examples / "maneuver_3211.toml")
    assert main(["simulate", str(file), "--maneuver", maneuver, "-o", str(target)]) == 0
    *said, after = capsys.readouterr().out.splitlines()
    words = shlex.split(after)[2:]
    parsed = parser_for(words).parse_args(words)
    assert parsed.free == free
    with_free(load_vehicle(file), parsed.free, parsed.fix)  # would refuse a number without bounds
    told = [line for line in said if line.startswith("first: write thrust = 220.8")]
    assert len(told) == first


def test_does_not_write_over_a_file_unasked(
    examples: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "a.nc"
    target.write_text("precious")
    words = ["simulate", "twin-boom", "--maneuver", str(examples / "maneuver_3211.toml"), "-o", str(target)]
    assert main(words) == 2
    assert "add --overwrite" in capsys.readouterr().err
    assert target.read_text() == "precious"
    assert main([*words, "--overwrite"]) == 0
    assert load(target).rate == 100.0


def test_input_that_a_flight_cannot_hold_is_refused(
    examples: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    text = (examples / "vtail.toml").read_text().replace("control_pitch", "my_servo")
    vehicle = tmp_path / "v.toml"
    vehicle.write_text(text)
    maneuver = str(examples / "maneuver_3211.toml")
    assert main(["simulate", str(vehicle), "--maneuver", maneuver, "-o", str(tmp_path / "a.nc")]) == 2
    err = capsys.readouterr().err
    assert "v.toml: the input 'my_servo' is no variable of stoop" in err
    assert sorted(p.name for p in tmp_path.iterdir()) == ["v.toml"]


def test_a_quadrotor_hovers_and_is_to_be_identified(
    examples: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    target = tmp_path / "quad.nc"
    words = ["simulate", "quad-x", "--maneuver", str(examples / "maneuver_quad.toml"), "-o", str(target)]
    assert main(words) == 0
    wrote, after = capsys.readouterr().out.splitlines()
    assert wrote == f"wrote {target}: 60 s at 100 Hz, 24 channels, sensor noise of seed 0"
    assert "--vehicle quad-x --maneuver 0.4:3.1 4.4:7.1 19.5:37.0 --validate 8.4:12.7 -o quad-result" in after
    flight = load(target)
    assert {"vn", "ve", "vd", "pn", "pe", "pd", "motor_1", "motor_4"} <= set(flight.data.data_vars)


def test_a_flight_without_inputs_is_not_to_be_identified(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file, target = tmp_path / "hover.toml", tmp_path / "hover.nc"
    file.write_text('format = "stoop-maneuver/1"\nduration = 5.0\n')
    assert main(["simulate", "quad-x", "--maneuver", str(file), "-o", str(target)]) == 0
    *_, why, after = capsys.readouterr().out.splitlines()
    assert why == f"no input moves the vehicle: to identify it, add [[input]] tables to {file}"
    assert after == f"next: stoop info {target}"
