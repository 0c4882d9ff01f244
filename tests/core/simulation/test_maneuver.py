"""Maneuver files: their shapes, and one line for whatever cannot be flown."""

from pathlib import Path

import numpy as np
import pytest

from stoop.errors import ManeuverError
from stoop.simulation import maneuver
from stoop.simulation.maneuver import load_maneuver, parse_maneuver

WHERE = "folder/bad.toml"


def shape(**keys: object) -> str:
    lines = [f"{k} = {v!r}" for k, v in ({"control": "elevator"} | keys).items()]
    return "\n".join(["duration = 10.0", "[[input]]", *lines])


def of(control: str, amplitude: float, step: float = 0.5, **keys: object) -> str:
    return shape(control=control, shape="doublet", start=1.0, step=step, amplitude=amplitude, **keys)


def flown(text: str) -> np.ndarray:
    return parse_maneuver(text, "x").deflections()["elevator"]


def test_3211_has_its_steps_on_the_samples_they_name() -> None:
    y = flown(shape(shape="3-2-1-1", start=1.0, step=0.3, amplitude=0.2))
    expected = np.zeros(1001)
    for first, last, sign in ((100, 190, 1), (190, 250, -1), (250, 280, 1), (280, 310, -1)):
        expected[first:last] = 0.2 * sign
    assert np.array_equal(y, expected)


def test_steps_alternate_and_inputs_on_one_control_add() -> None:
    for name, units in (("doublet", (1, 1)), ("1-1", (1, 1)), ("2-1-1", (2, 1, 1))):
        y = flown(shape(shape=name, start=2.0, step=0.5, amplitude=-0.1))
        runs = np.split(y, np.flatnonzero(np.diff(y)) + 1)
        assert [len(r) for r in runs[1:-1]] == [50 * u for u in units]
        assert [r[0] for r in runs[1:-1]] == [-0.1 * (-1) ** i for i in range(len(units))]
    pulse = shape(shape="pulse", start=0.0, duration=3.0, amplitude=0.2)
    assert np.array_equal(flown(pulse), np.where(np.arange(1001) < 300, 0.2, 0.0))
    assert np.allclose(flown(f"{pulse}\n[[input]]\n" + pulse.split("[[input]]\n")[1]), 2 * flown(pulse))


def test_multisine_keeps_its_amplitude_band_and_low_peaks() -> None:
    y = flown(shape(shape="multisine", start=0.0, duration=10.0, amplitude=0.1, band=2.0))[:1000]
    assert np.abs(y).max() == pytest.approx(0.1, rel=1e-12)
    power = np.abs(np.fft.rfft(y)) ** 2
    assert power[1:21].min() > 0.99 * power[1:21].max(), "equal power up to 2 Hz"
    assert power[21:].max() < 1e-20 * power[1]
    assert np.abs(y).max() / np.sqrt(np.mean(y**2)) < 2.0, "low peak factor"
    text = shape(shape="multisine", start=0.0, duration=10.0, amplitude=0.1, band=2.0, first=1, stride=2)
    other = text.split("[[input]]")[1].replace("elevator", "rudder").replace("first = 1", "first = 2")
    both = parse_maneuver(f"{text}\n[[input]]{other}", "x").deflections()
    a, b = both["elevator"][:1000], both["rudder"][:1000]
    assert abs(a @ b) < 1e-12 * (a @ a), "those of one stride are orthogonal"


def test_harmonics_have_the_amplitudes_and_phases_they_are_given() -> None:
    given = {"harmonics": [2, 7], "amplitudes": [0.1, -0.03], "phases": [0.4, 1.0]}
    text = shape(shape="harmonics", start=0.0, duration=10.0, **given)
    spectrum = np.fft.rfft(flown(text)[:1000]) / 500.0
    assert np.allclose(spectrum[[2, 7]], [-0.1j * np.exp(0.4j), 0.03j * np.exp(1.0j)])
    spectrum[[2, 7]] = 0.0
    assert np.abs(spectrum).max() < 1e-14


def test_slew_bounds_the_rate_and_keeps_the_levels() -> None:
    y = flown(shape(shape="3-2-1-1", start=1.0, step=0.5, amplitude=0.1, slew=1.0))
    assert np.abs(np.diff(y)).max() <= 0.01 * (1.0 + 1e-9)
    levels = [0, 0.1, 0.1, -0.1, 0.1, -0.1, 0]
    assert y[[100, 110, 250, 350, 400, 450, 470]] == pytest.approx(levels, abs=1e-12)


def test_levels_are_held_one_after_the_other() -> None:
    row = {"levels": [0.1, -0.05, 0.0, 0.02], "lengths": [0.5, 0.3, 0.7, 0.5]}
    y = flown(shape(shape="levels", start=1.0, **row))
    runs = np.split(y, np.flatnonzero(np.diff(y)) + 1)
    assert [(len(run), run[0]) for run in runs[1:-1]] == [(50, 0.1), (30, -0.05), (70, 0.0), (50, 0.02)]
    assert (len(runs[0]), y[-1]) == (100, 0.0)
    slow = flown(shape(shape="levels", start=1.0, slew=0.6, **row))
    assert np.abs(np.diff(slow)).max() <= 0.006 * (1.0 + 1e-9)
    assert slow[[120, 149, 179, 200]] == pytest.approx([0.1, 0.1, -0.05, 0.0])


PULSE = {"shape": "pulse", "start": 1.0, "duration": 1.0, "amplitude": 0.1}
SINE = {"shape": "multisine", "start": 0.0, "duration": 5.0, "amplitude": 0.1, "band": 2.0}


def test_what_cannot_be_flown() -> None:
    for text, says in (
        ("", "duration: missing; add it"),
        ("duration = 0.0", "duration: it must be greater than 0"),
        ("duration = nan", "duration: it must be a finite number"),
        (f"duration = 1{'0' * 400}", "duration: an integer of more than 308 digits"),
        ("duration = 1e9", "duration: it must be less than or equal to 36000"),
        ("duration = 36000.0\nrate = 10000.0", "exceeds 5000000 samples; lower one of them"),
        ("duration = 0.001", "shorter than one sample"),
        ("duration = 9.0\nrate = 0.0", "rate: it must be greater than 0"),
        ("duration = 9.0\nairspeed = -3.0", "airspeed: it must be greater than 0"),
        ("duration = 9.0\naltitude = 40000.0", "altitude: it must be less than or equal to 11000"),
        ("duration = 9.0\nairsped = 3.0", "airsped: unknown key; remove it or correct its name (did you mean airspeed?)"),
        ("duration = 9.0\n[noise]\nq = -0.1", "noise.q: it must be greater than or equal to 0"),
        ("format = 'x'\nduration = 9.0", "format: it must be 'stoop-maneuver/1'"),
        ("duration = 9.0\n[[input]]\ncontrol = 'elevator'", "input.0: the key 'shape' is missing"),
        (shape(shape="sine"), "input.0: 'shape' is 'sine'; choose one of '3-2-1-1', 'doublet'"),
        (shape(**PULSE | {"amplitude": 11.46}), "input.0.amplitude: 11.46 looks like degrees; write radians (0.2), or"),
        (shape(shape="pulse", start=1.0, amplitude=0.1), "input.0.duration: missing"),
        (shape(**PULSE | {"start": -1.0}), "input.0.start: it must be greater than or equal to 0"),
        (shape(**PULSE, step=3.0), "input.0.step: unknown key; remove it or correct its name (known here: control, shape"),
        (shape(**SINE | {"band": 0.1}), "no harmonic of 1/5 s lies below 0.1 Hz"),
        (shape(**SINE | {"band": 80.0}), "above half the rate"),
        (shape(**SINE | {"duration": 1e6, "band": 40.0}), "more than 2000 harmonics"),
        (shape(**SINE | {"first": 0}), "input.0.first: it must be greater than or equal to 1"),
        (shape(shape="doublet", start=1.0, step=0.1, amplitude=0.1, slew=1.0), "a slew of 1 rad/s does not get"),
        (shape(shape="levels", start=1.0, levels=[0.1, 0.2], lengths=[1.0]), "differ in length"),
        (shape(shape="levels", start=1.0, levels=[0.1, -0.2], lengths=[1.0, 0.2], slew=1.0), "from 0.1 to -0.2 rad within 0.2 s"),
        (shape(shape="harmonics", start=0.0, duration=5.0, harmonics=[1, 2], amplitudes=[0.1], phases=[0.0]), "differ in length"),
        (shape(shape="harmonics", start=0.0, duration=5.0, harmonics=[400], amplitudes=[0], phases=[0]), "above half the rate"),
        (shape(shape="harmonics", start=0.0, duration=5.0, harmonics=[], amplitudes=[], phases=[]), "input.0.harmonics: "),
        ("duration", "not valid TOML"),
        ("duration = 9.0\nwind = [1.0, 2.0, 900.0]", "wind.2: it must be less than or equal to 200"),
        ("duration = 9.0\nvelocity = [1.0, 2.0, nan]", "velocity.2: it must be a finite number"),
        ("duration = 9.0\nvelocity = [0.0, 0.0, 0.0]\nairspeed = 10.0", "airspeed and velocity: one flies on wings"),
        ("duration = 9.0\nheading = 90.0", "heading: it must be less than or equal to 6.28"),
        ("duration = 9.0\n[battery]\nstart = 0.0", "battery.start: it must be greater than 0"),
        ("duration = 9.0\n[battery]\nfall = -1.0", "battery.fall: it must be greater than or equal to 0"),
        (of("heading", 90.0), "input.0.amplitude: 90 looks like degrees; write radians (1.571)"),
        (of("pitch", 1e9), "input.0.amplitude: 1e+09 is out of range; write it in rad/s2"),
        (of("yaw", 9.0, step=0.1, slew=1.0), "a slew of 1 rad/s2/s does not get from 0 to 9 rad/s2"),
    ):  # fmt: skip
        with pytest.raises(ManeuverError) as caught:
            parse_maneuver(text, WHERE)
        said = str(caught.value)
        assert said.startswith(f"{WHERE}: "), text[:80]
        assert says in said
        assert said.isprintable()


def test_files_that_are_none(tmp_path: Path) -> None:
    path = tmp_path / "m.toml"
    for content, says in ((bytes(range(256)), ".*check the path"), (None, "cannot read the maneuver file")):
        path.write_bytes(content) if content else path.unlink()
        with pytest.raises(ManeuverError, match=rf"m\.toml: {says}"):
            load_maneuver(path)


def test_units_follow_the_control() -> None:
    """Accelerations, speeds and channels may be larger than an angle; a surface and a heading are angles still."""
    for control, amplitude in (("roll", 40.0), ("north", -12.0), ("motor_1", 0.2), ("pwm_3", 150.0)):
        y = parse_maneuver(of(control, amplitude), WHERE).deflections()[control]
        assert np.abs(y).max() == abs(amplitude)
    assert (maneuver.unit_of("heave"), maneuver.unit_of("elevator")) == ("m/s2", "rad")
