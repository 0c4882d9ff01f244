"""Colors of curves and areas by what they show, in light and in dark.

Pictures are drawn in the light color of a role. Each of these is used for one role only, so that a page puts the style
sheet's variable in its place, and the script of interactive plots the dark color.
"""

from __future__ import annotations

import re
from typing import Final

# fmt: off
COLORS: Final[dict[str, tuple[str, str]]] = {
    "measured": ("#9aa3b1", "#7f8a9b"),
    "fit": ("#1d4ed8", "#7aa2ff"),
    "validation": ("#0f766e", "#3fc2b3"),
    "lag": ("#c2410c", "#f08a55"),
    "residual": ("#6b7280", "#a5aebc"),
    "input": ("#374151", "#c3cad6"),
    "band-fit": ("#dbe4fb", "#22345f"),
    "band-lag": ("#f7e0d4", "#4a2c1a"),
    "band-half": ("#b4c6f6", "#30498a"),
    "band-validation": ("#cfe8e4", "#1d4640"),
    "hue0": ("#1d4ed9", "#7aa2fe"), "hue1": ("#d9480f", "#ff8f5a"), "hue2": ("#0f766f", "#3fc2b4"),
    "hue3": ("#9333ea", "#c08bff"), "hue4": ("#be123c", "#ff7d9b"), "hue5": ("#4d7c0f", "#a3cf5b"),
    "hue6": ("#7c4a1e", "#d0a176"), "hue7": ("#475569", "#a9b6c8"),
    "fitted": ("#e2e8fa", "#26345c"), "fitted-edge": ("#8ea6ec", "#6f8bd9"),
    "predicted": ("#f9e2d9", "#50301f"), "predicted-edge": ("#eca487", "#c98163"),
    "declined": ("#eef0f2", "#2a2f38"), "declined-edge": ("#8b95a3", "#7c8797"),
    "fault": ("#fbe0e3", "#4d222a"), "fault-edge": ("#e08a95", "#c06a78"),
    "hole": ("#eceef1", "#262b34"),
    "grid": ("#e9ebef", "#2c323c"), "zero": ("#c9ced6", "#4a5361"),
    "ink": ("#111828", "#e7eaf0"), "tick": ("#55606e", "#a9b2c0"), "paper": ("#fffffe", "#14171d"),
}  #: role -> color on light and on dark paper
# fmt: on
_ROLES: Final = {light: role for role, (light, _) in COLORS.items()}
_HEX: Final = re.compile("|".join(_ROLES))


def light(role: str) -> str:
    """Return the color in which a role is drawn."""
    return COLORS[role][0]


def variables(dark: bool) -> str:
    """Return the style sheet's variables, ``--fit`` and so on."""
    return " ".join(f"--{role}: {pair[dark]};" for role, pair in COLORS.items())


def as_variables(svg: str) -> str:
    """Return a picture whose colors are the style sheet's variables."""
    return _HEX.sub(lambda found: f"var(--{_ROLES[found.group()]})", svg)
