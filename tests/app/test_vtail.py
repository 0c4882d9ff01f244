"""From ``stoop app LOG`` to the first report of the V-tail, and what its notices suggest."""

import re
from pathlib import Path


def test_from_the_log_to_the_report(app, tab, shared_data: Path) -> None:
    running = app(str(shared_data / "altlnt-vtail-8kg-px4" / "flight2"))
    page = tab(running)
    page.wait("airspeed_pitot reads -2.97 m/s at rest")
    page.click("Next: the vehicle")
    page.fill("path of a vehicle file", str(Path(__file__).parents[2] / "examples" / "vtail.toml"))
    page.click("Use")
    page.wait("A fit estimates 48 free parameters of the vehicle, and 6 biases of sensors anew for each")
    page.click("Next: the windows")
    page.wait("held out, to be predicted")
    page.click("Run the fit")
    page.page.get_by_text(re.compile(r"cost .* · [1-9]\d* s")).wait_for()
    title = re.compile(r"48 free parameters and \d+ nuisances from 3 fitted maneuvers, 1 predicted")
    page.page.frame_locator("iframe").get_by_text(title).first.wait_for()
    assert page.clicks <= 8
    # What the notices name is fixed or freed by one click.
    page.page.get_by_text("What to do next").first.click()
    page.click("Clp")
    page.wait("Clp is fixed in vehicle.toml")
    page.click("CLaileron2")
    page.wait("CLaileron2 is free in vehicle.toml")
    text = (running.folder / "vehicle.toml").read_text("utf-8")
    assert 'CLaileron2 = {term = "aileron^2"' in text
    assert "free = false" in text
    assert "# 8.5 kg V-tail aeroplane" in text, "comments stay"
    commands = (running.folder / "commands.sh").read_text("utf-8").splitlines()
    assert [line.split()[1] for line in commands] == ["info", "vehicle", "maneuvers", "identify", "vehicle"]
