"""What is measured on the ground: dimensions of wing and tail, moments of inertia, the propeller; and how the ground acts."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pictures.registry import picture
from pictures.sketch import (
    BLUE,
    GREEN,
    INK,
    ORANGE,
    PALE_ORANGE,
    RED,
    SOFT,
    VIOLET,
    panels,
    plots,
    side_view,
    sketch,
)  # fmt: skip


@picture("planform")
def planform() -> Figure:
    """A wing from above, and from behind.

    A wing from above with its span over both halves, root and tip chord, whose ratio is the taper, the
    sweep of the quarter chord, tip aft positive, and an aileron between two shares of the half span; from
    behind its dihedral, tips up positive.
    """
    figure, drawing = sketch((-8.4, 8.8), (-5.6, 4.6))
    root, tip, half, back = 2.6, 1.5, 7.0, 1.3
    right = np.array([(0.0, 1.2), (half, 1.2 - back), (half, 1.2 - back - tip), (0.0, 1.2 - root)])
    for side in (1.0, -1.0):
        drawing.shape(right * (side, 1.0))
    quarter = [(0.0, 1.2 - 0.25 * root), (half, 1.2 - back - 0.25 * tip)]
    drawing.line([(float(x), float(y)) for x, y in quarter], RED, 1.2)
    drawing.line([(0.0, 0.55), (4.6, 0.55)], SOFT, 0.9)
    slope = float(np.degrees(np.arctan2(quarter[1][1] - quarter[0][1], half)))
    drawing.arc((0.0, 0.55), 4.2, 0.0, slope, color=RED, width=1.5)
    drawing.text((4.9, 1.1), "sweep", RED)
    inner, outer, share = 0.55, 0.95, 0.28
    flap = []
    for s in (inner, outer):
        lead, chord = 1.2 - back * s, root + (tip - root) * s
        flap.append([(half * s, lead - (1.0 - share) * chord), (half * s, lead - chord)])
    drawing.shape([flap[0][0], flap[1][0], flap[1][1], flap[0][1]], PALE_ORANGE, ORANGE)
    drawing.text((half * 0.76, -2.25), "aileron, 0.55 to 0.95\nof the half span", ORANGE, fontsize=9.0)
    drawing.arrow((-half, 2.7), (half, 2.7), color=BLUE, both=True, width=1.3)
    drawing.line([(-half, 0.0), (-half, 3.0)], SOFT, 0.8)
    drawing.line([(half, 0.0), (half, 3.0)], SOFT, 0.8)
    drawing.text((0.0, 3.15), "span", BLUE)
    drawing.arrow((-0.35, 1.2), (-0.35, 1.2 - root), color=INK, both=True, width=1.2, head=9.0)
    drawing.text((-1.25, -0.5), "root", INK)
    drawing.arrow(
        (-half - 0.4, 1.2 - back), (-half - 0.4, 1.2 - back - tip), color=INK, both=True, width=1.2, head=9.0
    )
    drawing.text((-half - 0.4, -2.0), "tip", INK)
    drawing.text((-4.6, -2.25), "taper = tip / root\narea = both halves", SOFT, fontsize=9.0)
    for side in (1.0, -1.0):
        drawing.shape([(0.0, -4.6), (half * side, -4.6 + 0.9), (half * side, -4.5 + 0.9), (0.0, -4.3)])
    drawing.line([(0.0, -4.5), (4.6, -4.5)], SOFT, 0.9)
    drawing.arc((0.0, -4.5), 4.1, 0.0, 8.0, color=GREEN, width=1.5)
    drawing.text((4.75, -4.55), "dihedral", GREEN, ha="left")
    drawing.text((-8.2, -4.9), "from behind", SOFT, ha="left", fontsize=9.0)
    return figure


@picture("bifilar-pendulum")
def pendulum() -> Figure:
    """An airplane hung on two threads, and the sign of the product of inertia.

    An airplane hung on two parallel threads of equal length, the same distance to each side of the center
    of gravity, turns back and forth about the vertical. From its period follows the moment of inertia
    about that axis: m g b squared T squared over 4 pi squared L. Beside it an airplane from the right:
    mass that is forward and low, or aft and high, makes the product of inertia xz positive.
    """
    figure, (left, right) = panels(2, (-6.6, 6.6), (-5.4, 6.2))
    left.line([(-3.4, 5.0), (3.4, 5.0)], INK, 2.4, dashed=False)
    for side in (1.0, -1.0):
        left.line([(2.2 * side, 5.0), (2.2 * side, 0.15)], INK, 1.2, dashed=False)
    wing = np.array([(0.4, -0.12), (5.7, 0.2), (5.7, 0.36), (0.4, 0.14)])
    for side in (1.0, -1.0):
        left.shape(wing * (side, 1.0))
    left.ellipse((0.0, 0.0), 1.3, 1.3)
    left.center_of_gravity((0.0, 0.0), 0.25)
    left.arrow((2.9, 5.0), (2.9, 0.2), color=BLUE, both=True, width=1.2, head=9.0)
    left.text((3.4, 2.6), "$L$", BLUE)
    left.arrow((0.0, -1.2), (2.2, -1.2), color=ORANGE, both=True, width=1.2, head=9.0)
    left.line([(2.2, 0.1), (2.2, -1.4)], SOFT, 0.8)
    left.line([(0.0, -0.2), (0.0, -1.4)], SOFT, 0.8)
    left.text((1.1, -1.75), "$b$", ORANGE)
    left.arc((0.0, 2.4), 1.5, 200.0, 340.0, color=RED, ratio=0.35)
    left.text((0.0, 1.3), "period $T$", RED, fontsize=9.5)
    left.text((0.0, -3.3), r"$I_{zz} = \frac{m\, g\, b^2\, T^2}{4 \pi^2 L}$", INK, fontsize=13)
    side_view(right, (0.6, 1.2), size=0.95)
    right.line([(-5.6, 1.2), (5.6, 1.2)], BLUE, 1.0)
    right.text((6.0, 1.2), "$x$", BLUE)
    right.line([(0.6, 3.4), (0.6, -1.4)], GREEN, 1.0)
    right.text((0.6, -1.85), "$z$", GREEN)
    for place, text in (((3.3, 0.45), "forward and low"), ((-4.3, 2.7), "aft and high")):
        right.dot(place, RED, 0.3)
        right.text((place[0], place[1] + (-1.0 if place[1] < 1.0 else 1.2)), text, RED, fontsize=9.5)
    right.text((0.0, -3.5), r"$I_{xz} = \int x\, z\; dm > 0$", RED, fontsize=12)
    right.center_of_gravity((0.6, 1.2), 0.25)
    return figure


@picture("propeller-law")
def propeller() -> Figure:
    """Thrust of a propeller.

    Thrust coefficient of a propeller over its advance ratio, as of the vehicle file of the V-tail, and
    below it the thrust over the airspeed at full, two thirds and one third of the speed of rotation.
    """
    diameter, full, CT0, CT1, CT2, density = 0.40, 147.2, 0.14, -0.10, -0.05, 1.225
    figure, (left, right) = plots(1, 2, 2.6)
    J = np.linspace(0.0, 0.9, 100)
    left.plot(J, CT0 + CT1 * J + CT2 * J**2, color=BLUE)
    left.plot([0.0], [CT0], "o", color=ORANGE)
    left.text(0.04, CT0 + 0.006, "$C_{T0}$, at rest", color=ORANGE)
    left.set(xlabel="advance ratio  $V / (n D)$", ylabel="$C_T$", xlim=(0.0, 0.9), ylim=(0.0, 0.165))
    V = np.linspace(0.0, 35.0, 100)
    for share, color in ((1.0, BLUE), (2.0 / 3.0, GREEN), (1.0 / 3.0, VIOLET)):
        n = full * share
        thrust = density * diameter**4 * (CT0 * n**2 + CT1 * n * V / diameter + CT2 * (V / diameter) ** 2)
        right.plot(V, thrust, color=color)
        right.text(1.0, thrust[0] + 2.5, f"{n:.0f} rev/s", color=color, fontsize=9.0)
    right.axhline(0.0, color=SOFT, linewidth=0.9)
    right.set(xlabel="airspeed, m/s", ylabel="thrust, N", xlim=(0.0, 35.0), ylim=(-15.0, 115.0))
    return figure


@picture("ground-effect")
def ground_effect() -> Figure:
    """Left: thrust of a rotor over its thrust far from the ground, by its height over its radius.

    Right: lift of a wing near the ground over its lift far from it, by its height over the span.
    """
    figure, (left, right) = plots(1, 2, 2.5)
    z = np.linspace(0.25, 4.0, 200)
    for coefficient, color in ((1.0, BLUE), (0.5, ORANGE)):
        left.plot(
            z,
            1.0 + coefficient * (1.0 / 16.0) / (z**2 + 1.0 / 16.0),
            color=color,
            label=f"rotor = {coefficient:g}",
        )
    left.set(
        xlabel="height over the radius of a rotor", ylabel="thrust factor", xlim=(0.0, 4.0), ylim=(1.0, 1.55)
    )
    left.legend()
    h = np.linspace(0.02, 1.0, 200)
    for coefficient, color in ((0.1, BLUE), (0.2, ORANGE)):
        right.plot(
            h, 1.0 + coefficient / (1.0 + (16.0 * h) ** 2), color=color, label=f"lift = {coefficient:g}"
        )
    right.set(xlabel="height over the span", ylabel="lift factor", xlim=(0.0, 1.0), ylim=(1.0, 1.22))
    right.legend()
    return figure
