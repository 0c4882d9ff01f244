"""Bode plots: magnitude, phase and coherence of flights with their random error, and those of a model with its band."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from stoop.base.arrays import BoolArray, ComplexArray, FloatArray
from stoop.base.units import DEGREE
from stoop.flight.frequency_responses import FrequencyResponse, decibels
from stoop.report.plots import strip_pictures
from stoop.report.series import Series, Strip, looks_of
from stoop.report.sheet import Panel


class _Modeled(Protocol):
    """Response of a model to an input over rising frequencies, rad/s, with half widths of its 95 % band (dB, rad)."""

    @property
    def frequency(self) -> FloatArray: ...
    @property
    def response(self) -> ComplexArray: ...
    @property
    def magnitude_half_width(self) -> FloatArray: ...
    @property
    def phase_half_width(self) -> FloatArray: ...


Pair = tuple[FrequencyResponse, _Modeled | None]


def response_panels(pairs: Sequence[Pair], max_error: float, min_coherence: float = 0.0) -> list[Panel]:
    """Return a Bode plot of each response, drawn where its coherence and its relative random error allow."""
    groups = []
    for one, model in pairs:
        good = (one.bound < max_error) & (one.coherence >= min_coherence)
        groups.append((_strips(one, model, good), f"Response of {one.output} to {one.input}"))
    looks = looks_of([series for strips, _ in groups for strip in strips for series in strip.series])
    frequencies = [one.frequency for one, _ in pairs]
    ends = min(float(w[0]) for w in frequencies), max(float(w[-1]) for w in frequencies)
    drawn = strip_pictures(groups, looks, ends, "rad/s", log_x=True)
    titles = [f"{one.output} over {one.input}" for one, _ in pairs]
    return [Panel(title, picture) for title, picture in zip(titles, drawn, strict=True)]


def _strips(one: FrequencyResponse, model: _Modeled | None, good: BoolArray) -> tuple[Strip, ...]:
    x, band = one.frequency, np.where(good, one.bound, np.nan)
    gain = np.where(good, decibels(one.response), np.nan)
    phase = np.full(len(x), np.nan)
    phase[good] = np.unwrap(np.angle(one.response[good])) / DEGREE
    with np.errstate(invalid="ignore"):
        angle = np.arcsin(np.minimum(band, 1.0)) / DEGREE
    flown = "flight" if model is not None else "response"
    magnitude = [Series(flown, x, gain, role="fit", half_width=20.0 * np.log10(1.0 + band))]
    phases = [Series(flown, x, phase, role="fit", half_width=angle)]
    if model is not None:
        inside = (model.frequency >= x[0]) & (model.frequency <= x[-1])
        w = model.frequency[inside]
        turned = np.unwrap(np.angle(model.response)) / DEGREE
        if good.any():
            first = int(np.flatnonzero(good)[0])
            turned += 360.0 * np.round((phase[first] - np.interp(x[first], model.frequency, turned)) / 360.0)
        levels, widths = decibels(model.response)[inside], model.magnitude_half_width[inside]
        turns, angles = turned[inside], model.phase_half_width[inside] / DEGREE
        magnitude.insert(0, Series("model", w, levels, role="lag", half_width=widths))
        phases.insert(0, Series("model", w, turns, role="lag", half_width=angles))
    coherence = Series("coherence", x, one.coherence, role="residual")
    third = Strip("coherence", (coherence,), y_range=(0.0, 1.0))
    return Strip("dB", tuple(magnitude)), Strip("phase, deg", tuple(phases)), third
