"""The result of an identification, and its versioned JSON form.

`Result` is what ``result.json`` holds (schema ``stoop-result/2``, described in ``docs/result-schema.md``).
Traces are the curves of its maneuvers, which the JSON does not carry.
This module needs NumPy only, so that reading a result is cheap.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import MISSING, dataclass, field, fields, is_dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal, TypeAlias, cast, get_args, get_origin, get_type_hints

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.base.files import write_file
from stoop.base.notices import AS_SENTENCES, Notice, as_notice, of_severity
from stoop.base.numbers import count, window
from stoop.base.text import printable
from stoop.base.toml import is_of_type, parse_json, read_source
from stoop.errors import StoopError
from stoop.results.decisions import DecisionRecord
from stoop.results.extensions import ExtensionTests, ResponseMisfit
from stoop.results.modes import ConditionModes
from stoop.results.uncertainty import (
    COMPONENTS,
    Components,
    IdentifiabilityAnalysis,
    MethodIntervals,
    Repeatability,
)
from stoop.results.verdict import Verdict

if TYPE_CHECKING:
    import pandas as pd

Role: TypeAlias = Literal["fit", "validation"]

SCHEMA: Final = "stoop-result/2"
READABLE: Final = ("stoop-result/1", SCHEMA)  #: the first had errors that were not those of its covariance
NAN: Final = math.nan
MAX_BYTES: Final = 2**24  #: of a file
#: process noise by method, in files that hold it in a notice
FILTERS: Final[Mapping[str, Mapping[str, Any]]] = {
    "filter-error": {"gain": "steady"},
    "filter-error-ekf": {"gain": "varying"},
    "stabilized-output-error": {"gain": "steady", "share": 0.01},
}
#: relative, of squares of standard errors and sums of components from the covariance
TOLERANCE: Final = 1e-12
MIN_SIGNAL_TO_NOISE: Final = 1.0  #: of a channel's motion; below it chance decides between models


@dataclass(frozen=True)
class ParameterEstimate:
    """One estimated parameter; a number that does not exist is NaN (``null`` in JSON)."""

    estimate: float  #: in `unit`, as its standard error and 95 % confidence interval
    std_error: float = NAN
    ci95_lower: float = NAN
    ci95_upper: float = NAN
    bound_lower: float = -math.inf  #: the box that was searched, `unit`; infinite where unbounded
    bound_upper: float = math.inf
    at_bound: bool = False  #: the estimate lies on the box: the number is the box's, not the flight's
    identifiable: bool = True  #: false when the data do not determine the parameter; it has no interval then
    unit: str = "1"  #: ``"1"`` for a pure number
    prior_mean: float = NAN  #: the prior used in the fit, `unit`; NaN without one
    prior_std: float = NAN
    start: float = NAN  #: the vehicle file's value, `unit`, from which the search began


@dataclass(frozen=True, eq=False)
class Covariance:
    """Covariance of the parameters: `matrix` (k, k) in the products of the parameters' units."""

    names: tuple[str, ...]
    matrix: FloatArray


@dataclass(frozen=True, eq=False)
class NoiseCovariance:
    """Covariance of the measurement noise of the channels that were measured.

    Rows without a variance are left out: of channels that were never measured, which files of older versions hold too.
    """

    channels: tuple[str, ...]
    matrix: FloatArray  #: (ny, ny), in the products of the channels' units
    #: residuals that say as much as one independent one: factor on the covariance where readings are weighed
    inflation: float = 1.0

    def __post_init__(self) -> None:
        known = np.isfinite(np.diag(self.matrix)) if self.matrix.ndim == 2 else np.ones(0, dtype=np.bool_)
        if len(known) == len(self.channels) and not known.all():
            channels = (name for name, own in zip(self.channels, known.tolist(), strict=True) if own)
            object.__setattr__(self, "channels", tuple(channels))
            object.__setattr__(self, "matrix", self.matrix[np.ix_(known, known)])

    def of(self, channels: Sequence[str]) -> FloatArray:
        """Return the covariance (n, n) of other channels; a channel that was never measured has the variance NaN."""
        out = np.diag(np.full(len(channels), np.nan))
        held = [i for i, name in enumerate(channels) if name in self.channels]
        own = [self.channels.index(channels[i]) for i in held]
        out[np.ix_(held, held)] = self.matrix[np.ix_(own, own)]
        return out


@dataclass(frozen=True)
class ProcessNoise:
    """White accelerations with which a filter disturbs the model, beside the gusts of the vehicle file."""

    #: gain of the filter, see :mod:`stoop.estimate.filter_gains`; ``"none"`` of a method without a filter
    gain: Literal["none", "steady", "varying"] = "none"
    states: tuple[str, ...] = ()  #: that are disturbed
    intensities: tuple[float, ...] = ()  #: of each state, per root second (m/s, rad/s)
    share: float = 0.0  #: of the usual intensities where they are stated and not estimated, else 0

    @property
    def filtered(self) -> bool:
        """Whether a filter corrects the model with each measurement."""
        return self.gain != "none"


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
    notes: tuple[Notice, ...] = field(default=(), metadata=AS_SENTENCES)


@dataclass(frozen=True)
class TheilShares:
    """Where Theil's inequality comes from; the three shares of the squared error add up to 1."""

    bias: float = NAN  #: an offset: the means differ
    variance: float = NAN  #: a wrong amplitude: the standard deviations differ
    covariance: float = NAN  #: what does not correlate: noise, phase, missing physics; ideally all of it


@dataclass(frozen=True)
class Whiteness:
    """Whether residuals are white, by the statistic of Ljung and Box."""

    autocorrelation: float = NAN  #: between neighboring samples (lag 1); NaN where no two are neighbors
    statistic: float = NAN  #: Q; chi-square with `lags` degrees of freedom if the residuals are white
    #: how many autocorrelations it sums, those of lags that occur; 0 where there are too few residuals
    lags: int = 0
    p_value: float = NAN  #: chance of a statistic as large from white residuals
    verdict: str = ""  #: ``"white"`` (not rejected at 5 %) or ``"colored"``; empty where there is none


@dataclass(frozen=True)
class BaselineFit:
    """The figures of the trivial model, a first-order lag; its Theil coefficient is `GoodnessOfFit.baseline_theil`."""

    rmse: float = NAN
    r2: float = NAN
    press: float = NAN
    theil_shares: TheilShares = TheilShares()
    whiteness: Whiteness = Whiteness()


@dataclass(frozen=True)
class InnovationFigures:
    """Predictions from sample to sample of a window that was held back from a fit by a filter, of one channel."""

    rms: float = NAN  #: root mean square of the innovations over their expected standard deviation, 1 for a right model
    inside: float = NAN  #: share of them within 1.96 of that, 0.95 for a right model
    whiteness: Whiteness = Whiteness()

    @property
    def known(self) -> bool:
        """Whether there are any: they judge a model in gusts, and a prediction without a filter does not."""
        return math.isfinite(self.rms)


@dataclass(frozen=True)
class GoodnessOfFit:
    """Goodness of fit of one channel in one maneuver."""

    rmse: float  #: the channel's unit; root mean square of measured minus simulated
    #: Theil's inequality coefficient, 0 perfect, 1 worst; channels low-passed at 10 Hz, zero phase
    theil: float
    r2: float  #: coefficient of determination; at most 1, negative when the mean of the data does better
    baseline_theil: float = NAN  #: the same coefficient of a first-order lag, NaN where no lag applies
    #: the channel's unit; root mean square of the residuals had each second of the record been left out of the fit in turn
    #: (PRESS over the number of samples); NaN where nothing was fitted
    press: float = NAN
    #: bias, variance and covariance in the squared error of the curves as they are
    theil_shares: TheilShares = TheilShares()
    whiteness: Whiteness = Whiteness()  #: of the residuals
    baseline: BaselineFit = BaselineFit()  #: the same figures of the first-order lag
    #: 100 (1 - rms error / rms of the measured curve about its mean); negative when the mean does better
    fit_percent: float = NAN
    #: the channel's unit; standard deviation of the measurement noise below 10 Hz, no more than the fit's and the record's own
    noise: float = NAN
    #: rms of the measured motion about its mean, below 10 Hz and without noise, over `noise`
    signal_to_noise: float = NAN
    #: share of the measured samples within the 95 % band of a prediction; NaN for a fitted maneuver
    inside: float = NAN
    innovations: InnovationFigures = InnovationFigures()  #: NaN except in validation of a fit by a filter

    @property
    def within(self) -> float:
        """Share of readings within what is expected: of predictions from sample to sample by a filter, else of the band."""
        return self.innovations.inside if self.innovations.known else self.inside

    @property
    def below_noise(self) -> bool:
        """Whether the motion is smaller than the noise: then no figure of the channel judges a model."""
        return self.signal_to_noise < MIN_SIGNAL_TO_NOISE

    @property
    def compared(self) -> bool:
        """Whether a first-order lag is compared with the model: not where the motion is below the noise.

        Nor where innovations judge it: gusts decide which of two simulations is nearer after seconds.
        """
        return math.isfinite(self.baseline_theil) and not self.below_noise and not self.innovations.known

    @property
    def better(self) -> bool:
        """Whether the model beats a first-order lag."""
        return self.compared and self.theil < self.baseline_theil

    @property
    def lost(self) -> bool:
        """Whether a first-order lag does as well, by more than the noise."""
        behind = self.compared and not self.better
        return behind and self._exceeds_noise(self.rmse * self.rmse - self.baseline.rmse * self.baseline.rmse)

    @property
    def worse_than_mean(self) -> bool:
        """Whether the mean of the record does better, by more than the noise."""
        excess = -self.r2 / (1.0 - self.r2) if self.r2 < 0.0 else 0.0
        return self.r2 < 0.0 and not self.below_noise and self._exceeds_noise(self.rmse * self.rmse * excess)

    def _exceeds_noise(self, excess: float) -> bool:
        """Whether so much more squared error than a trivial model's, which has its bias from this very window, is no chance.

        White residuals are noise alone.
        """
        return self.whiteness.verdict != "white" and not excess <= self.noise * self.noise


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

    @property
    def window(self) -> str:
        """``FLIGHT START:STOP``."""
        return f"{self.flight} {self.start:g}:{self.stop:g}"

    @property
    def title(self) -> str:
        """Such as ``flight2, 140–145 s``."""
        return f"{self.flight}, {window(self.start, self.stop)}"


@dataclass(frozen=True, eq=False)
class Result:
    """What ``result.json`` holds; see ``docs/result-schema.md`` for every key."""

    parameters: Mapping[str, ParameterEstimate]  #: the free parameters, in the order of the covariance
    covariance: Covariance  #: its diagonal holds the squares of the standard errors
    noise_covariance: NoiseCovariance
    initial_states: tuple[InitialState, ...]
    biases: tuple[SensorBiases, ...]
    wind: tuple[WindEstimate, ...]
    maneuvers: tuple[ManeuverResult, ...]
    #: the least cost with the final noise covariance; whole-trajectory equivalents; wall-clock time
    cost: float
    trajectories: float
    seconds: float
    seed: int
    optimizer: str
    status: str  #: how the search ended, and what to change if it ended badly
    advice: str = ""
    #: findings about the data and the fit. Those of severity ``"warning"`` make the result doubtful, the most serious first;
    #: the others say what the figures rest on. `result.json` also holds the warnings as sentences
    notices: tuple[Notice, ...] = ()
    versions: Mapping[str, str] = field(default_factory=dict)  #: package name to version
    inputs: Mapping[str, str] = field(default_factory=dict)  #: file name to the SHA-256 of its content
    method: str = "output-error"  #: of identification, see :func:`stoop.estimate.methods.names`
    modes: tuple[ConditionModes, ...] = ()  #: natural modes at the fitted flight conditions
    repeatability: Repeatability = field(default_factory=Repeatability)  #: empty unless it was asked for
    #: by method: ``corrected``, ``cramer_rao``, and what was asked for of ``bootstrap``, ``posterior``, ``profile``
    uncertainty: Mapping[str, MethodIntervals] = field(default_factory=dict)
    #: of the covariance; empty in files of older versions
    components: Components = field(default_factory=Components)
    #: which of them to trust and why; sentences in the JSON
    trust: tuple[Notice, ...] = field(default=(), metadata=AS_SENTENCES)
    identifiability: IdentifiabilityAnalysis = field(default_factory=IdentifiabilityAnalysis)
    #: what the data ask for beside the model
    extensions: ExtensionTests = field(default_factory=ExtensionTests)
    #: of the rates to the inputs that move, where the flights show them
    response_misfits: tuple[ResponseMisfit, ...] = ()
    #: decisions that the fit took by itself; empty in files of older versions
    decisions: tuple[DecisionRecord, ...] = ()
    verdict: Verdict = field(default_factory=Verdict)  #: whether to use the model, for what, and why
    process_noise: ProcessNoise = ProcessNoise()
    #: between innovations of neighboring samples, 0 for a right model; NaN of a method without a filter
    innovation_correlation: float = NAN

    def __post_init__(self) -> None:
        """Refuse standard errors that are not the square roots of the variances; files of version 1 have others."""
        names, diagonal = self.covariance.names, np.diag(self.covariance.matrix).tolist()
        held = self.components.variances
        if unknown := sorted({*held, *self.components.left_out} - {*COMPONENTS}):
            raise ValueError(f"no component is named {unknown[0]!r}")
        known = bool(held) and len(names) == len(diagonal) and {*names} <= {*self.parameters}
        for name, variance in zip(names, diagonal, strict=True) if known else ():
            parts = [own.get(name, NAN) for own in held.values()]
            scale = TOLERANCE * max(variance, *map(abs, parts), 0.0)
            square = self.parameters[name].std_error ** 2
            if math.isfinite(variance) and variance > 0.0 and not abs(square - variance) <= scale:
                raise ValueError(f"std_error of {name} is not that of the covariance")
            if math.isfinite(variance) and not abs(math.fsum(parts) - variance) <= scale:
                raise ValueError(f"components of {name} do not add up to its variance")

    @property
    def free_count(self) -> str:
        """Number of free parameters, and of the initial states and biases that were estimated with them, in words."""
        groups = [one.values for one in self.initial_states] + [one.values for one in self.biases]
        nuisances = sum(map(len, groups))
        return f"{count(len(self.parameters), 'free parameter')} and {count(nuisances, 'nuisance')}"

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
        return printable(f"<Result: {self.free_count}, {self.method}, {self.status}>")

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
        write_file(path, to_json(self))


@dataclass(frozen=True, eq=False)
class ChannelTrace:
    """One channel of a maneuver: measured and simulated, (n,) each, NaN where there is no sample."""

    measured: FloatArray
    simulated: FloatArray
    #: of a prediction, (n,), standard deviation, measurement noise included
    deviation: FloatArray | None = None


@dataclass(frozen=True, eq=False)
class ManeuverTrace:
    """The curves of `result.maneuvers[i]`."""

    #: (n,), s; the log's own clock; segments follow each other with one NaN sample between them
    time: FloatArray
    channels: Mapping[str, ChannelTrace]  #: the observed channels in the order of eq. (2)
    #: (n,) each; what drove the simulation: surfaces, throttle, thrust
    inputs: Mapping[str, FloatArray] = field(default_factory=dict)
    #: (n,) each; the first-order lag's curve for the channels that have one
    baseline: Mapping[str, FloatArray] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class AirDataTrace:
    """Air data of one whole flight as logged and as reconstructed; every curve is (n,) on `time` (n,), s."""

    flight: str
    time: FloatArray
    curves: Mapping[str, FloatArray]  #: e.g. airspeed_pitot, V, alpha, beta


def to_json(result: Result) -> str:
    """Return `result` as JSON text of schema ``stoop-result/2``; NaN and infinities become ``null``."""
    schema = SCHEMA if result.components.variances else READABLE[0]  # of an older version, saved again
    document = {"schema": schema, **plain(result), "warnings": list(result.warnings)}
    return json.dumps(document, indent=1, allow_nan=False, ensure_ascii=False) + "\n"


def from_json(text: str, where: str = "result") -> Result:
    """Return the result that `text` holds; keys unknown to this version are passed over.

    Parameters
    ----------
    text : str
        JSON of schema ``stoop-result/2`` or 1.
    where : str
        What an error calls the text, normally its file name.

    Raises
    ------
    StoopError
        When the text is no JSON, has another schema, or lacks a key.
    """
    try:
        document = parse_json(text)
    except ValueError as error:
        raise StoopError(
            f"{where}: no JSON that can be read ({error}); name the result.json of stoop identify"
        ) from error
    schema = document.get("schema") if isinstance(document, dict) else None
    if schema not in READABLE:
        raise StoopError(f"{where}: has schema {schema!r}; this version reads {' and '.join(READABLE)}")
    try:
        if "notices" not in document:  # written before notices had codes
            document["notices"] = [as_notice(str(one)).to_dict() for one in document.get("warnings", ())]
        if "process_noise" not in document:  # written when only a notice held it
            found = [one["values"] for one in document["notices"] if one.get("code") == "process-noise"]
            document["process_noise"] = {**FILTERS.get(document.get("method", ""), {}), **dict(*found[:1])}
        return cast("Result", _decode(Result, document))
    except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
        what = f"lacks the key {error}" if isinstance(error, KeyError) else f"is malformed ({error})"
        raise StoopError(f"{where}: {what}; write it again with stoop identify") from error


def read_result(path: Path) -> Result:
    """Return the result that ``stoop identify`` or :meth:`stoop.workflow.FittedModel.save` wrote.

    Parameters
    ----------
    path : Path
        Of ``result.json``.

    Raises
    ------
    StoopError
        When there is no such file or it holds no result.
    """
    return from_json(read_source(path, "result", StoopError, MAX_BYTES, ".json"), str(path))


def plain(value: Any) -> Any:
    """Return dataclasses, mappings, arrays and numbers as JSON's own types; what is not finite becomes None."""
    if isinstance(value, Notice):
        return plain(value.to_dict())
    if is_dataclass(value) and not isinstance(value, type):
        found = {item.name: plain(getattr(value, item.name)) for item in fields(value)}
        for item in (i for i in fields(value) if "sentences" in i.metadata):
            notices, between = getattr(value, item.name) or (), item.metadata["sentences"]
            texts = [str(one) for one in ((notices,) if isinstance(notices, Notice) else notices)]
            found[item.name] = texts if between is None else between.join(texts)
        return found
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value


def _decode(kind: Any, value: Any, default: Any = NAN) -> Any:
    """Return `value` as `kind`: a dataclass, a mapping, a tuple, a matrix, a literal or a scalar.

    What an older file lacks of a dataclass takes its default, where it has one. ``null`` is an unbounded side where infinity
    is the default, else NaN.
    """
    if kind is Notice:
        return Notice.from_dict(value)
    if is_dataclass(kind):
        hints = get_type_hints(kind)
        defaults = {f.name: (f.default, f.default_factory) for f in fields(kind)}
        optional = {name for name, default in defaults.items() if default != (MISSING, MISSING)}
        found: dict[str, Any] = {}
        for f in (f for f in fields(kind) if f.name in value or f.name not in optional):
            given = value[f.name]
            if "sentences" in f.metadata:
                texts = [given] * bool(given) if isinstance(given, str) else given
                notices = tuple(as_notice(text, "info") for text in texts)
                found[f.name] = notices if f.default is not None else next(iter(notices), None)
            else:
                found[f.name] = _decode(hints[f.name], given, f.default)
        return cast("type[Any]", kind)(**found)
    origin, arguments = get_origin(kind), get_args(kind)
    if origin is Mapping:
        return {str(key): _decode(arguments[1], entry) for key, entry in value.items()}
    if origin is tuple:
        kinds = [arguments[0]] * len(value) if arguments[-1] is Ellipsis else arguments
        return tuple(_decode(one, entry) for one, entry in zip(kinds, value, strict=True))
    if origin is np.ndarray:
        numbers = [[_decode(float, entry) for entry in row] for row in value]
        return np.array(numbers, dtype=np.float64).reshape(len(value), len(value))
    if origin is Literal:
        if value not in arguments:
            raise ValueError(f"{value!r} is none of {', '.join(arguments)}")
        return value
    if kind is float and value is None:
        return default if isinstance(default, float) and math.isinf(default) else NAN
    if not is_of_type(value, kind):
        raise ValueError(f"{str(value)[:40]!r} where a {kind.__name__} is expected")
    return kind(value)
