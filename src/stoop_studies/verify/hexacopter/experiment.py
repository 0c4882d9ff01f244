"""A real hexacopter: its forces in hover and climbs predict its sprints, beside what its owners found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from stoop.base.csv_text import Cell
from stoop.base.variables import SPECIFIC_FORCE
from stoop.estimate.predict import CUTOFF, ForceResiduals
from stoop.report.plots import Series, plot
from stoop.report.sheet import Figure, Prose, Section, Table
from stoop.vehicle.atmosphere import SEA_LEVEL_DENSITY
from stoop_studies.findings import Claim, Findings, Setting, holds
from stoop_studies.verify.experiment import Samples, Verification
from stoop_studies.verify.hexacopter.fits import (
    AREA,
    DENSITY,
    FULL,
    LEARNED,
    MASS,
    RADIUS,
    ROTORS,
    SPRINTS,
    WHOLE,
    Blades,
    Fitted,
    Log,
    Span,
    fitted,
    read_log,
    vehicle,
)

AXES: Final = SPECIFIC_FORCE
SHARE: Final = 0.6  #: of what a constant or static thrust leaves, that the model may leave
CLIMB: Final = 4.0  #: m/s
DRAWN_EVERY: Final = 5  #: samples of a curve
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
    "fitted", "window", "axis", "model", "constant", "static_thrust", "authors_here", "authors_published",
)  # fmt: skip
COEFFICIENT_HEAD: Final = ("quantity", "unit", "value", "std_error", "of_whole_flight", "authors")
WITHOUT_HEAD: Final = ("left_out", *AXES)


@dataclass(frozen=True)
class Residuals:
    """Those of one fit in one window, rms by axis, m/s2."""

    fit: Span
    window: Span
    ours: Mapping[str, ForceResiduals]
    theirs: Mapping[str, float]

    @classmethod
    def of(cls, fit: Fitted, span: Span) -> Residuals:
        """Return the residuals of a fit in a window."""
        return cls(fit.span, span, fit.residuals(span), fit.authors_residuals(span))

    def rows(self, published: Mapping[str, float]) -> list[tuple[Cell, ...]]:
        """Return what stands under `HEAD`."""
        spans = [f"{start:g}:{stop:g}" for start, stop in (self.fit, self.window)]
        out: list[tuple[Cell, ...]] = []
        for axis, found in self.ours.items():
            numbers = (found.model, found.constant, found.static, self.theirs[axis], published[axis])
            out.append((*spans, axis, *(round(n, 5) for n in numbers)))
        return out


def show(setting: Setting, samples: Samples) -> Findings:
    """Return residuals, coefficients, and what each part of the model is worth."""
    log = read_log(setting.data)
    ahead, whole = fitted(log, LEARNED), fitted(log, WHOLE)
    learned, sprints, all_of_it = (
        Residuals.of(fit, span) for fit, span in ((ahead, LEARNED), (ahead, SPRINTS), (whole, WHOLE))
    )
    rows = tuple(row for r in (learned, sprints, all_of_it) for row in r.rows(log.published))
    coefficients = coefficient_rows(ahead, whole, log.blades)
    lacking = {"nothing": sprints.ours, **without(setting, log)}
    return Findings(
        "A real hexacopter: hover and climbs tell its sprints",
        LEAD,
        _claims(sprints, all_of_it, log.published),
        (
            Section("Residuals", (_table(rows), *_figures(ahead), Prose(WORDS))),
            Section("Coefficients", (_coefficient_table(coefficients), Prose(COEFFICIENT_WORDS))),
            Section("What each part is worth", (_without_table(lacking),)),
        ),
        HEAD,
        rows,
        {
            "coefficients": (COEFFICIENT_HEAD, coefficients),
            "without": (
                WITHOUT_HEAD,
                tuple((name, *(round(found[a].model, 5) for a in AXES)) for name, found in lacking.items()),
            ),
        },
    )


def without(setting: Setting, log: Log) -> dict[str, Mapping[str, ForceResiduals]]:
    """Return the residuals of the prediction without one part of the model each."""
    whole = vehicle()
    wind = {f"sensors.{c}.bias": {"free": True, "prior": 3.0} for c in ("vn", "ve")}
    still = {f"sensors.accelerometer_position.{c}": {"value": 0.0, "free": False} for c in "xyz"}
    no_inflow = {"rotors.drag_inflow": {"value": 0.0}}
    cases = {
        "the attitude brought to the clock of the gyros": (read_log(setting.data, mapped=False), whole),
        "induced velocity (climb alone)": (log, whole.with_numbers({"rotors.radius": {"value": 100.0}})),
        "average of the voltage": (log, vehicle(("voltage_average = 30.0", "voltage_average = 0.1"))),
        "calm air (the wind is estimated)": (log, whole.with_numbers(wind)),
        "lever of the accelerometers": (log, whole.with_numbers(still)),
        "drag with the flow through the disc": (log, whole.with_numbers(no_inflow)),
    }
    return {name: fitted(own, LEARNED, file).residuals(SPRINTS) for name, (own, file) in cases.items()}


def _claims(sprints: Residuals, whole: Residuals, published: Mapping[str, float]) -> tuple[Claim, ...]:
    ours = {a: sprints.ours[a].model for a in AXES}
    simple = {
        "a constant": {a: ours[a] / sprints.ours[a].constant for a in AXES},
        "static thrust": {a: ours[a] / sprints.ours[a].static for a in AXES},
    }
    return (
        *(
            holds(
                f"{axis} is predicted as closely as the authors' fit follows it",
                ours[axis] <= published[axis],
                f"{ours[axis]:.3f} against {published[axis]:.3f} m/s2",
            )
            for axis in AXES
        ),
        *(
            holds(
                f"The prediction leaves at most {SHARE:g} of what {what} leaves",
                all(s <= SHARE for s in shares.values()),
                ", ".join(f"{a} {s:.2f}" for a, s in shares.items()),
            )
            for what, shares in simple.items()
        ),
        holds(
            "It is closer than the authors' model with their coefficients on the same samples",
            all(ours[a] < sprints.theirs[a] for a in AXES),
            _pairs(ours, sprints.theirs),
        ),
        holds(
            "Fitted to the whole flight, as theirs is, the model follows it closer in all axes",
            all(whole.ours[a].model <= published[a] for a in AXES),
            _pairs({a: whole.ours[a].model for a in AXES}, published),
        ),
    )


def _pairs(ours: Mapping[str, float], theirs: Mapping[str, float]) -> str:
    return ", ".join(f"{a} {ours[a]:.3f} against {theirs[a]:.3f}" for a in AXES)


def _cells(rows: Sequence[Sequence[Cell]], form: str) -> tuple[tuple[str, ...], ...]:
    return tuple(
        tuple(f"{cell:{form}}" if isinstance(cell, float) else str(cell) for cell in row) for row in rows
    )


def _table(rows: Sequence[Sequence[Cell]]) -> Table:
    head = tuple(name.replace("_", " ") for name in HEAD)
    return Table("Residuals of the specific force below 5 Hz, rms, m/s2", head, _cells(rows, ".3f"))


def _coefficient_table(rows: Sequence[Sequence[Cell]]) -> Table:
    head = ("quantity", "unit", "hover and climbs", "std error", "whole flight", "authors")
    caption = "Our numbers as the authors' coefficients; those without an error are held or follow"
    return Table(caption, head, _cells(rows, ".4g"))


def _without_table(lacking: Mapping[str, Mapping[str, ForceResiduals]]) -> Table:
    rows = tuple((name, *(f"{found[a].model:.3f}" for a in AXES)) for name, found in lacking.items())
    caption = "Residuals of the prediction, each fitted without one part, rms, m/s2"
    return Table(caption, ("without", *AXES), rows)


def blades(fit: Fitted) -> Blades:
    """Return our numbers as the authors' coefficients."""
    size = SEA_LEVEL_DENSITY * AREA
    T2, inflow, drag, through = (fit.value(f"rotors.{n}") for n in ("T2", "inflow", "drag", "drag_inflow"))
    return Blades(T2 / (size * TIP**2), inflow / (size * TIP), drag / (size * TIP), -through / size)


def coefficient_rows(ahead: Fitted, whole: Fitted, theirs: Blades) -> tuple[tuple[Cell, ...], ...]:
    """Return coefficients, and what they come to at hover, beside the authors'."""
    size = SEA_LEVEL_DENSITY * AREA
    all_blades = (blades(ahead), blades(whole), theirs)
    errors = {
        "ct1": ahead.error("rotors.T2") / (size * TIP**2),
        "ct2": ahead.error("rotors.inflow") / (size * TIP),
        "ch1": ahead.error("rotors.drag") / (size * TIP),
    }
    rows: list[tuple[Cell, ...]] = []
    for name in ("ct1", "ct2", "ch1", "ch2", "di", "dj", "dk"):
        ours, later, known = (getattr(b, name) for b in all_blades)
        rows.append((name, "1", *_digits(ours, errors.get(name, 0.0), later, known)))
    at_hover = [hovering(b) for b in all_blades]
    for name, unit in (
        ("tip speed at hover", "m/s"), ("drag at hover", "1/s"), ("lift lost in a climb", "m/s2"),
    ):  # fmt: skip
        ours, later, known = (values[name] for values in at_hover)
        rows.append((name, unit, *_digits(ours, 0.0, later, known)))
    lag = _digits(ahead.value("rotors.lag"), ahead.error("rotors.lag"), whole.value("rotors.lag"), 0.0)
    return (*rows, ("lag of the motors", "s", *lag))


def _digits(*numbers: float) -> tuple[float, ...]:
    return tuple(float(f"{n:.4g}") for n in numbers)


def hovering(own: Blades) -> dict[str, float]:
    """Return what coefficients come to: tip speed and drag per mass at hover, what a climb of 4 m/s costs per mass."""
    U, still, climbing = np.array([own.hover_speed()]), np.zeros(1), np.array([CLIMB])
    lost = float(ROTORS * (own.thrust(U, still) - own.thrust(U, climbing))[0])
    return {
        "tip speed at hover": float(U[0]),
        "drag at hover": float(ROTORS * own.drag(U, still)[0] / MASS),
        "lift lost in a climb": (lost + DENSITY * AREA * own.dk * CLIMB**2) / MASS,
    }


def _figures(fit: Fitted) -> tuple[Figure, ...]:
    curves = fit.curves(SPRINTS)
    every = slice(None, None, DRAWN_EVERY)
    time = curves.time[every]
    holes = np.flatnonzero(np.diff(time) > 1.0) + 1
    t = np.insert(time, holes, np.nan)
    out = []
    for i, axis in enumerate(AXES):
        pairs = (("measured", curves.measured), ("predicted", curves.model))
        series = [Series(name, t, np.insert(columns[every, i], holes, np.nan)) for name, columns in pairs]
        drawn = plot(series, "time on the log's clock, s", f"{axis}, m/s2", f"{axis} measured and predicted")
        out.append(Figure(f"Specific force {axis} in the sprints, below {CUTOFF:g} Hz", drawn))
    return tuple(out)


EXPERIMENT: Final = Verification("hexacopter", show, parts=("coefficients", "without"))
