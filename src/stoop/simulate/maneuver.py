"""Maneuver files: what the pilot does, as a small TOML.

::

    format = "stoop-maneuver/1"
    duration = 30.0            # s
    rate = 100.0               # Hz
    airspeed = 35.0            # m/s; the vehicle's V* when left out
    altitude = 200.0           # m

    [[input]]
    control = "elevator"
    shape = "3-2-1-1"          # or doublet, pulse, multisine
    start = 1.0                # s
    step = 0.3                 # s
    amplitude = 0.2            # rad

    [noise]                    # standard deviations; the vehicle file's where left out
    V = 0.3
"""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from stoop.errors import ManeuverError

FloatArray = NDArray[np.float64]
MAX_SAMPLES = 5_000_000


class _Table(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class Steps(_Table):
    """A row of steps of alternating sign, each a whole number of ``step`` long."""

    control: str
    shape: Literal["3-2-1-1", "doublet", "1-1", "2-1-1"]
    start: float = Field(ge=0.0)
    step: float = Field(gt=0.0)
    amplitude: float


class Pulse(_Table):
    """One pulse."""

    control: str
    shape: Literal["pulse"]
    start: float = Field(ge=0.0)
    duration: float = Field(gt=0.0)
    amplitude: float


class Multisine(_Table):
    """Equal-power harmonics with Schroeder phases (IEEE Trans. Inf. Theory 16(1), 1970), low peak factor.

    Harmonics ``first``, ``first + stride``, ... of 1/duration up to ``band`` Hz: different ``first`` with one
    ``stride`` make inputs on several controls orthogonal.
    """

    control: str
    shape: Literal["multisine"]
    start: float = Field(ge=0.0)
    duration: float = Field(gt=0.0)
    amplitude: float
    band: float = Field(gt=0.0)
    first: int = Field(default=1, ge=1)
    stride: int = Field(default=1, ge=1)

    @model_validator(mode="after")
    def _has_harmonics(self) -> Multisine:
        if self.first / self.duration > self.band:
            raise ValueError(
                f"no harmonic of 1/{self.duration:g} s lies below {self.band:g} Hz; raise band or duration"
            )
        return self


Input = Annotated[Steps | Pulse | Multisine, Field(discriminator="shape")]


class Maneuver(_Table):
    """A maneuver flown from trim."""

    format: Literal["stoop-maneuver/1"] = "stoop-maneuver/1"
    duration: float = Field(gt=0.0, le=36000.0)
    rate: float = Field(default=100.0, gt=0.0, le=10000.0)
    airspeed: float | None = Field(default=None, gt=0.0)
    altitude: float = 200.0
    input: tuple[Input, ...] = ()
    noise: dict[str, float] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _bounded(self) -> Maneuver:
        if self.duration * self.rate > MAX_SAMPLES:
            raise ValueError(f"duration times rate exceeds {MAX_SAMPLES} samples")
        if any(not s >= 0.0 for s in self.noise.values()):
            raise ValueError("noise must be standard deviations, zero or above")
        return self

    @property
    def time(self) -> FloatArray:
        """Sample times, s."""
        return np.arange(round(self.duration * self.rate) + 1) / self.rate

    def deflections(self) -> dict[str, FloatArray]:
        """Return the change of each control from trim over :attr:`time`, rad."""
        out: dict[str, FloatArray] = {}
        for spec in self.input:
            signal = _SHAPES[spec.shape](spec, self.time)
            out[spec.control] = out.get(spec.control, np.zeros_like(signal)) + signal
        return out


_PATTERNS = {"3-2-1-1": (3, 2, 1, 1), "doublet": (1, 1), "1-1": (1, 1), "2-1-1": (2, 1, 1)}
_EDGE = 1e-9  #: s, so that a step falls on the sample it names


def _steps(spec: Any, t: FloatArray) -> FloatArray:
    out, begin, sign = np.zeros_like(t), spec.start, 1.0
    for units in _PATTERNS[spec.shape]:
        end = begin + units * spec.step
        out[(t >= begin - _EDGE) & (t < end - _EDGE)] = sign * spec.amplitude
        begin, sign = end, -sign
    return out


def _pulse(spec: Any, t: FloatArray) -> FloatArray:
    inside = (t >= spec.start - _EDGE) & (t < spec.start + spec.duration - _EDGE)
    return np.where(inside, spec.amplitude, 0.0)


def _multisine(spec: Any, t: FloatArray) -> FloatArray:
    harmonics = np.arange(spec.first, int(spec.band * spec.duration) + 1, spec.stride)
    phases = -np.pi * np.arange(harmonics.size) * (np.arange(harmonics.size) + 1) / harmonics.size
    tau = t - spec.start
    waves = np.sin(2.0 * np.pi * np.outer(tau, harmonics) / spec.duration + phases).sum(axis=1)
    inside = (tau >= -_EDGE) & (tau < spec.duration - _EDGE)
    return np.asarray(
        np.where(inside, spec.amplitude * waves / max(float(np.max(np.abs(waves))), 1e-12), 0.0)
    )


_SHAPES: dict[str, Callable[[Any, FloatArray], FloatArray]] = {
    **dict.fromkeys(_PATTERNS, _steps),
    "pulse": _pulse,
    "multisine": _multisine,
}


def load_maneuver(path: Path | str) -> Maneuver:
    """Read a maneuver file.

    Raises
    ------
    ManeuverError
        One line naming the file, the key and the fix.
    """
    path = Path(path)
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not UTF-8 text"
        raise ManeuverError(f"{path}: cannot read the maneuver file ({reason}); check the path") from None
    return parse_maneuver(text, str(path))


def parse_maneuver(text: str, where: str) -> Maneuver:
    """Read a maneuver from TOML text; ``where`` names it in messages."""
    try:
        return Maneuver.model_validate(tomllib.loads(text))
    except (tomllib.TOMLDecodeError, RecursionError) as error:
        raise ManeuverError(f"{where}: not valid TOML: {error}; mend that line") from None
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(str(p) for p in first["loc"])
        raise ManeuverError(f"{where}: {key}: {first['msg'].removeprefix('Value error, ')}") from None
