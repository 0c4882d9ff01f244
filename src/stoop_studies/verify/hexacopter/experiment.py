"""What hover and climbs of a real hexacopter tell of its sprints, beside what its owners found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.csv_text import Cell
from stoop.estimate.forces import CUTOFF, Against
from stoop.report.plots import Series, plot
from stoop.report.sheet import Figure, Prose, Section, Table
from stoop.vehicle.atmosphere import SEA_LEVEL_DENSITY
from stoop_studies.findings import Claim, Findings, Results, Setting, holds
from stoop_studies.verify.hexacopter.authors import AREA, DENSITY, FULL, MASS, RADIUS, ROTORS, Blades
from stoop_studies.verify.hexacopter.fits import (
    LEARNED,
    SPRINTS,
    WHOLE,
    Fitted,
    Log,
    fitted,
    of_authors,
    read_log,
    vehicle,
)

AXES: Final = ("ax", "ay", "az")
SHARE: Final = 0.6  #: of what a constant or static thrust leaves, that the model may leave
CLIMB: Final = 4.0  #: m/s
THINNED: Final = 5  #: samples of a curve from one that is drawn to the next
TIP: Final = FULL * RADIUS  #: m/s at x = 1
LEAD: Final = f"""\
A hexacopter of 1.9 kg hovers, climbs twice at 6 m/s and descends slowly for 74 s; then it sprints forth and back at 10 m/s \
for 46 s. The model is fitted to the first part and predicts the second. Compared is the specific force below {CUTOFF:g} Hz, \
measured motion in: above, the rotors shake the accelerometers by more than all maneuvers do."""
WORDS: Final = """\
Residuals are rms, m/s2. A constant is the mean of the fitted part; static thrust is a constant and a factor of the sum of \
the squared commands, with the battery's voltage and the motors' lag as in the model. The authors' model is evaluated here on \
the same samples, with their coefficients, and constants learned from the same part as ours; their published residuals are \
those of their fit itself, over this flight and another, of the acceleration that they took from the velocity."""
COEFFICIENT_WORDS: Final = """\
Their thrust is rho A U (ct1 U - ct2 (climb + induced)), U the tip speed; ours is the same with T2 = rho A ct1 U1^2 and \
inflow = rho A ct2 U1, U1 = 154.8 m/s the tip speed at full pulse. Their U takes 16.8 V always, ours the voltage (15.4 V on \
average), and their induced velocity is that of axial flight, ours also that of forward flight; and they give to the drag dk \
of the body what we give to the flow through the discs. So single coefficients differ where what the vehicle feels is alike: \
the last rows but one. ch2 is held by us: 1.5 ct1 from blade elements without twist, with their sign. We have no drag of the \
body. The lift lost is that of a climb of 4 m/s."""
HEAD: Final = (
    "fitted",
    "window",
    "axis",
    "model",
    "constant",
    "static_thrust",
    "authors_here",
    "authors_published",
)
COEFFICIENT_HEAD: Final = ("quantity", "unit", "value", "std_error", "of_whole_flight", "authors")
WITHOUT_HEAD: Final = ("left_out", "ax", "ay", "az")


@dataclass(frozen=True)
class Judged:
    """The residuals of one fit in one window."""

    fit: str
    window: tuple[float, float]
    ours: Mapping[str, Against]
    theirs: Mapping[str, float]


@dataclass(frozen=True)
class Hexacopter:
    """Specific force of a real hexacopter."""

    name: str = "hexacopter"
    runs: int = 1
    parts: tuple[str, ...] = ("coefficients", "without")

    def plan(self, setting: Setting) -> None:
        """Return nothing: all of it takes a minute."""
        return

    def findings(self, setting: Setting, results: Results) -> Findings:
        """Return residuals, coefficients, and what each part of the model is worth."""
        log = read_log(setting.data)
        ahead, whole = fitted(log, LEARNED), fitted(log, WHOLE)
        judged = [_judged(log, ahead, LEARNED), _judged(log, ahead, SPRINTS), _judged(log, whole, WHOLE)]
        published = log.published.residuals
        coefficients = coefficient_rows(ahead, whole, log.published.blades)
        lacking = (("nothing", judged[1].ours), *without(setting, log))
        return Findings(
            "A real hexacopter: hover and climbs tell its sprints",
            LEAD,
            claims(judged, published),
            (
                Section("Residuals", (_table(judged, published), *_figures(ahead), Prose(WORDS))),
                Section("Coefficients", (_coefficient_table(coefficients), Prose(COEFFICIENT_WORDS))),
                Section("What each part is worth", (_without_table(lacking),)),
            ),
            HEAD,
            tuple(row for j in judged for row in _rows(j, published)),
            {
                "coefficients": (COEFFICIENT_HEAD, coefficients),
                "without": (WITHOUT_HEAD, tuple(_without_row(name, found) for name, found in lacking)),
            },
        )


def _judged(log: Log, fit: Fitted, span: tuple[float, float]) -> Judged:
    theirs = of_authors(log, log.published.blades, fit.curves(fit.span), fit.curves(span))
    return Judged(_span(fit.span), span, fit.against(span), theirs)


def _span(span: tuple[float, float]) -> str:
    return f"{span[0]:g}:{span[1]:g}"


def without(setting: Setting, log: Log) -> tuple[tuple[str, Mapping[str, Against]], ...]:
    """Return the prediction without one part of the model each."""
    whole = vehicle()
    wind = {f"sensors.{c}.bias": {"free": True, "prior": 3.0} for c in ("vn", "ve")}
    still = {f"sensors.accelerometer_position.{c}": {"value": 0.0, "free": False} for c in "xyz"}
    cases = {
        "the attitude brought to the clock of the gyros": (read_log(setting.data, mapped=False), whole),
        "induced velocity (climb alone)": (log, whole.with_numbers({"rotors.radius": {"value": 100.0}})),
        "average of the voltage": (log, vehicle(("voltage_average = 30.0", "voltage_average = 0.1"))),
        "calm air (the wind is estimated)": (log, whole.with_numbers(wind)),
        "lever of the accelerometers": (log, whole.with_numbers(still)),
        "drag with the flow through the disc": (
            log,
            whole.with_numbers({"rotors.drag_inflow": {"value": 0.0}}),
        ),
    }
    return tuple((name, fitted(own, LEARNED, file).against(SPRINTS)) for name, (own, file) in cases.items())


def claims(judged: Sequence[Judged], published: Mapping[str, float]) -> tuple[Claim, ...]:
    """Return what is claimed, whether or not it holds."""
    _, sprints, whole = judged
    return (
        *(_at_most(axis, sprints, published[axis]) for axis in AXES),
        _share("a constant", {a: sprints.ours[a].constant for a in AXES}, sprints),
        _share("static thrust", {a: sprints.ours[a].static for a in AXES}, sprints),
        _better(sprints),
        _alike(whole, published),
    )


def _at_most(axis: str, sprints: Judged, limit: float) -> Claim:
    model = sprints.ours[axis].model
    return holds(
        f"{axis} is predicted as closely as the authors' fit follows it",
        model <= limit,
        f"{model:.3f} against {limit:.3f} m/s2",
    )


def _share(what: str, other: Mapping[str, float], sprints: Judged) -> Claim:
    shares = {a: sprints.ours[a].model / other[a] for a in AXES}
    return holds(
        f"The prediction leaves at most {SHARE:g} of what {what} leaves",
        all(s <= SHARE for s in shares.values()),
        ", ".join(f"{a} {s:.2f}" for a, s in shares.items()),
    )


def _better(sprints: Judged) -> Claim:
    return holds(
        "It is closer than the authors' model with their coefficients on the same samples",
        all(sprints.ours[a].model < sprints.theirs[a] for a in AXES),
        ", ".join(f"{a} {sprints.ours[a].model:.3f} against {sprints.theirs[a]:.3f}" for a in AXES),
    )


def _alike(whole: Judged, published: Mapping[str, float]) -> Claim:
    return holds(
        "Fitted to the whole flight, as theirs is, the model follows it closer in all axes",
        all(whole.ours[a].model <= published[a] for a in AXES),
        ", ".join(f"{a} {whole.ours[a].model:.3f} against {published[a]:.3f}" for a in AXES),
    )


def _rows(judged: Judged, published: Mapping[str, float]) -> list[tuple[Cell, ...]]:
    out: list[tuple[Cell, ...]] = []
    for axis, found in judged.ours.items():
        numbers = (found.model, found.constant, found.static, judged.theirs[axis], published[axis])
        out.append((judged.fit, _span(judged.window), axis, *(round(n, 5) for n in numbers)))
    return out


def _table(judged: Sequence[Judged], published: Mapping[str, float]) -> Table:
    head = (
        "fitted",
        "window",
        "axis",
        "model",
        "constant",
        "static thrust",
        "authors here",
        "authors published",
    )
    rows = tuple(
        tuple(f"{cell:.3f}" if isinstance(cell, float) else str(cell) for cell in row)
        for j in judged
        for row in _rows(j, published)
    )
    return Table("Residuals of the specific force below 5 Hz, rms, m/s2", head, rows)


def blades(fit: Fitted) -> Blades:
    """Return our numbers as their coefficients."""
    size = SEA_LEVEL_DENSITY * AREA
    T2, inflow, drag, through = (fit.value(f"rotors.{n}") for n in ("T2", "inflow", "drag", "drag_inflow"))
    return Blades(T2 / (size * TIP**2), inflow / (size * TIP), drag / (size * TIP), -through / size)


def coefficient_rows(ahead: Fitted, whole: Fitted, theirs: Blades) -> tuple[tuple[Cell, ...], ...]:
    """Return coefficients, and what they come to at hover, beside the authors'."""
    size = SEA_LEVEL_DENSITY * AREA
    ours, all_of_it = blades(ahead), blades(whole)
    errors = {
        "ct1": ahead.error("rotors.T2") / (size * TIP**2),
        "ct2": ahead.error("rotors.inflow") / (size * TIP),
        "ch1": ahead.error("rotors.drag") / (size * TIP),
    }
    rows: list[tuple[Cell, ...]] = [
        (
            name,
            "1",
            *_digits(
                getattr(ours, name), errors.get(name, 0.0), getattr(all_of_it, name), getattr(theirs, name)
            ),
        )
        for name in ("ct1", "ct2", "ch1", "ch2", "di", "dj", "dk")
    ]
    felt = [hovering(b) for b in (ours, all_of_it, theirs)]
    rows += [
        (name, unit, *_digits(felt[0][name], 0.0, felt[1][name], felt[2][name]))
        for name, unit in (
            ("tip speed at hover", "m/s"),
            ("drag at hover", "1/s"),
            ("lift lost in a climb", "m/s2"),
        )
    ]
    lag = "rotors.lag"
    return (
        *rows,
        ("lag of the motors", "s", *_digits(ahead.value(lag), ahead.error(lag), whole.value(lag), 0.0)),
    )


def _digits(*numbers: float) -> tuple[float, ...]:
    return tuple(float(f"{n:.4g}") for n in numbers)


def hovering(own: Blades) -> dict[str, float]:
    """Return what coefficients come to: tip speed and drag per mass at hover, what a climb of 4 m/s costs per mass."""
    U, still, climbing = np.array([own.hovering()]), np.zeros(1), np.array([CLIMB])
    lost = float(ROTORS * (own.thrust(U, still) - own.thrust(U, climbing))[0])
    return {
        "tip speed at hover": float(U[0]),
        "drag at hover": float(ROTORS * own.drag(U, still)[0] / MASS),
        "lift lost in a climb": (lost + DENSITY * AREA * own.dk * CLIMB**2) / MASS,
    }


def _coefficient_table(rows: Sequence[tuple[Cell, ...]]) -> Table:
    head = ("quantity", "unit", "hover and climbs", "std error", "whole flight", "authors")
    shown = tuple(
        tuple(f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row) for row in rows
    )
    return Table(
        "Our numbers as the authors' coefficients; those without an error are held or follow", head, shown
    )


def _without_row(name: str, found: Mapping[str, Against]) -> tuple[Cell, ...]:
    return (name, *(round(found[a].model, 5) for a in AXES))


def _without_table(lacking: Sequence[tuple[str, Mapping[str, Against]]]) -> Table:
    rows = tuple((name, *(f"{found[a].model:.3f}" for a in AXES)) for name, found in lacking)
    return Table(
        "Residuals of the prediction, each fitted without one part, rms, m/s2", ("without", *AXES), rows
    )


def _figures(fit: Fitted) -> tuple[Figure, ...]:
    curves = fit.curves(SPRINTS)
    own = slice(None, None, THINNED)
    time = curves.time[own]
    holes = np.flatnonzero(np.diff(time) > 1.0) + 1
    t = np.insert(time, holes, np.nan)
    out = []
    for i, axis in enumerate(AXES):
        pairs = (("measured", curves.measured), ("predicted", curves.model))
        series = [Series(name, t, np.insert(columns[own, i], holes, np.nan)) for name, columns in pairs]
        drawn = plot(series, "time on the log's clock, s", f"{axis}, m/s2", f"{axis} measured and predicted")
        out.append(Figure(f"Specific force {axis} in the sprints, below {CUTOFF:g} Hz", drawn))
    return tuple(out)
