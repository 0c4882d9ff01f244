"""What the page says of maneuvers on rotors is what the code does."""

from __future__ import annotations

import re

from docs.pages import DOCS, table
from stoop.simulation import autopilot, maneuver, rotors

PAGE = DOCS / "maneuver-file.md"


def test_inputs_on_rotors() -> None:
    """Every name has a row, and its unit."""
    rows = table(PAGE, "On rotors", "control").rows
    quoted = {name: row[2] for row in rows for name in re.findall(r"`([a-z_0-9]+)`", row[0])}
    told = quoted | {row[0]: row[2] for row in rows if row[0].isidentifier()}
    assert told.pop("motor_1") == "the channel's"
    assert told == rotors.EXCITATIONS | rotors.SETPOINTS


def test_keys_of_a_battery() -> None:
    page = table(PAGE, "[battery]", "key")
    fields = maneuver.Battery.model_fields
    assert set(page.column("key")) == set(fields)
    for key, said in zip(page.column("key"), page.column("default"), strict=True):
        assert said == ("nominal" if fields[key].default is None else str(fields[key].default))


def test_how_fast_set_points_are_followed() -> None:
    level, _, vertical, turning = autopilot.RATE_LIMITS.tolist()
    text = PAGE.read_text(encoding="utf-8")
    assert f"no more than {level:g} m/s2 ({vertical:g} m/s2 up and down) and {turning:g} rad/s" in text
