"""Rotors of the built-in vehicles: numbers, turning and arms from their files, what moves them, and the law of a rotor."""

from __future__ import annotations

from functools import partial
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from pictures.registry import picture
from pictures.sketch import (
    BLUE,
    EDGE,
    INK,
    ORANGE,
    PALE_BLUE,
    PALE_ORANGE,
    RED,
    SOFT,
    TEAL,
    Point,
    panels,
    plots,
    sketch,
)  # fmt: skip
from stoop.base.arrays import FloatArray
from stoop.simulation import trim
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import load_vehicle

VEHICLES: Final = ("quad-x", "quad-plus", "hexa-x", "octo-x", "quadplane")
TURN: Final = {"ccw": BLUE, "cw": ORANGE}
PALE: Final = {"ccw": PALE_BLUE, "cw": PALE_ORANGE}


def hubs(vehicle: Vehicle) -> dict[str, Point]:
    """Return where the rotors stand on a drawing from above, m: to the right and forward of the center of gravity."""
    out = {}
    for name in vehicle.file.rotor:
        x, y = (
            vehicle.value(f"rotor.{name}.position.{c}") - vehicle.value(f"mass.center_of_gravity.{c}", 0.0)
            for c in "xy"
        )
        out[name] = (y, x)
    return out


def layout(name: str) -> Figure:
    """Draw the rotors of a built-in vehicle from above, with numbers, turning and arms."""
    vehicle = load_vehicle(name)
    places = hubs(vehicle)
    size = max(np.hypot(*p) for p in places.values())
    radius = 0.42 * min(
        np.hypot(*np.subtract(a, b)) for n, a in places.items() for m, b in places.items() if n != m
    )
    edge = size + radius
    figure, drawing = sketch((-1.8 * edge, 1.8 * edge), (-1.75 * edge, 1.25 * edge), width=4.2)
    for place in places.values():
        drawing.line([(0.0, 0.0), place], EDGE, 3.0, dashed=False, above=1.0)
    drawing.ellipse((0.0, 0.0), 0.42 * size, 0.5 * size)
    drawing.arrow((0.0, 0.1 * size), (0.0, 0.3 * size), color=INK, head=9.0)
    for rotor, place in places.items():
        spin, channel = vehicle.file.rotor[rotor].spin, vehicle.file.rotor[rotor].channel
        drawing.ellipse(place, 2.0 * radius, 2.0 * radius, facecolor=PALE[spin], edgecolor=TURN[spin])
        begin, end = (30.0, 150.0) if spin == "ccw" else (150.0, 30.0)
        drawing.arc(place, 0.78 * radius, begin, end, color=TURN[spin], width=1.6)
        drawing.text(place, channel.rpartition("_")[2], TURN[spin], fontsize=13, weight="bold")
        text = ", ".join(f"{x:+.3g}" if x else "0" for x in place[::-1]).replace("-", "\N{MINUS SIGN}")
        out = 1.0 + (radius + 0.12 * edge) / np.hypot(*place)
        where = "center" if abs(place[0]) < 0.5 * size else "left" if place[0] > 0.0 else "right"
        back = 0.12 * edge * np.sign(place[0]) * abs(place[1]) / size if where != "center" else 0.0
        drawing.text((out * place[0] - back, out * place[1]), text, SOFT, fontsize=8.5, ha=where)
    corner = (-1.65 * edge, -1.6 * edge)
    drawing.arrow(corner, (corner[0], corner[1] + 0.4 * edge))
    drawing.text((corner[0] + 0.08 * edge, corner[1] + 0.42 * edge), "$x$, forward", ha="left", fontsize=9.0)
    drawing.arrow(corner, (corner[0] + 0.4 * edge, corner[1]))
    drawing.text((corner[0] + 0.46 * edge, corner[1]), "$y$, right", ha="left", fontsize=9.0)
    drawing.text((1.75 * edge, -1.45 * edge), "counterclockwise", BLUE, ha="right", fontsize=9.0)
    drawing.text((1.75 * edge, -1.6 * edge), "clockwise", ORANGE, ha="right", fontsize=9.0)
    return figure


for _name in VEHICLES:
    picture(
        f"rotors-{_name}",
        f"The rotors of the built-in {_name} from above: the number of each motor, whether it turns clockwise or "
        "counterclockwise, and the position of its hub forward and to the right of the center of gravity in m.",
    )(partial(layout, _name))


def shares(vehicle: Vehicle) -> FloatArray:
    """Return the smallest changes of the channels (m, 4) that give one unit of each acceleration, at hover."""
    point = trim(vehicle)
    area = vehicle.rotor_range
    count = len(area.names)
    step = 1e-4
    inputs = np.repeat(point.inputs[:, None], 2 * count, axis=1)
    for i, column in enumerate(area.columns):
        inputs[column, [2 * i, 2 * i + 1]] += step, -step
    rows = vehicle.parameter_rows(point.changes, inputs.shape[1])
    states = vehicle.initial_states(point.start, rows, inputs)
    rates, _ = vehicle.array_equations()(rows, states, inputs)
    moved = rates[[vehicle.states.index(s) for s in ("p", "q", "r", "w")]] * np.array(
        [[1.0], [1.0], [1.0], [-1.0]]
    )
    return vehicle.rotor_allocation((moved[:, 0::2] - moved[:, 1::2]) / (2.0 * step))


def mixing(name: str) -> Figure:
    """Draw what the rotors of a built-in vehicle do for a roll, pitch and yaw acceleration and for a climb."""
    vehicle = load_vehicle(name)
    places, change = hubs(vehicle), shares(vehicle)
    edge = 1.75 * max(np.hypot(*p) for p in places.values())
    figure, drawings = panels(4, (-edge, edge), (-1.35 * edge, 1.25 * edge))
    titles = ("roll: right wing down", "pitch: nose up", "yaw: nose right", "heave: up")
    for drawing, title, column in zip(drawings, titles, change.T, strict=True):
        most = np.max(np.abs(column))
        for place, value in zip(places.values(), column, strict=True):
            drawing.line([(0.0, 0.0), place], EDGE, 2.0, dashed=False, above=1.0)
            share = float(value / most)
            up = share > 0.0
            radius = 0.26 * edge * np.sqrt(abs(share))
            if abs(share) > 0.02:
                sign, fill, edge_color = (
                    ("+", PALE_BLUE, BLUE) if up else ("\N{MINUS SIGN}", PALE_ORANGE, ORANGE)
                )
                drawing.ellipse(place, 2.0 * radius, 2.0 * radius, facecolor=fill, edgecolor=edge_color)
                drawing.text(place, sign, edge_color, weight="bold")
            else:
                drawing.dot(place, EDGE, 0.05 * edge)
        drawing.text((0.0, 1.12 * edge), title.partition(":")[0], weight="bold")
        drawing.text((0.0, -1.2 * edge), title.partition(": ")[2], SOFT, fontsize=9.0)
    return figure


for _name in ("quad-x", "hexa-x"):
    picture(
        f"mixing-{_name}",
        f"Which rotors of the built-in {_name} turn faster and which slower for a roll acceleration, right wing down, a pitch "
        "acceleration, nose up, a yaw acceleration, nose right, and a climb; the larger the circle, the larger the change.",
    )(partial(mixing, _name))


@picture("rotor-law")
def rotor_law() -> Figure:
    """Thrust of one rotor of quad-x.

    Left: thrust of one rotor of quad-x over its command, T1 x + T2 x squared, with the command that
    carries a quarter of the weight. Right: thrust at that command falls in a climb and rises in a
    descent.
    """
    vehicle = load_vehicle("quad-x")
    T1, T2, kv = (vehicle.value(f"rotors.{n}") for n in ("T1", "T2", "inflow"))
    hover = next(v for n, v in trim(vehicle, altitude=0.0).thrust.items() if n == "motor_1")
    figure, (left, right) = plots(1, 2, 2.7)
    x = np.linspace(0.0, 1.0, 100)
    left.plot(x, T1 * x + T2 * x**2, color=BLUE)
    left.plot(x, T1 * x, color=SOFT, linestyle=(0, (4, 2)), linewidth=1.2)
    weight = T1 * hover + T2 * hover**2
    left.plot([hover, hover, 0.0], [0.0, weight, weight], color=ORANGE, linewidth=1.2)
    left.plot([hover], [weight], "o", color=ORANGE)
    left.text(0.03, weight + 0.3, "weight / 4", color=ORANGE)
    left.text(0.74, 1.05, "$T_1 x$", color=SOFT)
    left.text(0.36, 5.6, "$T_1 x + T_2 x^2$", color=BLUE)
    left.set(xlabel="command $x$", ylabel="thrust, N", xlim=(0.0, 1.0), ylim=(0.0, 8.8))
    climb = np.linspace(-3.0, 3.0, 50)
    right.plot(climb, weight - kv * hover * climb, color=BLUE)
    right.plot([0.0], [weight], "o", color=ORANGE)
    right.text(0.2, weight + 0.12, "hover", color=ORANGE)
    right.text(-2.8, 3.3, "$-k_v\\, x\\, v_n$ (inflow)", color=BLUE)
    right.set(xlabel="climb along the axis $v_n$, m/s", xlim=(-3.0, 3.0))
    return figure


@picture("rotor-forces")
def rotor_forces() -> Figure:
    """A rotor from the right side.

    Thrust T along its axis, drag H in the plane of the disc against the motion of the hub; the arm is
    from the center of gravity to the hub. The reaction torque of a counterclockwise rotor turns the body
    nose right.
    """
    figure, (left, right) = panels(2, (-5.2, 5.2), (-3.6, 5.4))
    hub: Point = (2.2, 1.6)
    left.line([(0.0, 0.2), (2.2, 0.9)], EDGE, 4.0, dashed=False)
    left.ellipse((0.0, 0.0), 2.0, 1.1)
    left.line([(2.2, 0.7), hub], EDGE, 4.0, dashed=False)
    left.ellipse(hub, 4.2, 0.35, facecolor=PALE_BLUE, edgecolor=BLUE)
    left.arrow(hub, (2.2, 4.6), color=RED, width=2.2)
    left.text((2.5, 4.6), "$T\\,n$", RED, ha="left")
    left.arrow(hub, (-0.1, 1.6), color=TEAL, width=2.2)
    left.text((-0.5, 1.95), "$H$", TEAL)
    left.arrow((2.2, 1.6), (4.9, 2.35), color=ORANGE)
    left.text((4.4, 2.85), "$v_i$", ORANGE)
    left.arrow((0.0, 0.0), hub, color=INK, width=1.2, dashed=True)
    left.text((1.35, 0.35), "$r_i$")
    left.center_of_gravity((0.0, 0.0))
    left.text((0.0, -1.6), "from the right", SOFT)
    right.ellipse((0.0, 0.9), 4.6, 4.6, facecolor=PALE_BLUE, edgecolor=BLUE)
    right.arc((0.0, 0.9), 1.75, 200.0, 340.0, color=BLUE, width=1.8)
    right.text((0.0, 1.5), "ccw", BLUE)
    right.dot((0.0, 0.9))
    right.arc((0.0, 0.9), 3.0, 140.0, 40.0, color=RED, width=2.2)
    right.text((0.0, 4.7), "reaction on the body: $Q$, nose right", RED, fontsize=9.5)
    right.text((0.0, -2.2), "from above, the tip of its axis", SOFT)
    return figure
