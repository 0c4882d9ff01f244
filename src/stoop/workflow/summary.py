"""Results as plain text tables."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from stoop.estimate.predict import ForceFigures
from stoop.report.modes import repeatability_summary
from stoop.results.result import ManeuverResult, Repeatability, Result
from stoop.results.uncertainty import ParameterIdentifiability

BASIC_METHODS = ("corrected", "cramer_rao")  #: methods that every result has
_SHOWN = ("vn", "ve", "vd", "V", "alpha", "beta", "p", "q", "r", "phi", "theta", "psi", "ax", "ay", "az")


def _number(value: float, width: int = 11) -> str:
    return f"{value:{width}.4g}" if math.isfinite(value) else "-".rjust(width)


def estimates_table(result: Result, truth: Mapping[str, float] | None = None) -> str:
    """Return estimates with standard errors, intervals and remarks; beside the truth where it is known."""
    wide = max([len("parameter"), *map(len, result.parameters)])
    head = (
        f"{'parameter':{wide}} {'estimate':>11} {'std error':>11} {'95 % from':>11} {'to':>11} {'start':>11}"
    )
    lines = [head + (f" {'truth':>11} {'sigmas off':>10}" if truth else "") + "  unit"]
    for name, p in result.parameters.items():
        error = _number(p.std_error) if p.identifiable else _doubtful(p.std_error)
        cells = [_number(p.estimate), error, *map(_number, (p.ci95_lower, p.ci95_upper, p.start))]
        if truth:
            known = truth.get(name, math.nan)
            off = (p.estimate - known) / p.std_error if p.std_error > 0.0 else math.nan
            cells += [_number(known), f"{off:10.2f}" if math.isfinite(off) else "-".rjust(10)]
        remark = "  at bound" if p.at_bound else "" if p.identifiable else "  not identifiable"
        lines.append(f"{name:{wide}} {' '.join(cells)}  {p.unit}{remark}")
    return "\n".join(lines)


def _doubtful(error: float, width: int = 11) -> str:
    """Return a standard error in brackets: the parameter is not identifiable."""
    return f"({error:.3g})".rjust(width) if math.isfinite(error) else "-".rjust(width)


def methods_table(result: Result) -> str:
    """Return the standard errors of every method side by side; in brackets where not identifiable."""
    wide = max([len("parameter"), *map(len, result.parameters)])
    lines = [f"{'parameter':{wide}} " + " ".join(f"{name:>11}" for name in result.uncertainty)]
    for name, p in result.parameters.items():
        shown = _number if p.identifiable else _doubtful
        spreads = [m.parameters.get(name) for m in result.uncertainty.values()]
        cells = ["".rjust(11) if s is None else shown(s.std_error) for s in spreads]
        lines.append(f"{name:{wide}} {' '.join(cells)}".rstrip())
    return "\n".join(lines)


def advice_by_doubt(found: Mapping[str, ParameterIdentifiability]) -> dict[str, list[str]]:
    """Return for each doubt one line per advice, the parameters that share it joined."""
    shared: dict[str, dict[str, list[str]]] = {}
    for name, one in found.items():
        if one.advice:
            shared.setdefault(str(one.doubt), {}).setdefault(str(one.advice), []).append(name)
    return {
        doubt: [f"{', '.join(names)}: {advice}" for advice, names in by_advice.items()]
        for doubt, by_advice in shared.items()
    }


def forces_table(figures: Sequence[ForceFigures]) -> str:
    """Return the residuals of the specific force below 5 Hz: of the model, a constant, static thrust, m/s2."""
    lines = [f"{'window':24} {'role':10} {'axis':4} {'model':>8} {'constant':>9} {'static thrust':>13}"]
    for one in figures:
        where = f"{one.window.start:g}:{one.window.stop:g}"
        lines += [
            f"{where:24} {one.role:10} {axis:4} {a.model:8.3f} {a.constant:9.3f} {a.static:13.3f}"
            for axis, a in one.axes.items()
        ]
    return "\n".join(lines)


def repeatability_lines(found: Repeatability) -> list[str]:
    """Return whether maneuvers fitted alone agree: how many parameters were compared, and which; none if not asked for."""
    if not found.maneuvers:
        return []
    lines = [repeatability_summary(tuple(found.parameters.values()))]
    for verdict in ("scatter", "agree"):
        named = [
            f"{name} ({1 + one.degrees} maneuvers, p = {one.p_value:.2g})"
            for name, one in found.parameters.items()
            if one.verdict == verdict
        ]
        lines += [f"{verdict}: {', '.join(named)}"] if named else []
    return [*lines, *found.remarks]


def figures_table(maneuvers: Sequence[ManeuverResult]) -> str:
    """Return Theil's coefficient of every channel and maneuver, the trivial lag's beneath."""
    lines = [
        "Theil's inequality coefficient (0 perfect, 1 worst; low-passed at 10 Hz), first-order lag beneath"
    ]
    for m in maneuvers:
        channels = [c for c in _SHOWN if c in m.channels]
        lines.append(f"{m.flight} {m.start:g}:{m.stop:g} ({m.role})")
        lines.append("  " + "".join(f"{c:>7}" for c in channels))
        lines.append("  " + "".join(f"{m.channels[c].theil:7.3f}" for c in channels) + "  model")
        lines.append("  " + "".join(_lag(m, c) for c in channels) + "  lag")
    return "\n".join(lines)


def _lag(m: ManeuverResult, channel: str) -> str:
    value = m.channels[channel].baseline_theil
    return f"{value:7.3f}" if math.isfinite(value) else "-".rjust(7)
