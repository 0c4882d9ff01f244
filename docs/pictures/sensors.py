"""Where instruments are, what that does to their readings, and what else stands between a reading and the truth."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from pictures.registry import picture
from pictures.sketch import (
    BLUE,
    EDGE,
    GREEN,
    INK,
    ORANGE,
    PALE_GREEN,
    RED,
    SOFT,
    TEAL,
    VIOLET,
    panels,
    placed,
    plots,
    side_view,
    sketch,
    top_view,
)  # fmt: skip


@picture("sensor-positions")
def positions() -> Figure:
    """An airplane from the right.

    From an origin of your choice, x forward and z down, points are measured to the center of gravity, the
    accelerometer, the vanes and the thrust line. What matters are the arms from the center of gravity to
    each.
    """
    figure, drawing = sketch((-7.6, 8.6), (-4.6, 4.4))
    side_view(drawing)
    origin, gravity = (4.3, 0.0), (0.6, -0.02)
    drawing.line([(4.0, 0.12), (6.3, 0.3)], EDGE, 2.0, dashed=False)
    points = (
        ("accelerometer_position", (-0.9, 0.28), GREEN, (-4.4, 3.7)),
        ("vane_position", (6.3, 0.3), VIOLET, (5.2, 2.2)),
    )
    for name, place, color, text in points:
        drawing.dot(place, color, 0.16)
        drawing.line([place, (text[0], text[1] - 0.3)], color, 0.8, dashed=False)
        drawing.text(text, name, color)
        drawing.arrow(gravity, place, color=color, width=1.4, head=10.0)
    drawing.line([(-6.9, -0.55), (7.6, 0.05)], ORANGE)
    drawing.text((-5.0, -1.1), "thrust line: position, pitch", ORANGE)
    drawing.line([gravity, (1.7, 3.0)], INK, 0.8, dashed=False)
    drawing.text((1.7, 3.3), "center_of_gravity")
    drawing.center_of_gravity(gravity)
    drawing.dot(origin, RED, 0.14)
    drawing.arrow(origin, (4.3, -2.6), color=RED, width=1.4)
    drawing.text((4.3, -2.95), "$z$", RED)
    drawing.arrow(origin, (7.9, 0.0), color=RED, width=1.4)
    drawing.text((8.25, -0.02), "$x$", RED)
    drawing.line([origin, (5.6, -3.4)], RED, 0.8, dashed=False)
    drawing.text((6.1, -3.75), "origin, anywhere", RED)
    drawing.arrow((4.3, -3.9), (0.6, -3.9), color=SOFT, width=1.2, both=True, head=9.0)
    drawing.line([(0.6, -0.2), (0.6, -4.1)], SOFT, 0.8)
    drawing.line([(4.3, -3.2), (4.3, -4.1)], SOFT, 0.8)
    drawing.text((2.4, -4.25), "$x$ of the center of gravity is negative", SOFT, fontsize=9.0)
    return figure


@picture("lever-arms")
def lever_arms() -> Figure:
    """Instruments away from the center of gravity.

    Left: a vane ahead of the center of gravity sees an angle of attack that is smaller by q times its arm
    over the airspeed while the nose goes up. Right: an accelerometer off the center of gravity also feels
    the acceleration of its own place.
    """
    figure, (left, right) = panels(2, (-7.0, 8.4), (-5.2, 5.6))
    side_view(left, turn=8.0, size=0.95)
    vane = tuple(placed([(6.1, 0.3)], turn=8.0)[0])
    left.line([tuple(placed([(3.9, 0.2)], turn=8.0)[0]), vane], EDGE, 2.0, dashed=False)
    left.dot(vane, VIOLET, 0.2)
    left.arc((0.0, 0.0), 4.4, 30.0, 62.0, "$q$", GREEN, at=(3.7, 3.95))
    left.arrow(vane, (vane[0], vane[1] + 2.3), color=GREEN, width=1.8)
    left.text((vane[0] + 0.3, vane[1] + 2.7), "$q\\,x_v$", GREEN)
    left.arrow((vane[0], vane[1]), (vane[0] + 1.9, vane[1]), color=TEAL)
    left.text((vane[0] + 1.4, vane[1] - 0.6), "$V$", TEAL)
    left.center_of_gravity((0.0, 0.0), 0.25)
    left.text((0.5, -3.2), r"$\alpha_{vane} \approx \alpha - q\,x_v / V$", VIOLET)
    left.text((0.5, -4.4), "the vane moves up: less incidence", SOFT, fontsize=9.0)
    side_view(right, size=0.95)
    place = (-3.6, 0.25)
    right.dot(place, GREEN, 0.2)
    right.arc((0.0, 0.0), 4.9, -20.0, 14.0, r"$\dot q$", RED, at=(5.7, 0.6))
    right.arrow((0.0, 0.0), place, color=GREEN, width=1.4)
    right.arrow(place, (-3.6, -2.0), color=RED, width=1.9)
    right.text((-4.6, -2.0), r"$-\dot q\,x_a$", RED)
    right.center_of_gravity((0.0, 0.0), 0.25)
    right.text((0.7, -3.2), r"$a_{z,sensor} = a_z - \dot q\,x_a + \ldots$", GREEN)
    right.text((0.7, -4.4), r"$x_a < 0$ behind the center of gravity", SOFT, fontsize=9.0)
    return figure


@picture("imu-alignment")
def alignment() -> Figure:
    """The axes of an inertial unit that is turned against the airplane, from above.

    The unit looks to the right of the airplane's nose: a positive third angle of imu_alignment.
    """
    figure, drawing = sketch((-6.6, 6.6), (-5.4, 5.8), width=4.2)
    top_view(drawing, size=0.85)
    unit = np.array([(-1.0, -1.2), (1.0, -1.2), (1.0, 1.2), (-1.0, 1.2)])
    drawing.shape(unit, PALE_GREEN, GREEN, turn=-16.0, above=3.0)
    drawing.arrow((0.0, 0.0), (0.0, 5.0), color=BLUE)
    drawing.text((-0.5, 5.1), "$x$", BLUE)
    tip = placed([(0.0, 4.6)], turn=-16.0)[0]
    drawing.arrow((0.0, 0.0), tuple(tip), color=GREEN)
    drawing.text((tip[0] + 1.3, tip[1] + 0.4), "$x$ of the unit", GREEN)
    drawing.arc((0.0, 0.0), 3.5, 90.0, 74.0, r"$\psi > 0$", RED, at=(1.95, 3.15))
    return figure


@picture("reading")
def reading() -> Figure:
    """How a reading arises.

    From the true value at the place of the sensor by a scale factor, a bias, a delay and noise.
    """
    t = np.linspace(0.0, 4.0, 401)
    true = np.exp(-0.6 * t) * np.sin(3.0 * t)
    late = np.interp(t - 0.18, t, true, left=0.0)
    rng = np.random.default_rng(4)
    figure, axes = plots(1, 1, 2.7)
    axes.plot(t, true, color=INK, label="true")
    axes.plot(t, 1.15 * late + 0.12, color=BLUE, label="with scale 1.15, bias 0.12, delay 0.18 s")
    noisy = 1.15 * late[::4] + 0.12 + 0.03 * rng.standard_normal(len(t[::4]))
    axes.plot(t[::4], noisy, ".", color=ORANGE, markersize=4, label="and noise, sigma 0.03: the reading")
    axes.axhline(0.12, color=SOFT, linewidth=0.9, linestyle=(0, (4, 3)))
    axes.text(3.98, 0.16, "bias", color=SOFT, ha="right", fontsize=9.0)
    axes.set(xlabel="time, s", ylabel="q, rad/s", xlim=(0.0, 4.0), ylim=(-0.75, 1.35))
    axes.legend(loc="upper right")
    return figure
