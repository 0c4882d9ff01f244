"""The result of an identification, and its versioned JSON form.

`Result` is what ``result.json`` holds (schema ``stoop-result/1``, described in ``docs/result-schema.md``).
`Identification` is a result together with the traces that the report draws and the JSON does not carry.
This module needs NumPy only, so that reading a result is cheap.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import MISSING, Field, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias, cast, get_args, get_origin, get_type_hints

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.files import write_text_atomic
from stoop.base.notices import Notice, as_notice, from_dict, of_severity
from stoop.errors import StoopError
from stoop.results.goodness_of_fit import BaselineFit, GoodnessOfFit, TheilShares, Whiteness
from stoop.results.modes import ConditionModes, Estimate, MeasuredMode, ModeEstimate
from stoop.results.uncertainty import (
    IdentifiabilityAnalysis,
    MethodIntervals,
    ParameterRepeatability,
    Repeatability,
    SingleEstimate,
)

if TYPE_CHECKING:
    import pandas as pd

__all__ = [
    "AirDataTrace", "BaselineFit", "ChannelTrace", "ConditionModes", "Covariance", "Estimate", "GoodnessOfFit",
    "Identification", "InitialState", "ManeuverResult", "ManeuverTrace", "MeasuredMode", "ModeEstimate",
    "NoiseCovariance", "ParameterEstimate", "ParameterRepeatability", "Quantity", "Repeatability", "Result", "Role",
    "SensorBiases", "SingleEstimate", "TheilShares", "Validation", "Whiteness", "WindEstimate",
    "from_json", "plain", "read_result", "to_json",
]  # fmt: skip

Role: TypeAlias = Literal["fit", "validation"]

SCHEMA: Final = "stoop-result/1"
NAN: Final = math.nan


@dataclass(frozen=True)
class ParameterEstimate:
    """One estimated parameter; a number that does not exist is NaN (``null`` in JSON).

    Attributes
    ----------
    estimate, std_error, ci95_lower, ci95_upper : float, `unit`
        The estimate, its standard error and 95 % confidence interval.
    bound_lower, bound_upper : float, `unit`
        The box that was searched; infinite where unbounded.
    at_bound : bool
        The estimate lies on the box: the number is the box's, not the flight's.
    identifiable : bool
        False when the data do not determine the parameter; it has no interval then.
    unit : str
        ``"1"`` for a pure number.
    prior_mean, prior_std : float, `unit`
        The prior used in the fit; NaN without one.
    start : float, `unit`
        The vehicle file's value, from which the search began.
    """

    estimate: float
    std_error: float = NAN
    ci95_lower: float = NAN
    ci95_upper: float = NAN
    bound_lower: float = -math.inf
    bound_upper: float = math.inf
    at_bound: bool = False
    identifiable: bool = True
    unit: str = "1"
    prior_mean: float = NAN
    prior_std: float = NAN
    start: float = NAN


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariance of the parameters: `matrix` (k, k) in the products of the parameters' units."""

    names: tuple[str, ...]
    matrix: FloatArray


@dataclass(frozen=True, eq=False)
class NoiseCovariance:
    """Covariance of the measurement noise: `matrix` (ny, ny) in the products of the channels' units."""

    channels: tuple[str, ...]
    matrix: FloatArray


@dataclass(frozen=True)
class Quantity:
    """A number with its standard error (NaN when it was not estimated) and unit."""

    estimate: float
    std_error: float = NAN
    unit: str = "1"


@dataclass(frozen=True)
class InitialState:
    """The state at the first sample of segment `segment` of maneuver `maneuver` (both count from 0)."""

    maneuver: int
    segment: int
    time: float  #: s, the log's own clock
    values: Mapping[str, Quantity]


@dataclass(frozen=True)
class SensorBiases:
    """Sensor biases of maneuver `maneuver` (counts from 0), shared by its segments; by channel name."""

    maneuver: int
    values: Mapping[str, Quantity]


@dataclass(frozen=True)
class WindEstimate:
    """Steady wind and pitot calibration of one flight, by flight-path reconstruction.

    `values` holds ``wind_n``, ``wind_e`` (m/s, the velocity of the air over ground), ``pitot_scale`` (1),
    ``pitot_offset`` (m/s; true airspeed = scale * (reading - offset)) and whatever else was reconstructed;
    `residual_rms` is in m/s.
    """

    flight: str
    values: Mapping[str, Quantity]
    residual_rms: float = NAN
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class ManeuverResult:
    """One fitted or predicted maneuver; times in seconds of the log's own clock."""

    flight: str
    start: float
    stop: float
    role: Role
    segments: tuple[tuple[float, float], ...]
    channels: Mapping[str, GoodnessOfFit]
    loading: str = ""  #: of the vehicle file, as it was flown; empty where none was named


@dataclass(frozen=True, eq=False)
class Result:
    """What ``result.json`` holds; see ``docs/result-schema.md`` for every key.

    Attributes
    ----------
    parameters : mapping of str to ParameterEstimate
        The free parameters, in the order of the covariance.
    cost, trajectories, seconds : float
        The least cost with the final noise covariance; whole-trajectory equivalents; wall-clock time.
    status, advice : str
        How the search ended, and what to change if it ended badly.
    notices : tuple of Notice
        Findings about the data and the fit. Those of severity ``"warning"`` make the result doubtful, the most serious
        first; the others say what the figures rest on. `result.json` also holds the warnings as sentences.
    versions : mapping of str to str
        Package name to version.
    inputs : mapping of str to str
        File name to the SHA-256 of its content.
    modes : tuple of ConditionModes
        Natural modes at the fitted flight conditions.
    repeatability : Repeatability
        Empty unless it was asked for.
    uncertainty : mapping of str to MethodIntervals
        By method: ``corrected``, ``cramer_rao``, and what was asked for of ``bootstrap``, ``posterior``, ``profile``.
    trust : tuple of str
        Which of them to trust and why, one sentence each.
    identifiability : IdentifiabilityAnalysis
    """

    parameters: Mapping[str, ParameterEstimate]
    covariance: Covariance
    noise_covariance: NoiseCovariance
    initial_states: tuple[InitialState, ...]
    biases: tuple[SensorBiases, ...]
    wind: tuple[WindEstimate, ...]
    maneuvers: tuple[ManeuverResult, ...]
    cost: float
    trajectories: float
    seconds: float
    seed: int
    optimizer: str
    status: str
    advice: str = ""
    notices: tuple[Notice, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)
    inputs: Mapping[str, str] = field(default_factory=dict)
    method: str = "output-error"  #: of identification, see :func:`stoop.estimate.methods.names`
    modes: tuple[ConditionModes, ...] = ()
    repeatability: Repeatability = field(default_factory=Repeatability)
    uncertainty: Mapping[str, MethodIntervals] = field(default_factory=dict)
    trust: tuple[str, ...] = ()
    identifiability: IdentifiabilityAnalysis = field(default_factory=IdentifiabilityAnalysis)

    @property
    def warnings(self) -> tuple[str, ...]:
        """The sentences of the notices that make the result doubtful."""
        return tuple(map(str, of_severity(self.notices, "warning")))

    @property
    def basis(self) -> tuple[Notice, ...]:
        """What the figures rest on: information about the vehicle, the fit and its assessment."""
        found = of_severity(self.notices, "info")
        return tuple(one for one in found if one.topic in ("vehicle", "fit", "assessment"))

    @property
    def data_notices(self) -> tuple[Notice, ...]:
        """What was found in the data: information about logs, mappings and flights."""
        found = of_severity(self.notices, "info")
        return tuple(one for one in found if one.topic in ("log", "mapping", "flight"))

    def to_dataframe(self) -> pd.DataFrame:
        """Return one row for each parameter, indexed by its name."""
        from stoop.results.labelled import to_dataframe

        return to_dataframe(self)

    def __repr__(self) -> str:
        """Return the size and status on one line."""
        return f"<Result: {len(self.parameters)} parameters, {self.method}, {self.status}>"

    def _repr_html_(self) -> str:
        from stoop.results.labelled import html_table

        return html_table(self)

    def to_json(self) -> str:
        """Return the result as JSON text; NaN and infinities become ``null``."""
        return to_json(self)

    def save(self, path: Path) -> None:
        """Write ``result.json`` whole or not at all.

        Raises
        ------
        OutputError
            When the file cannot be written.
        """
        write_text_atomic(path, to_json(self))


@dataclass(frozen=True, eq=False)
class ChannelTrace:
    """One channel of a maneuver: measured and simulated, (n,) each, NaN where there is no sample."""

    measured: FloatArray
    simulated: FloatArray


@dataclass(frozen=True, eq=False)
class ManeuverTrace:
    """The curves of `result.maneuvers[i]`.

    Attributes
    ----------
    time : (n,), s
        The log's own clock; segments follow each other with one NaN sample between them.
    channels : mapping of str to ChannelTrace
        The observed channels in the order of eq. (2).
    inputs : mapping of str to (n,)
        What drove the simulation: surfaces, throttle, thrust.
    baseline : mapping of str to (n,)
        The first-order lag's curve for the channels that have one.
    """

    time: FloatArray
    channels: Mapping[str, ChannelTrace]
    inputs: Mapping[str, FloatArray] = field(default_factory=dict)
    baseline: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class AirDataTrace:
    """Air data of one whole flight as logged and as reconstructed; every curve is (n,) on `time` (n,), s."""

    flight: str
    time: FloatArray
    curves: Mapping[str, FloatArray]  #: e.g. airspeed_pitot, V, alpha, beta


@dataclass(frozen=True, eq=False)
class Identification:
    """A result and what the report needs beside it.

    Attributes
    ----------
    result : Result
        The numbers.
    traces : tuple of ManeuverTrace
        One for each of ``result.maneuvers``, same order.
    vehicle : str
        The vehicle's name.
    equations : tuple of str
        LaTeX of the coefficient equations and whatever else was fitted.
    convergence : (k, 2)
        Trajectories spent and the best cost so far.
    units : mapping of str to str
        Unit of every channel and input drawn; rad, rad/s are drawn in degrees.
    symbols : mapping of str to str
        LaTeX symbol of a parameter or channel; its plain name is used where there is none.
    air_data : tuple of AirDataTrace
        One per flight whose air data were reconstructed.
    command : str
        The command line that made this.
    """

    result: Result
    traces: tuple[ManeuverTrace, ...]
    vehicle: str
    equations: tuple[str, ...] = ()
    convergence: FloatArray = field(default_factory=lambda: np.empty((0, 2)))
    units: Mapping[str, str] = field(default_factory=dict)
    symbols: Mapping[str, str] = field(default_factory=dict)
    air_data: tuple[AirDataTrace, ...] = ()
    command: str = ""


def to_json(result: Result) -> str:
    """Return `result` as JSON text of schema ``stoop-result/1``; NaN and infinities become ``null``."""
    document = {"schema": SCHEMA, **plain(result), "warnings": list(result.warnings)}
    return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def from_json(text: str, where: str = "result") -> Result:
    """Return the result that `text` holds; keys unknown to this version are passed over.

    Parameters
    ----------
    text : str
        JSON of schema ``stoop-result/1``.
    where : str
        What an error calls the text, normally its file name.

    Raises
    ------
    StoopError
        When the text is no JSON, has another schema, or lacks a key.
    """
    document = _document(text, where)
    try:
        if "notices" not in document:  # written before notices had codes
            document["notices"] = [as_notice(str(one)).to_dict() for one in document.get("warnings", ())]
        return cast("Result", _build(Result, document))
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        what = f"lacks the key {error}" if isinstance(error, KeyError) else f"is malformed ({error})"
        raise StoopError(f"{where}: {what}; write it again with stoop identify") from error


def read_result(path: Path) -> Result:
    """Return the result in the file `path`.

    Raises
    ------
    StoopError
        When there is no such file or it holds no result.
    """
    try:
        text = Path(path).read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise StoopError(f"{path}: cannot be read; name the result.json of stoop identify") from error
    return from_json(text, str(path))


def plain(value: Any) -> Any:
    """Return dataclasses, mappings, arrays and numbers as JSON's own types; what is not finite becomes None."""
    if isinstance(value, Notice):
        return plain(value.to_dict())
    if is_dataclass(value) and not isinstance(value, type):
        return {item.name: plain(getattr(value, item.name)) for item in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value


def _document(text: str, where: str) -> dict[str, Any]:
    try:
        document = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise StoopError(f"{where}: is no JSON; name the result.json of stoop identify") from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema != SCHEMA:
        raise StoopError(f"{where}: has schema {schema!r}; this version reads {SCHEMA!r}")
    return cast("dict[str, Any]", document)


def _build(kind: type[Any], value: Mapping[str, Any]) -> Any:
    """Return the dataclass `kind` from a JSON object; what an older file lacks takes its default, where it has one."""
    hints = get_type_hints(kind)
    there = [item for item in fields(kind) if item.name in value or not _optional(item)]
    return kind(**{item.name: _decode(hints[item.name], value[item.name], item) for item in there})


def _optional(item: Field[Any]) -> bool:
    return item.default is not MISSING or item.default_factory is not MISSING


def _decode(kind: Any, value: Any, item: Field[Any] | None = None) -> Any:
    """Return `value` as `kind`: a dataclass, a mapping, a tuple, a matrix, a literal or a scalar."""
    if kind is Notice:
        return from_dict(value)
    if is_dataclass(kind):
        return _build(cast("type[Any]", kind), value)
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Mapping:
        return {str(key): _decode(arguments[1], entry) for key, entry in value.items()}
    if origin is tuple and arguments[-1] is Ellipsis:
        return tuple(_decode(arguments[0], entry) for entry in value)
    if origin is tuple:
        return tuple(_decode(a, entry) for a, entry in zip(arguments, value, strict=True))
    if origin is np.ndarray:
        return _matrix(value)
    if origin is Literal and value not in arguments:
        raise ValueError(f"{value!r} is none of {', '.join(arguments)}")
    if kind is float:
        return _missing(item) if value is None else float(value)
    return value if origin is Literal else kind(value)


def _missing(item: Field[Any] | None) -> float:
    """Return what ``null`` means: an unbounded side where that is the field's default, else NaN."""
    default = item.default if item is not None else NAN
    return default if isinstance(default, float) and math.isinf(default) else NAN


def _matrix(rows: list[list[Any]]) -> FloatArray:
    numbers = [[NAN if entry is None else float(entry) for entry in row] for row in rows]
    return np.array(numbers, dtype=np.float64).reshape(len(rows), len(rows))


VALIDATION_SCHEMA: Final = "stoop-validation/1"  #: see ``docs/validation.md``


@dataclass(frozen=True, eq=False)
class Validation:
    """A fitted model against flights that it was not fitted to.

    Attributes
    ----------
    vehicle : str
        Its name.
    result : str
        SHA-256 of the ``result.json`` that was validated.
    maneuvers : tuple of ManeuverResult
        With the same figures as in ``result.json``.
    compared, better : int
        Channels that have a figure of the trivial model, and in how many of them the model beats it.
    warnings, notes : tuple of str
        Plain words: what is doubtful, and what was found while preparing the data.
    versions, inputs : mapping of str to str
        As in ``result.json``.
    command : str
        How it was made.
    """

    vehicle: str
    result: str
    maneuvers: tuple[ManeuverResult, ...]
    compared: int
    better: int
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    versions: Mapping[str, str]
    inputs: Mapping[str, str]
    command: str = ""

    def to_json(self) -> str:
        """Return the validation as JSON text; NaN and infinities become ``null``."""
        document = {"schema": VALIDATION_SCHEMA, **plain(self)}
        return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"
