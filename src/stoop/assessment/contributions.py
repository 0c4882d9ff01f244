r"""What controls and motions contribute to the readings, against noise and against what the model leaves unexplained.

The free terms of one variable, of estimates :math:`\theta_c` and sensitivities :math:`S_c`, contribute
:math:`s = S_c\theta_c`. The other unknowns cannot take over :math:`v = s - S_o D_{oo}^{-1} D_{oc}\theta_c`, with the information
D. Against stationary residuals of autocovariance R the size of v is :math:`t = v'v / \sqrt{v'Rv}` standard errors. What a model
lacks (gusts, errors of sensors, terms) leaves colored residuals that may be in step with v: noise is then no more than their
least power density, and the rest, of autocovariance X, is systematic. Its rms in the time and band of v is less than that of v by

.. math:: \rho = \frac{v'v}{\sqrt{n\,v'Xv}}, \qquad
          n = \frac{(\sum v^2)^2}{\sum v^4}\,\frac{(\sum |V|^2)^2}{N \sum |V|^4} \ge 1,

with the spectrum V of the N samples of v, whose independent samples n are the product of its duration and its bandwidth. A
systematic residual of the shape of v changes the terms by :math:`1/\rho` of their values, whatever their standard errors.

References
----------
V. Klein and E. A. Morelli, *Aircraft System Identification*, 2nd ed., 2016, section 5.1 (significance of a regressor) and
chapter 9 (signal-to-noise ratio of experiments).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from scipy.fft import next_fast_len, rfft

from stoop.assessment.coloring import ColoredNoise, half_spectrum_scale
from stoop.base.arrays import FloatArray, IntArray
from stoop.base.notices import Notice, notice
from stoop.base.variables import RATES
from stoop.checks.excitation import deflections
from stoop.estimate.estimate import Estimate
from stoop.problem.evidence import Evidence, PieceEvidence, invert
from stoop.vehicle import Vehicle, terms

#: that excite a motion
INPUTS: Final = {"alpha": "pitch", "beta": "yaw", "p": "roll", "q": "pitch", "r": "yaw"}


class Limits:
    """Limits of excitation, calibrated on simulated flights (`tests/core/assessment/test_contributions.py`)."""

    #: noise and systematic residuals over a contribution, from which it is in doubt: derivatives were wrong by 0.2 to 2.2 of
    #: their values there, in gusts that a method ignores; in calm air, and with gusts in the model, both stay below 0.2
    doubt: Final = 0.5
    refused: Final = 1.0  #: systematic residuals over a contribution, from which no interval is given
    aim: Final = 0.1  #: standard error over the value that the advised amplitude is for


@dataclass(frozen=True)
class Contribution:
    """What the free terms of one variable contribute."""

    variable: str
    parameters: tuple[str, ...]
    column: int  #: of the residuals, in which the contribution stands out most
    systematic: float  #: 1 / rho in that column, the share of it that a systematic residual may be
    noise: float  #: 1 / t, the share that noise may be; infinite where nothing is contributed

    @property
    def doubtful(self) -> bool:
        """Whether noise and systematic residuals are more than a half of it."""
        return float(np.hypot(self.systematic, self.noise)) > Limits.doubt

    @property
    def factor(self) -> float:
        """By how much more motion leaves no doubt, with the standard error aimed at."""
        return max(self.noise / Limits.aim, self.systematic / Limits.doubt)


def contributions(
    vehicle: Vehicle, evidence: Evidence, information: FloatArray, noise: ColoredNoise
) -> tuple[Contribution, ...]:
    """Return the contributions of controls and motions; `information` (f, f) of the free unknowns, `noise` of residuals."""
    free = evidence.free
    unknowns = [evidence.unknowns[i] for i in free]
    entries = {u.name: row for row, u in enumerate(unknowns) if u.kind == "parameter"}
    groups, columns = _groups(vehicle, entries), []
    for names in groups.values():
        own = np.array([entries[name] for name in names])
        columns.append(_unshared(information, own, [unknowns[i].estimate for i in own]))
    if not columns:
        return ()
    v = [piece.of(free).filled()[1] @ np.column_stack(columns) for piece in evidence.pieces]
    energy = np.asarray(sum(np.sum(one**2, axis=0) for one in v))  # (n_y, g)
    variance = energy.sum(axis=0) if evidence.white else sum(noise.variance(one) for one in v)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.nan_to_num(np.sqrt(variance) / energy.sum(axis=0), nan=np.inf, posinf=np.inf)
        power = np.zeros_like(energy) if evidence.white else _systematic(v, energy, noise)
        systematic = np.nan_to_num(np.sqrt(power) / energy, nan=np.inf, posinf=np.inf)
    best = np.argmin(systematic, axis=0)
    return tuple(
        Contribution(variable, tuple(names), int(c), float(systematic[c, j]), float(share[j]))
        for j, ((variable, names), c) in enumerate(zip(groups.items(), best, strict=True))
    )


def systematic_shifts(
    pieces: Sequence[PieceEvidence], information: FloatArray, noise: ColoredNoise, count: int
) -> FloatArray:
    """Return the shifts (count,) of the first unknowns by systematic residuals in step with them, 1 / rho of one unit each.

    The prior, in the information (f, f), holds against it.
    """
    columns = np.column_stack([_unshared(information, np.array([i]), [1.0]) for i in range(count)])
    v = [piece.filled()[1] @ columns for piece in pieces]
    energy = np.asarray(sum(np.sum(one**2, axis=0) for one in v))  # (n_y, count)
    with np.errstate(divide="ignore", invalid="ignore"):  # channels without a contribution
        power = np.nan_to_num(_systematic(v, energy, noise)).sum(axis=0)
    return np.asarray(np.sqrt(power) / np.einsum("fi,fg,gi->i", columns, information, columns))


def _unshared(information: FloatArray, own: IntArray, estimates: Sequence[float]) -> FloatArray:
    """Return the vector (f,) of some unknowns at their estimates with the others as they would best take their place."""
    weights = np.zeros(len(information))
    rest = np.setdiff1d(np.arange(len(information)), own)
    weights[own] = estimates
    taken = information[np.ix_(rest, own)] @ weights[own]
    weights[rest] = -invert(information[np.ix_(rest, rest)]).matrix @ taken
    return weights


def contribution_notices(fit: Estimate, found: Sequence[Contribution]) -> list[Notice]:
    """Return which contributions are in doubt, with the amplitudes that would settle it."""
    doubtful = [one for one in found if one.doubtful and np.isfinite(one.noise)]
    if not doubtful:
        return []
    outputs, controls = fit.problem.layout.vehicle.outputs, deflections(fit.problem)
    told, columns = [], fit.refit_problem.columns
    for one in doubtful:
        series, unit = controls.get(one.variable), "deg/s" if one.variable in RATES else "deg"
        if series is None:
            each = [y[:, outputs.index(one.variable)] for y in fit.readings]
            series = np.concatenate([x - np.nanmean(x) for x in each])
        rms = float(np.sqrt(np.nanmean(series**2)))
        now, needed = (np.degrees([rms, rms * one.factor])).tolist()
        told.append(
            f"{one.variable} ({now:.2g} {unit} rms: noise {one.noise:.0%}, systematic residuals {one.systematic:.0%} in "
            f"{columns[one.column]}; {INPUTS.get(one.variable, one.variable)} inputs of {needed:.2g} {unit} rms)"
        )
    names = tuple(dict.fromkeys(name for one in doubtful for name in one.parameters))
    variables = tuple(one.variable for one in doubtful)
    values: dict[str, Any] = {"effects": tuple(told), "parameters": names, "variables": variables}
    return [notice("contribution-in-doubt", **values, aim=Limits.aim)]


def _groups(vehicle: Vehicle, free: Mapping[str, int]) -> dict[str, list[str]]:
    """Return the free terms of each control, alone or in a product, and those linear in a motion."""
    controls = set(vehicle.file.controls)
    known, out = set(terms.STATE_VARIABLES) | controls, dict[str, list[str]]()
    for name, text in (pair for texts in vehicle.terms.values() for pair in texts.items() if pair[0] in free):
        made = terms.variables(terms.parse(text, known, vehicle.where))
        for variable in made & controls or (made if len(made) == 1 else ()):
            out.setdefault(variable, []).append(name)
    moving = (v for v in INPUTS if v in vehicle.outputs)
    return {v: out[v] for v in (*vehicle.file.controls, *moving) if v in out}


def _systematic(v: Sequence[FloatArray], energy: FloatArray, noise: ColoredNoise) -> FloatArray:
    """Return n v'Xv (n_y, g) of contributions (n, n_y, g) of each piece, of energies (n_y, g)."""
    systematic, squares, widths = (np.zeros_like(energy) for _ in range(3))
    for one in v:
        size = next_fast_len(2 * len(one), real=True)
        power = (np.abs(rfft(one, size, axis=0)) * half_spectrum_scale(size)[:, None, None]) ** 2
        color = np.abs(noise.gain(size)) ** 2 * np.diag(noise.innovation)
        systematic += np.einsum("fcg,fc->cg", power, color - color.min(axis=0))
        squares += np.sum(power, axis=0) ** 2
        widths += 0.5 * size * np.sum(power**2, axis=0)
    duration = energy**2 / np.asarray(sum(np.sum(one**4, axis=0) for one in v))  # samples
    count = np.maximum(1.0, duration * squares / widths)
    return np.asarray(systematic * count)
