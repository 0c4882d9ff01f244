"""How the tool works: from a log to a model, how a fit goes round, and which method is for which flight."""

from __future__ import annotations

from itertools import pairwise

from matplotlib.figure import Figure

from pictures.registry import picture
from pictures.sketch import (
    BLUE,
    EDGE,
    GREEN,
    INK,
    ORANGE,
    PALE_BLUE,
    PALE_GRAY,
    PALE_GREEN,
    PALE_ORANGE,
    PALE_VIOLET,
    RED,
    SOFT,
    VIOLET,
    Point,
    Sketch,
    sketch,
)  # fmt: skip

SMALL = {"fontsize": 8.8}


def step(
    drawing: Sketch, at: Point, title: str, verb: str, fill: str, edge: str, size: Point = (3.3, 1.5)
) -> None:
    """Draw a step of the way: what it is, and the command that does it."""
    drawing.box(at, size, "", fill, edge)
    drawing.text((at[0], at[1] + (0.3 if verb else 0.0)), title, weight="bold", fontsize=10.5)
    if verb:
        drawing.text((at[0], at[1] - 0.33), verb, SOFT, family="DejaVu Sans Mono", fontsize=8.6)


@picture("flow")
def flow() -> Figure:
    """The way from a log to a model.

    Log, flight, windows and fit; a vehicle file from scale and tape measure joins at the fit; then error
    bars, prediction of what was not fitted, verdict, and export.
    """
    figure, drawing = sketch((-0.2, 17.4), (-1.2, 8.3))
    x = (1.9, 6.35, 10.8, 15.25)
    step(drawing, (x[1], 7.2), "scale, tape measure", "mass, span, chord", PALE_GRAY, EDGE, (4.7, 1.5))
    step(drawing, (x[3] - 0.35, 7.2), "vehicle file", "stoop vehicle new", PALE_VIOLET, VIOLET, (3.9, 1.5))
    drawing.arrow((x[1] + 2.35, 7.2), (x[3] - 2.3, 7.2), color=VIOLET)
    row = (
        ("log", ".ulg .bin .csv", PALE_GRAY, EDGE),
        ("flight", "stoop info", PALE_BLUE, BLUE),
        ("windows", "stoop maneuvers", PALE_BLUE, BLUE),
        ("fit", "stoop identify", PALE_ORANGE, ORANGE),
    )
    for place, one in zip(x, row, strict=True):
        step(drawing, (place, 3.9), *one, (3.4, 1.5))
    drawing.arrow((x[3], 6.45), (x[3], 4.65), color=VIOLET)
    lower = (
        ("error bars", "same command", PALE_GREEN, GREEN),
        ("prediction", "stoop validate", PALE_GREEN, GREEN),
        ("verdict", "good for what", PALE_GREEN, GREEN),
        ("model", "stoop export", PALE_ORANGE, ORANGE),
    )
    for place, one in zip(x, lower, strict=True):
        step(drawing, (place, 0.1), *one, (3.4, 1.5))
    for begin, end in pairwise(x):
        for y in (3.9, 0.1):
            drawing.arrow((begin + 1.7, y), (end - 1.7, y), color=INK)
    drawing.line([(x[3], 3.15), (x[3], 2.0), (x[0], 2.0)], INK, 1.8, dashed=False)
    drawing.arrow((x[0], 2.02), (x[0], 0.85), color=INK)
    drawing.text((8.6, 2.32), "equations, residuals, sensitivities", SOFT, **SMALL)
    drawing.text((x[1], 5.15), "gaps, units, faults, wind", SOFT, **SMALL)
    drawing.text((x[2], 5.15), "fit and hold back", SOFT, **SMALL)
    return figure


@picture("output-error-loop")
def output_error() -> Figure:
    """Output error as a loop.

    The recorded inputs move the aircraft and the model; their outputs are compared; the residuals say how
    the parameters are to change, until nothing but noise is left.
    """
    figure, drawing = sketch((-0.4, 16.4), (-2.6, 6.4))
    drawing.text((1.15, 3.0), "recorded\ninputs", INK)
    drawing.box((6.2, 4.8), (3.6, 1.6), "aircraft", PALE_GRAY, EDGE)
    drawing.box((6.2, 1.4), (3.6, 1.6), "model\n(parameters)", PALE_BLUE, BLUE)
    drawing.line([(2.4, 3.0), (3.1, 3.0), (3.1, 4.8)], INK, 1.6, dashed=False)
    drawing.line([(3.1, 3.0), (3.1, 1.4)], INK, 1.6, dashed=False)
    drawing.arrow((3.08, 4.8), (4.4, 4.8))
    drawing.arrow((3.08, 1.4), (4.4, 1.4))
    drawing.line([(8.0, 4.8), (11.2, 4.8)], INK, 1.6, dashed=False)
    drawing.arrow((11.2, 4.82), (11.2, 3.5))
    drawing.line([(8.0, 1.4), (11.2, 1.4)], INK, 1.6, dashed=False)
    drawing.arrow((11.2, 1.38), (11.2, 2.7))
    drawing.ellipse((11.2, 3.1), 0.8, 0.8)
    drawing.text((10.75, 3.75), "+", SOFT)
    drawing.text((10.75, 2.4), "\N{MINUS SIGN}", SOFT)
    drawing.text((9.6, 5.2), "measured", INK, **SMALL)
    drawing.text((9.6, 1.0), "simulated", BLUE, **SMALL)
    drawing.arrow((6.2, 6.15), (6.2, 5.6), color=SOFT, width=1.3)
    drawing.text((6.55, 6.05), "gusts, noise", SOFT, ha="left", **SMALL)
    drawing.arrow((11.6, 3.1), (13.1, 3.1), color=RED)
    drawing.text((14.6, 3.1), "residuals", RED)
    drawing.line([(14.6, 2.7), (14.6, -1.2)], RED, 1.6, dashed=False)
    drawing.arrow((14.6, -1.2), (12.7, -1.2), color=RED)
    drawing.box((10.7, -1.2), (4.0, 1.5), "least squares,\nweights, priors", PALE_ORANGE, ORANGE)
    drawing.line([(8.7, -1.2), (6.2, -1.2)], ORANGE, 1.6, dashed=False)
    drawing.arrow((6.2, -1.2), (6.2, 0.6), color=ORANGE)
    drawing.text((5.9, -1.75), "better parameters", ORANGE, **SMALL)
    return figure


@picture("filter-error-loop")
def filter_error() -> Figure:
    """Filter error.

    As output error, but a Kalman gain times the difference of each sample corrects the state of the
    model, so that gusts are followed and not mistaken for the aircraft's own motion.
    """
    figure, drawing = sketch((-0.4, 16.4), (-2.2, 5.0))
    drawing.text((1.1, 3.0), "inputs", INK)
    drawing.arrow((2.1, 3.0), (3.6, 3.0))
    drawing.box((5.6, 3.0), (4.0, 1.7), "model\nstate $x$", PALE_BLUE, BLUE)
    drawing.arrow((7.6, 3.0), (10.6, 3.0), color=BLUE)
    drawing.text((9.0, 3.4), "predicted", BLUE, **SMALL)
    drawing.ellipse((11.0, 3.0), 0.8, 0.8)
    drawing.arrow((11.0, 4.8), (11.0, 3.4))
    drawing.text((11.35, 4.5), "measured", INK, ha="left", **SMALL)
    drawing.arrow((11.4, 3.0), (13.2, 3.0), color=RED)
    drawing.text((14.8, 3.0), "innovations", RED)
    drawing.line([(12.2, 3.0), (12.2, -0.6)], RED, 1.6, dashed=False)
    drawing.arrow((12.2, -0.6), (10.9, -0.6), color=RED)
    drawing.box((9.1, -0.6), (3.6, 1.5), "Kalman gain", PALE_VIOLET, VIOLET)
    drawing.line([(7.3, -0.6), (5.6, -0.6)], VIOLET, 1.6, dashed=False)
    drawing.arrow((5.6, -0.6), (5.6, 2.15), color=VIOLET)
    drawing.text((5.2, 0.75), "correction of the state,\nevery sample", VIOLET, ha="right", **SMALL)
    drawing.text((9.1, -1.8), "from the gusts and the noise, which are estimated too", SOFT, **SMALL)
    return figure


@picture("methods")
def methods() -> Figure:
    """Which method is taken by itself.

    Rotors carry the vehicle: multiple shooting, or regression where motors were logged slowly. Else gusts
    in air data and inertial sensors: filter error. Else too unstable for its windows: stabilized output
    error. Else output error.
    """
    figure, drawing = sketch((0.0, 16.6), (-1.1, 9.6))
    mono = {"family": "DejaVu Sans Mono", "fontsize": 9.6}
    questions = (
        (8.5, "do rotors carry it?", "multiple-shooting", "regression where motors were logged slowly"),
        (5.9, "gusts in air data and\ninertial sensors?", "filter-error", "gusts become states"),
        (3.3, "too unstable for\nits windows?", "stabilized-output-error", "a filter holds it, just enough"),
    )
    for y, question, answer, why in questions:
        drawing.box((3.2, y), (5.6, 1.5), question, PALE_GRAY, EDGE)
        drawing.arrow((6.0, y), (8.6, y), color=GREEN)
        drawing.text((7.2, y + 0.35), "yes", GREEN, **SMALL)
        drawing.box((12.1, y), (7.0, 1.1), answer, PALE_BLUE, BLUE, **mono)
        drawing.text((12.1, y - 0.95), why, SOFT, **SMALL)
        drawing.arrow((3.2, y - 0.75), (3.2, y - 1.83), color=INK)
        drawing.text((3.7, y - 1.3), "no", INK, **SMALL)
    drawing.box((3.2, 0.85), (5.6, 1.2), "output-error", PALE_BLUE, BLUE, **mono)
    drawing.text((3.2, -0.3), "simulated open loop: every error shows", SOFT, **SMALL)
    return figure


@picture("injection-points")
def injection_points() -> Figure:
    """The loops of an autopilot from the stick to the surfaces, and where a signal can be added.

    To the attitude set-point, to the rate set-point, or behind the controllers. The nearer to the
    surfaces, the less the controllers take back of it; the log must hold the commands behind all of them.
    """
    figure, drawing = sketch((-0.6, 17.4), (-4.2, 5.4))
    places = (2.6, 6.5, 10.4, 14.3)
    names = ("stick or\nmission", "attitude\ncontroller", "rate\ncontroller", "mixer,\nservos")
    for x, name, fill, edge in zip(
        places, names, (PALE_GRAY, PALE_BLUE, PALE_BLUE, PALE_GRAY), (EDGE, BLUE, BLUE, EDGE), strict=True
    ):
        drawing.box((x, 1.6), (2.4, 1.6), name, fill, edge, fontsize=9.6)
    for x in places[:-1]:
        drawing.arrow((x + 1.2, 1.6), (x + 2.7, 1.6))
    drawing.arrow((15.5, 1.6), (17.2, 1.6))
    drawing.text((16.5, 2.1), "surfaces", INK, **SMALL)
    signals = (
        ("angles", "Copter SID_AXIS 1 to 6"),
        ("rates", "PX4 autotune,\nSID_AXIS 7 to 9"),
        ("behind the\ncontrollers", "SID_AXIS 10 to 13,\nmanual mode"),
    )
    for x, (name, example) in zip(places, signals, strict=False):
        drawing.arrow((x + 1.85, 3.35), (x + 1.85, 1.85), color=ORANGE)
        drawing.text((x + 1.85, 4.5), name, ORANGE, weight="bold", fontsize=9.2, va="bottom")
        drawing.text((x + 1.85, 4.3), example, SOFT, fontsize=7.8, va="top")
    drawing.line([(16.4, 1.6), (16.4, -0.5), (6.5, -0.5)], SOFT, 1.4, dashed=False)
    drawing.arrow((6.5, -0.5), (6.5, 0.8), color=SOFT, width=1.4)
    drawing.line([(10.4, -0.5), (10.4, 0.0)], SOFT, 1.4, dashed=False)
    drawing.arrow((10.4, -0.1), (10.4, 0.8), color=SOFT, width=1.4)
    drawing.text((12.0, -1.0), "the motion, fed back, works against the input", SOFT, ha="right", **SMALL)
    drawing.line([(12.25, 1.4), (12.25, -2.2)], GREEN, 1.2)
    drawing.dot((12.25, 1.6), GREEN, 0.13)
    drawing.text((9.0, -2.75), "to be logged, fast: what goes to the mixer and the servos,", GREEN, **SMALL)
    drawing.text((9.0, -3.4), "torque set-points, actuator_motors, actuator_servos, RCOU", GREEN, **SMALL)
    return figure
