"""Axes, angles, rates, moments and forces of an airplane, and which way they are positive."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from pictures.registry import picture
from pictures.sketch import (
    BLUE,
    FAINT,
    GREEN,
    INK,
    ORANGE,
    PALE_BLUE,
    RED,
    SOFT,
    TEAL,
    VIOLET,
    Point,
    Projection,
    Sketch,
    panels,
    placed,
    rear_view,
    side_view,
    sketch,
    top_view,
)  # fmt: skip
from stoop.base.arrays import FloatArray
from stoop.base.rotations import matrices_of_angles

AXIS = (BLUE, ORANGE, GREEN)  #: of x, y and z


def airplane(drawing: Sketch, view: Projection, turned: FloatArray | None = None, size: float = 1.0) -> None:
    """Draw an airplane in space; `turned` (3, 3) takes body axes to those of the drawing."""
    R = np.eye(3) if turned is None else turned
    rim = np.linspace(0.0, 2.0 * np.pi, 40)
    parts: list[ArrayLike] = []
    for side in (1.0, -1.0):
        parts.append(
            [
                (1.5, side * 0.3, 0.0),
                (1.1, side * 5.4, -0.25),
                (0.1, side * 5.4, -0.25),
                (-0.3, side * 0.3, 0.0),
            ]
        )
        parts.append(
            [
                (-4.5, side * 0.1, -0.1),
                (-4.8, side * 1.9, -0.1),
                (-5.6, side * 1.9, -0.1),
                (-5.7, side * 0.1, -0.1),
            ]
        )
    parts.append([(-4.3, 0.0, -0.2), (-5.4, 0.0, -1.9), (-6.1, 0.0, -1.9), (-5.9, 0.0, -0.1)])
    for points in parts:
        drawing.shape(view(size * np.asarray(points) @ R.T))
    x = np.concatenate([np.linspace(-5.9, 1.5, 12), 1.5 + 2.8 * np.sin(np.linspace(0.1, 0.5 * np.pi, 12))])
    r = np.where(
        x > 1.5,
        0.55 * np.sqrt(np.clip(1.0 - ((x - 1.5) / 2.8) ** 2, 0.0, 1.0)),
        0.08 + 0.47 * (x + 5.9) / 7.4,
    )
    rings = [
        np.column_stack([np.full(40, a), b * np.cos(rim), b * np.sin(rim)]) for a, b in zip(x, r, strict=True)
    ]
    hull = view(size * np.vstack(rings) @ R.T)
    drawing.shape(hull[ConvexHull(hull).vertices], above=2.5)


def turning(
    drawing: Sketch,
    view: Projection,
    along: ArrayLike,
    at: float,
    radius: float,
    color: str,
    begin: float,
    span: float,
) -> None:
    """Draw a positive rotation about a unit vector (3,), from a point `at` along it."""
    n = np.asarray(along, dtype=float)
    one = np.cross(n, [0.0, 0.0, 1.0] if abs(n[2]) < 0.9 else [0.0, 1.0, 0.0])
    one /= np.linalg.norm(one)
    angles = np.radians(np.linspace(begin, begin + span, 60))[:, None]
    drawing.curve(
        view(at * n + radius * (np.cos(angles) * one + np.sin(angles) * np.cross(n, one))),
        color,
        1.7,
        head=True,
    )


@picture("axes-body")
def axes_body() -> Figure:
    """An airplane in body axes: x forward through the nose, y through the right wing, z down.

    Arcs about the axes show the positive sense of roll, right wing down, of pitch, nose up, and of yaw,
    nose right.
    """
    figure, drawing = sketch((-8.4, 7.4), (-5.6, 4.2))
    view = Projection(azimuth=40.0, elevation=30.0)
    airplane(drawing, view)
    for i, (length, begin) in enumerate(((7.2, 120.0), (8.4, 60.0), (4.9, 200.0))):
        unit = np.eye(3)[i]
        drawing.arrow(view.point([0.0, 0.0, 0.0]), view.point(length * unit), color=AXIS[i], width=2.1)
        turning(drawing, view, unit, 0.83 * length, 0.8, AXIS[i], begin, 270.0)
    left = {"ha": "left", "linespacing": 1.5}
    drawing.text((5.1, -4.0), "$x$   $u$   $a_x$\nroll  $p$   $L$", BLUE, **left)
    drawing.text((-8.2, -3.55), "$y$   $v$   $a_y$\npitch  $q$   $M$", ORANGE, **left)
    drawing.text((1.0, -4.7), "$z$   $w$   $a_z$\nyaw  $r$   $N$", GREEN, **left)
    drawing.center_of_gravity((0.0, 0.0))
    return figure


@picture("axes-earth")
def axes_earth() -> Figure:
    """Earth axes: north, east and down from a point on the ground.

    An airplane above it has the position pn, pe and pd; pd is negative above the origin, and the altitude
    counts upward.
    """
    figure, drawing = sketch((-6.2, 7.6), (-2.9, 7.2))
    view = Projection(azimuth=205.0, elevation=24.0)
    ground = view([(-2.0, -3.0, 0.0), (8.5, -3.0, 0.0), (8.5, 7.0, 0.0), (-2.0, 7.0, 0.0)])
    drawing.shape(ground, PALE_BLUE, FAINT, above=1.0)
    for i, (length, name) in enumerate(((7.0, "north"), (6.0, "east"), (2.0, "down"))):
        drawing.arrow(view.point([0, 0, 0]), view.point(length * np.eye(3)[i]), color=AXIS[i], width=2.1)
        tip = view.point((length + (0.75, 1.0, 0.45)[i]) * np.eye(3)[i])
        drawing.text(tip, name, AXIS[i])
    place, below = np.array([4.5, 3.6, -3.1]), np.array([4.5, 3.6, 0.0])
    R = matrices_of_angles(np.array([0.35, 0.1, 0.7]))
    corner = [4.5, 0.0, 0.0], [0.0, 3.6, 0.0]
    for at in corner:
        drawing.line([view.point(at), view.point(below)])
    drawing.line([view.point(below), view.point(place)])
    airplane(drawing, _Shifted(view, view.point(place)), R, 0.36)
    drawing.text(view.point([2.2, -0.55, 0.0]), "$p_n$", BLUE)
    drawing.text(view.point([-0.6, 1.9, 0.0]), "$p_e$", ORANGE)
    x, y = view.point([4.5, 3.6, -0.9])
    drawing.text((x + 0.2, y), "$-p_d$", GREEN, ha="left")
    drawing.dot(view.point([0, 0, 0]))
    return figure


class _Shifted(Projection):
    """A projection whose origin lies elsewhere on the drawing."""

    def __init__(self, view: Projection, at: Point) -> None:
        super().__init__(view.azimuth, view.elevation)
        object.__setattr__(self, "at", at)

    def __call__(self, points: ArrayLike) -> FloatArray:
        return np.asarray(super().__call__(points) + np.asarray(self.at))


@picture("axes-wind")
def axes_wind() -> Figure:
    """Body, stability and wind axes of an airplane.

    Left, from the right side: stability axes are body axes turned about y by the angle of attack, so that
    their x axis lies under the velocity. Right, from above: wind axes are stability axes turned by the
    sideslip, so that x lies along the velocity.
    """
    figure, (left, right) = panels(2, (-6.5, 7.3), (-6.9, 6.4))
    side_view(left, size=0.82)
    turn = -16.0
    for angle, color in ((0.0, BLUE), (turn, VIOLET)):
        along, down = placed([(6.0, 0.0), (0.0, -4.6)], turn=angle)
        left.arrow((0.0, 0.0), tuple(along), color=color)
        left.arrow((0.0, 0.0), tuple(down), color=color)
        left.text(tuple(1.06 * along), "$x$", color, ha="left")
        left.text(tuple(1.1 * down), "$z$", color)
    left.arc((0.0, 0.0), 4.7, 0.0, turn, r"$\alpha$", INK, head=False)
    left.arc((0.0, 0.0), 3.6, -90.0, -90.0 + turn, r"$\alpha$", head=False, at=(-0.5, -3.0))
    left.text((-6.2, 5.8), "body axes", BLUE, ha="left")
    left.text((-6.2, 4.9), "stability axes, by $\\alpha$ about $y$", VIOLET, ha="left")
    left.center_of_gravity((0.0, 0.0))
    origin = (0.0, -1.8)
    top_view(right, origin, size=0.82)
    for angle, color in ((0.0, VIOLET), (-18.0, TEAL)):
        along, across = placed([(0.0, 5.0), (5.9, 0.0)], origin, angle)
        right.arrow(origin, tuple(along), color=color)
        right.arrow(origin, tuple(across), color=color)
        along, across = placed([(0.0, 5.5), (6.5, 0.0)], origin, angle)
        right.text(tuple(along), "$x$", color)
        right.text(tuple(across), "$y$", color)
    right.arc(origin, 3.9, 90.0, 72.0, r"$\beta$", head=False)
    right.text((-6.2, 5.8), "stability axes", VIOLET, ha="left")
    right.text((-6.2, 4.9), "wind axes, by $\\beta$ about $z$", TEAL, ha="left")
    right.center_of_gravity(origin)
    return figure


@picture("angle-of-attack")
def angle_of_attack() -> Figure:
    """An airplane from the right side.

    The velocity relative to the air points below the nose: the angle of attack, from the velocity up to
    the x axis, is positive. The pitch angle is from the horizon up to the x axis, the path angle from the
    horizon up to the velocity; without bank and wind pitch is path angle plus angle of attack.
    """
    figure, drawing = sketch((-5.6, 8.4), (-2.6, 4.9))
    pitch, path = 22.0, 8.0
    side_view(drawing, turn=pitch, size=0.8)
    nose, velocity = placed([(7.0, 0.0)], turn=pitch)[0], placed([(7.4, 0.0)], turn=path)[0]
    drawing.line([(0.0, 0.0), (7.6, 0.0)])
    drawing.text((7.0, -0.4), "horizon", SOFT)
    drawing.arrow((0.0, 0.0), tuple(nose), color=BLUE)
    drawing.text((nose[0] + 0.25, nose[1] + 0.2), "$x$", BLUE)
    drawing.arrow((0.0, 0.0), tuple(velocity), color=TEAL)
    drawing.text((velocity[0] + 0.3, velocity[1] + 0.05), "$V$", TEAL)
    drawing.arc((0.0, 0.0), 5.9, path, pitch, r"$\alpha$", RED, at=(6.05, 1.72))
    drawing.arc((0.0, 0.0), 4.6, 0.0, path, r"$\gamma$", INK, at=(4.95, 0.35))
    drawing.arc((0.0, 0.0), 3.9, 0.0, pitch, r"$\theta$", INK, at=(3.5, 0.36))
    u, w = placed([(7.4 * np.cos(np.radians(pitch - path)), 0.0)], turn=pitch)[0], velocity
    drawing.line([tuple(u), tuple(w)], BLUE)
    drawing.text((-5.4, 4.4), r"$\alpha = \arctan\,(w / u)$", RED, ha="left")
    drawing.text((-5.4, 3.6), r"$\theta = \gamma + \alpha$  (no bank, no wind)", INK, ha="left")
    drawing.text((7.4, 1.8), "$w$", BLUE)
    drawing.center_of_gravity((0.0, 0.0))
    return figure


@picture("sideslip")
def sideslip() -> Figure:
    """An airplane from above.

    The velocity relative to the air points to the right of the nose: the sideslip angle is positive, and
    the air comes from the right, wind in the right ear.
    """
    figure, drawing = sketch((-6.4, 6.6), (-5.3, 6.6), width=4.6)
    top_view(drawing, size=0.85)
    drawing.arrow((0.0, 0.0), (0.0, 5.8), color=BLUE)
    drawing.text((-0.4, 6.0), "$x$", BLUE)
    drawing.arrow((0.0, 0.0), (5.9, 0.0), "$y$", ORANGE)
    angle = 24.0
    tip = placed([(0.0, 5.6)], turn=-angle)[0]
    drawing.arrow((0.0, 0.0), tuple(tip), color=TEAL)
    drawing.text((tip[0] + 0.35, tip[1] + 0.2), "$V$", TEAL)
    drawing.arc((0.0, 0.0), 4.4, 90.0, 90.0 - angle, r"$\beta > 0$", RED, at=(1.0, 3.75))
    drawing.line([(0.0, float(tip[1])), tuple(tip)], ORANGE)
    drawing.text((-6.1, 5.9), r"$\beta = \arcsin\,(v / V)$", RED, ha="left")
    drawing.text((1.15, 5.45), "$v$", ORANGE)
    drawing.center_of_gravity((0.0, 0.0))
    return figure


@picture("euler-angles")
def euler_angles() -> Figure:
    """Three drawings.

    From above: the heading psi turns the nose from north to the right. From the side: the pitch angle
    theta then raises the nose above the horizon. From behind: the bank angle phi last turns the right
    wing down.
    """
    figure, (first, second, third) = panels(3, (-5.4, 5.4), (-5.2, 6.4))
    for drawing, title in (
        (first, r"1.  $\psi$ about down"),
        (second, r"2.  $\theta$ about $y$"),
        (third, r"3.  $\phi$ about $x$"),
    ):
        drawing.text((-5.1, 5.8), title, ha="left")
    top_view(first, turn=-35.0, size=0.68)
    first.line([(0.0, 0.0), (0.0, 4.5)])
    first.text((0.0, 4.85), "north", SOFT)
    tip = placed([(0.0, 4.9)], turn=-35.0)[0]
    first.arrow((0.0, 0.0), tuple(tip), color=BLUE)
    first.arc((0.0, 0.0), 3.6, 90.0, 55.0, r"$\psi$", RED)
    side_view(second, turn=24.0, size=0.68)
    second.line([(0.0, 0.0), (5.0, 0.0)])
    second.text((3.7, -0.6), "horizon", SOFT)
    second.arrow((0.0, 0.0), tuple(placed([(5.0, 0.0)], turn=24.0)[0]), color=BLUE)
    second.arc((0.0, 0.0), 4.2, 0.0, 24.0, r"$\theta$", RED)
    rear_view(third, turn=-28.0, size=0.68)
    third.line([(0.0, 0.0), (5.0, 0.0)])
    third.text((3.7, 0.6), "horizon", SOFT)
    third.arrow((0.0, 0.0), tuple(placed([(5.1, 0.0)], turn=-28.0)[0]), color=ORANGE)
    third.arc((0.0, 0.0), 4.3, 0.0, -28.0, r"$\phi$", RED)
    for drawing in (first, second, third):
        drawing.center_of_gravity((0.0, 0.0), 0.25)
    first.text((0.0, -4.8), "nose right", SOFT)
    second.text((0.0, -4.8), "nose up", SOFT)
    third.text((0.0, -4.8), "right wing down", SOFT)
    return figure


@picture("forces")
def forces() -> Figure:
    """An airplane from the right side with its forces.

    Lift perpendicular to the velocity, drag against it, thrust forward, weight down. An accelerometer at
    rest or in level flight shows the specific force without gravity: az is about -9.8.
    """
    figure, drawing = sketch((-6.8, 8.2), (-5.0, 5.6))
    pitch = 10.0
    side_view(drawing, turn=pitch, size=0.8)
    drawing.arrow((0.0, 0.0), (6.8, 0.0), color=TEAL)
    drawing.text((7.25, 0.0), "$V$", TEAL)
    drawing.arrow((0.0, 0.0), tuple(placed([(6.4, 0.0)], turn=pitch)[0]), color=BLUE)
    drawing.text((6.7, 1.25), "$x$", BLUE)
    drawing.arc((0.0, 0.0), 5.5, 0.0, pitch, color=INK, head=False)
    drawing.text((5.85, 0.5), r"$\alpha$")
    drawing.arrow((0.0, 0.0), (0.0, 4.4), color=RED, width=2.4)
    drawing.text((0.25, 4.7), r"lift  $\bar q\, S\, C_L$", RED, ha="left")
    drawing.arrow((0.0, 0.0), (-3.0, 0.0), color=RED, width=2.4)
    drawing.text((-3.3, -1.75), r"drag  $\bar q\, S\, C_D$", RED)
    start = tuple(placed([(3.5, 0.0)], turn=pitch)[0])
    end = tuple(placed([(5.3, 0.0)], turn=pitch)[0])
    drawing.arrow(start, end, color=ORANGE, width=2.8)
    drawing.text((4.1, 1.55), "thrust", ORANGE)
    drawing.arrow((0.0, 0.0), (0.0, -4.3), color=GREEN, width=2.4)
    drawing.text((0.25, -4.5), r"weight  $m\,g$, not felt by the accelerometer", GREEN, ha="left")
    drawing.arrow((0.0, 0.0), tuple(placed([(0.0, -3.0)], turn=pitch)[0]), color=BLUE)
    drawing.text((0.95, -3.1), "$z$", BLUE)
    drawing.text((-6.6, 5.1), r"level flight:  $a_z \approx -9.8\ \mathrm{m/s^2}$", INK, ha="left")
    drawing.center_of_gravity((0.0, 0.0))
    return figure


@picture("wind-triangle")
def wind_triangle() -> Figure:
    """From above: the velocity over ground is the velocity through the air plus the wind.

    The nose points along the velocity through the air when there is no sideslip, and the track along the
    velocity over ground.
    """
    figure, drawing = sketch((-4.2, 8.4), (-2.0, 5.6), width=5.6)
    turn = -28.0
    top_view(drawing, turn=turn, size=0.3)
    air, wind = placed([(0.0, 5.2)], turn=turn)[0], np.array([3.2, -0.9])
    drawing.arrow((0.0, 0.0), tuple(air), color=TEAL, width=2.2)
    drawing.text((-0.35, 3.2), "through the air\n$V$, heading $\\psi$", TEAL, ha="right")
    drawing.arrow(tuple(air), tuple(air + wind), color=VIOLET, width=2.2)
    drawing.text((4.7, 4.65), "wind, blowing to", VIOLET, ha="left")
    drawing.arrow((0.0, 0.0), tuple(air + wind), color=BLUE, width=2.2)
    drawing.text((3.6, 1.75), "over ground\n$v_n,\\ v_e,\\ v_d$", BLUE, ha="left")
    drawing.line([(0.0, 0.0), (0.0, 5.2)])
    drawing.text((-0.3, 5.2), "north", SOFT, ha="right")
    return figure
