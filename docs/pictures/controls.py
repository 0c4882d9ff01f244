"""Deflections of control surfaces, which way they are positive, and the moments that they then make."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pictures.registry import picture
from pictures.sketch import (
    INK,
    ORANGE,
    PALE_ORANGE,
    PAPER,
    RED,
    SOFT,
    TEAL,
    Point,
    Sketch,
    airfoil,
    panels,
    placed,
    rear_view,
    rounded,
    side_view,
    sketch,
    top_view,
)  # fmt: skip

HINGE = 0.7  #: of the chord, from the leading edge


def section(
    drawing: Sketch, at: Point, chord: float, deflection: float, text: str = "", turn: float = 0.0
) -> None:
    """Draw a profile, its nose to the right at a place, with its flap deflected, degrees, trailing edge down positive."""
    outline = airfoil(chord, 0.13, 60)
    hinge = np.array([-HINGE * chord, 0.0])
    front, rear = outline[outline[:, 0] >= hinge[0]], outline[outline[:, 0] <= hinge[0]]
    drawing.shape(front, at=at, turn=turn)
    moved = placed(rear - hinge, turn=deflection) + hinge
    drawing.shape(moved, PALE_ORANGE, ORANGE, at=at, turn=turn, above=2.2)
    place = tuple(placed([hinge], at, turn)[0])
    drawing.dot(place, ORANGE, 0.09)
    reach = (1.0 - HINGE) * chord
    tail = placed([hinge - (1.45 * reach, 0.0)], at, turn)[0]
    drawing.line([place, tuple(tail)], SOFT, 0.9)
    if deflection:
        angle = 180.0 + turn
        drawing.arc(place, 1.3 * reach, angle, angle + deflection, color=ORANGE, width=1.5)
    if text:
        middle = placed([hinge - (1.85 * reach, 0.9 * reach * np.sign(deflection))], at, turn)[0]
        drawing.text(tuple(middle), text, ORANGE)


@picture("deflection-elevator")
def elevator() -> Figure:
    """An airplane from the right with the trailing edge of its elevator down, a positive deflection.

    The lift of the tail grows, the nose goes down, and Cmelevator is negative.
    """
    figure, drawing = sketch((-9.0, 6.4), (-2.6, 3.6))
    side_view(drawing)
    section(drawing, (-3.9, 0.36), 3.0, 24.0, r"$\delta_e > 0$")
    drawing.arrow((-4.0, 0.6), (-4.0, 2.9), color=TEAL, width=2.2)
    drawing.text((-3.75, 2.95), "lift of the tail", TEAL, ha="left")
    drawing.arc((0.0, 0.0), 5.3, 12.0, -20.0, color=RED, width=2.2)
    drawing.text((4.3, 2.6), "nose down:\n$C_{m\\delta_e} < 0$", RED)
    drawing.center_of_gravity((0.0, 0.0))
    return figure


@picture("deflection-aileron")
def aileron() -> Figure:
    """An airplane from behind with the trailing edge of the right aileron up and of the left one down, a positive deflection.

    The right wing goes down, and Claileron is positive.
    """
    figure, drawing = sketch((-7.6, 7.6), (-3.0, 3.6))
    rear_view(drawing)
    for side, sign in ((1.0, 1.0), (-1.0, -1.0)):
        low, high = (0.3, 0.85) if sign > 0 else (-0.4, 0.2)
        drawing.shape(
            [(3.4 * side, low), (5.3 * side, low + 0.14), (5.3 * side, high + 0.14), (3.4 * side, high)], PALE_ORANGE, ORANGE,
            above=2.2,
        )  # fmt: skip
        start, end = ((5.0, -0.1), (5.0, -2.3)) if sign > 0 else ((-5.0, 0.65), (-5.0, 2.7))
        drawing.arrow(start, end, color=TEAL, width=2.2)
    drawing.text((4.35, 1.5), "trailing edge up", ORANGE)
    drawing.text((-4.3, -0.95), "trailing edge down", ORANGE)
    drawing.text((-4.7, 2.75), "more lift", TEAL, ha="left")
    drawing.text((4.7, -2.35), "less lift", TEAL, ha="right")
    drawing.arc((0.0, 0.1), 2.7, 62.0, 8.0, color=RED, width=2.2)
    drawing.text((1.7, 2.9), r"right wing down:  $C_{l\delta_a} > 0$", RED, ha="left")
    drawing.text((-7.4, -2.6), r"$\delta_a > 0$,  from behind", ORANGE, ha="left")
    return figure


@picture("deflection-rudder")
def rudder() -> Figure:
    """An airplane from above with the trailing edge of its rudder to the left, a positive deflection.

    The force on the fin points to the right, the nose goes left, Cnrudder is negative and CQrudder
    positive.
    """
    figure, drawing = sketch((-7.4, 7.4), (-7.6, 5.8), width=5.2)
    top_view(drawing)
    drawing.shape(
        rounded([(0.0, -4.3), (0.09, -4.8), (0.08, -5.8), (-0.08, -5.8), (-0.09, -4.8)], 2), PAPER, above=3.0
    )
    blade = placed([(-0.08, 0.0), (0.08, 0.0), (0.0, -1.5)], (0.0, -5.8), -28.0)
    drawing.shape(blade, PALE_ORANGE, ORANGE, above=3.1)
    drawing.line([(0.0, -5.8), (0.0, -7.5)], SOFT, 0.9)
    drawing.arc((0.0, -5.8), 1.2, 270.0, 242.0, color=ORANGE, width=1.5)
    drawing.text((-1.75, -7.0), r"$\delta_r > 0$", ORANGE)
    drawing.arrow((0.15, -5.6), (3.0, -5.6), color=TEAL, width=2.2)
    drawing.text((7.2, -6.6), "force to the right:\n$C_{Q\\delta_r} > 0$", TEAL, ha="right")
    drawing.arc((0.0, 0.0), 5.0, 80.0, 108.0, color=RED, width=2.2)
    drawing.text((-7.2, 4.7), "nose left:\n$C_{n\\delta_r} < 0$", RED, ha="left")
    drawing.center_of_gravity((0.0, 0.3))
    return figure


@picture("deflection-flaps")
def flaps() -> Figure:
    """Left, from behind: both flaps with their trailing edges down, a positive deflection, more lift on both wings.

    Right, a section: the angle of the flap is measured from its neutral position, trailing edge down
    positive.
    """
    figure, (left, right) = panels(2, (-6.6, 6.6), (-2.6, 3.2))
    rear_view(left)
    for side in (1.0, -1.0):
        left.shape(
            [(0.9 * side, -0.6), (3.0 * side, -0.45), (3.0 * side, 0.1), (0.9 * side, 0.0)],
            PALE_ORANGE,
            ORANGE,
            above=2.2,
        )
        left.arrow((2.0 * side, 0.35), (2.0 * side, 2.5), color=TEAL, width=2.0)
    left.text((0.0, 2.85), "more lift on both wings", TEAL)
    left.text((0.0, -1.6), r"both trailing edges down:  $\delta_f > 0$", ORANGE)
    section(right, (5.6, 0.6), 9.0, 26.0)
    right.text((-5.5, -1.3), r"$\delta_f > 0$", ORANGE)
    right.text((2.6, 0.6), "fixed", SOFT)
    return figure


@picture("deflection-ruddervators")
def ruddervators() -> Figure:
    """Two drawings of a V-tail from behind.

    Both ruddervators with trailing edges down are a positive elevator, nose down. The left one down and
    the right one up are a positive rudder, nose left.
    """
    figure, drawings = panels(2, (-4.4, 4.4), (-3.0, 3.4))
    panel = np.array([(0.35, -0.07), (3.4, -0.07), (3.4, 0.07), (0.35, 0.07)])
    for drawing, right_down, title, motion in (
        (
            drawings[0],
            True,
            r"elevator:  $\delta_e = \frac{1}{2}(\delta_{left} + \delta_{right}) > 0$",
            "nose down",
        ),
        (
            drawings[1],
            False,
            r"rudder:  $\delta_r = \frac{1}{2}(\delta_{left} - \delta_{right}) > 0$",
            "nose left",
        ),
    ):
        for turn, down, name in ((38.0, right_down, "right"), (142.0, True, "left")):
            drawing.shape(panel, turn=turn)
            normal = -1.0 if name == "right" else 1.0  # of the surface's upper side, in its own turned axes
            side = normal if down else -normal
            low, high = sorted((0.07 * side, 0.62 * side))
            drawing.shape(
                [(0.8, low), (3.3, low), (3.3, high), (0.8, high)], PALE_ORANGE, ORANGE, turn=turn, above=1.9
            )
            start, end = placed([(2.1, -side * 0.25), (2.1, -side * 1.5)], turn=turn)
            drawing.arrow(tuple(start), tuple(end), color=TEAL, width=2.0)
        drawing.ellipse((0.0, 0.0), 0.9, 0.9)
        drawing.text((0.0, -1.55), title, ORANGE)
        drawing.text((0.0, -2.5), motion, RED)
    drawings[0].text((0.0, 3.1), "both trailing edges down", INK)
    drawings[1].text((0.0, 3.1), "left down, right up", INK)
    return figure
