"""Frequency responses of flights in one call, beside those of a model: bandwidths and low-order equivalent systems."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from stoop import FittedModel, Flight, Notice, Vehicle, trim
from stoop.extend import motion
from stoop.extend.arrays import BoolArray, FloatArray, run_slices
from stoop.extend.errors import FlightError, SimulationError, StoopError
from stoop.extend.files import by_name
from stoop.extend.fits import NORMAL_95, Result, model_or_vehicle, takes_model_or_vehicle
from stoop.extend.flights import (
    Flights,
    FrequencyResponse,
    Stretch,
    Window,
    Windows,
    as_flights,
    moves,
)
from stoop.extend.notices import notice
from stoop.extend.text import nearest, within_limits
from stoop.extend.variables import FAMILIES, VARIABLES
from stoop_analysis.frequency import (
    AXES,
    MIN_COHERENCE,
    Figures,
    FrequencyAnalysis,
    ModelResponse,
    UncertainModel,
    known,
    uncertain_model,
)
from stoop_analysis.handling import FORMS, Known, bandwidth, equivalent_system, flight_draws

DRIVERS: Final = {
    "roll": ("aileron", "control_roll"), "pitch": ("elevator", "control_pitch"), "yaw": ("rudder", "control_yaw"),
    "heave": ("control_throttle",),
}  #: axis -> controls  # fmt: skip
OUTPUTS: Final = ("p", "q", "r", "ax", "ay", "az")
ATTITUDES: Final = {"q": "theta", "p": "phi"}  #: attitude of which a rate is nearly the derivative
MIN_MOVEMENT: Final = 0.02  #: standard deviation of an input, of that of the largest
MODEL_BAND: Final = (0.1, 60.0)  #: rad/s
MODEL_POINTS: Final = 300
#: rad/s, of a model's equivalent system if no flight is known; bandwidths lie above its low end
FIT_BAND: Final = (1.0, 10.0)


@dataclass(frozen=True, eq=False)
class AxisCommands:
    """Rotor channels as accelerations about a steady flight, after all lags: those that they command, and how."""

    channels: tuple[str, ...]
    effect: FloatArray  #: (4, m), accelerations `AXES` per unit of each channel
    mixing: FloatArray  #: (m, 4), the smallest channels that command one unit of an acceleration alone


def axis_commands(
    vehicle: Vehicle, start: Mapping[str, float | FloatArray], inputs: FloatArray
) -> AxisCommands:
    """Return the axes that the rotors of a vehicle command about a state and channels (n_u,); see :func:`effects`.

    Raises
    ------
    SimulationError
        They do not command all four, each apart from the others.
    """
    effect = vehicle.rotor_effects(start, inputs, {})
    return AxisCommands(vehicle.rotor_range.names, effect, vehicle.rotor_allocation(effect))


@takes_model_or_vehicle
def frequency(
    model: FittedModel | Vehicle,
    flights: Flights,
    maneuvers: Windows = (),
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    band: tuple[float, float] | None = None,
) -> FrequencyAnalysis:
    """Estimate frequency responses of flights, beside those of a model; see :func:`stoop.frequency_responses`."""
    return frequency_responses(flights, maneuvers, model, inputs, outputs, band)


def frequency_responses(
    flights: Flights,
    maneuvers: Windows = (),
    model: FittedModel | Vehicle | str | Path | None = None,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    band: tuple[float, float] | None = None,
) -> FrequencyAnalysis:
    """Estimate frequency responses of outputs to inputs that may move together, beside those of a model.

    Those of a model are at the flown speed, altitude and density.

    Parameters
    ----------
    flights : Flight, path of a log, table or dataset, or a sequence of them
    maneuvers : windows, optional
        Those that the model was fitted to when absent, else the airborne part; nothing is estimated across their ends.
    model : FittedModel, the folder of one, Vehicle, built-in vehicle or vehicle file, optional
        Of a fitted model the responses have a 95 % band.
    inputs : sequence of str, optional
        Controls of the model (deflections, rad), axes that its rotors command (rad/s2, m/s2), or channels; those that move when
        absent. Without a model the inputs are the commands of the axes.
    outputs : sequence of str, optional
        Channels; rates and specific forces when absent.
    band : (low, high), rad/s, optional

    Returns
    -------
    FrequencyAnalysis
        ``responses`` (with ``frequency``, ``response``, ``coherence``, ``bound``), ``model``, ``figures`` (bandwidth, phase
        delay, low-order equivalent systems), ``notices``; ``to_xarray()`` gives labeled arrays.

    Raises
    ------
    FlightError
        An input is unknown or does not move, an output is unknown, or the windows are too short.
    """
    if band is not None:
        low, high = within_limits("band", band, 2)
        band = low, high
    flights = as_flights(flights)
    named = by_name(flights, "frequency")
    found_model = None if model is None else model_or_vehicle(model)
    fitted = found_model if isinstance(found_model, FittedModel) else None
    vehicle = fitted.vehicle if fitted else found_model if isinstance(found_model, Vehicle) else None
    result = fitted.result if fitted else None
    own = [w for w in fitted.windows() if w.flight in named] if fitted else []
    windows = Window.several(maneuvers, named) or tuple(own)
    masks = {f.name: Window.within(f, [w for w in windows if w.flight == f.name]) & True for f in flights}
    for window in windows:
        time = named[window.flight].time
        if window.start > time[-1] or window.stop < time[0]:
            raise FlightError(
                f"{window} lies outside the record, {time[0]:.1f} to {time[-1]:.1f} s; choose a window within it"
            )
    if not windows:
        masks = {f.name: f.flying() for f in flights}
        windows = tuple(
            Window(f.name, float(f.time[r.start]), float(f.time[r.stop - 1]))
            for f in flights
            for r in run_slices(masks[f.name])
        )
    steady = None if vehicle is None else steady_model(flights, masks, vehicle)
    columns = [_columns(f, vehicle, inputs, steady) for f in flights]
    names, notices = moving_inputs(columns, [masks[f.name] for f in flights], inputs)
    shared = [n for n in flights[0].channels if all(n in f.names for f in flights)]
    for name in outputs:
        if name not in shared:
            raise FlightError(f"--channel {name}: no such channel of the flights; {nearest(name, shared)}")
    wanted = list(outputs) or [n for n in OUTPUTS if n in shared]
    stretches = [
        _stretch(f, f.between(w.start, w.stop), one, names, wanted)
        for f, one in zip(flights, columns, strict=True)
        for w in windows
        if w.flight == f.name
    ]
    responses = FrequencyResponse.estimate(stretches, names, wanted, band)
    if not responses:
        raise FlightError(_too_short(stretches, names, wanted, band))
    missing = [o for o in wanted if o not in {r.output for r in responses}]
    notices += [notice("frequency-output-missing", outputs=tuple(missing))] if missing else []
    notices += _unknown_axes(responses)
    modeled, found = ({}, []) if steady is None else _modeled(steady, result, names, wanted)
    notices += [*found, *(fitted.refusal if fitted else [])]
    condition = {} if steady is None else steady.condition
    figures = _figures(responses, modeled)
    return FrequencyAnalysis(
        tuple(named), windows, tuple(names), tuple(wanted), tuple(responses), modeled, tuple(figures), condition,
        tuple(notices),
    )  # fmt: skip


def _columns(
    flight: Flight, vehicle: Vehicle | None, inputs: Sequence[str], steady: SteadyModel | None
) -> dict[str, FloatArray]:
    """Return the inputs of a flight that may be used, (n,) each: commanded deflections, rad, accelerations, channels.

    Of rotors those are the accelerations that all of them command about each axis; single channels are there if asked for.
    """
    columns = {str(c): flight.column(str(c)) for c in flight.channels if c in inputs}
    if vehicle is None:
        return {**columns, **({} if inputs else {one.variable: one.u for one in flight.commands()})}
    recorded = {name: flight.column(name) for name in vehicle.inputs if name in flight.names}
    if not recorded:
        if not columns:
            lost = ", ".join(vehicle.inputs)
            raise FlightError(
                f"{flight.name}: holds no input of {vehicle.where} ({lost}); map one, or give no model"
            )
        return columns
    axes = None if steady is None or set(inputs) & set(vehicle.rotor_range.names) else steady.axes
    return columns | control_inputs(vehicle, recorded, axes)


def control_inputs(
    vehicle: Vehicle, recorded: Mapping[str, FloatArray], axes: AxisCommands | None
) -> dict[str, FloatArray]:
    """Return commanded deflections, rad, and accelerations about the axes of rotors, of recorded channels, (n,) each.

    Without axes the channels of rotors stand for themselves.
    """
    rows, count = vehicle.parameter_rows(), len(next(iter(recorded.values())))
    values = np.array([recorded.get(name, np.full(count, np.nan)) for name in vehicle.inputs])
    columns = {
        control: np.broadcast_to(vehicle.commanded(control, rows, values), (count,)).copy()
        for control in vehicle.controls
    }
    by_channel = {name: values[vehicle.inputs.index(name)] for name in vehicle.rotor_range.names}
    if axes is None:
        return columns | by_channel
    demanded = axes.effect @ np.array([by_channel[name] for name in axes.channels])
    return columns | dict(zip(motion.EXCITATIONS, demanded, strict=True))


def moving_inputs(
    columns: Sequence[Mapping[str, FloatArray]], masks: Sequence[BoolArray], inputs: Sequence[str]
) -> tuple[list[str], list[Notice]]:
    """Return the inputs that move within the windows of every flight, or those asked for."""
    shared = [n for n in columns[0] if all(n in own for own in columns)]
    for name in inputs:
        if name not in shared:
            raise FlightError(
                f"--input {name}: no control or channel of this name; {nearest(name, shared or list(VARIABLES))}"
            )
    sizes = {}
    for name in inputs or shared:
        values = np.concatenate([own[name][mask] for own, mask in zip(columns, masks, strict=True)])
        finite = values[np.isfinite(values)]
        sizes[name] = float(np.std(finite)) if moves(finite) else 0.0
    largest = max((size for n, size in sizes.items() if n not in motion.EXCITATIONS), default=0.0)
    # accelerations of rotors differ in unit and, by nature, in size
    moving = [
        n for n, size in sizes.items() if size > (0.0 if n in motion.EXCITATIONS else MIN_MOVEMENT * largest)
    ]
    still = tuple(n for n in sizes if n not in moving)
    if inputs and still:
        raise FlightError(
            f"--input {still[0]}: it does not move in these windows; leave it out, or choose windows in which it moves"
        )
    if not moving:
        raise FlightError(
            "no input moves in these windows; choose windows with maneuvers (stoop maneuvers finds them) or name one by --input"
        )
    return moving, [notice("frequency-input-still", inputs=still)] if still else []


def _stretch(
    flight: Flight,
    part: slice,
    columns: Mapping[str, FloatArray],
    inputs: Sequence[str],
    outputs: Sequence[str],
) -> Stretch:
    def output(name: str) -> FloatArray:
        values = flight.column(name)[part].copy()
        good = np.isfinite(values)
        if name in (*FAMILIES["circular"], *FAMILIES["euler"]) and good.any():
            values[good] = np.unwrap(values[good])
        return values

    return Stretch(
        flight.rate,
        np.column_stack([columns[n][part] for n in inputs]),
        np.column_stack([output(n) for n in outputs]),
    )


def _too_short(
    stretches: Sequence[Stretch],
    inputs: Sequence[str],
    outputs: Sequence[str],
    band: tuple[float, float] | None,
) -> str:
    """Return why nothing could be estimated, with what would mend it."""
    durations = [len(s.inputs) / s.rate for s in stretches]
    lengths = FrequencyResponse.window_lengths(durations, len(inputs)) if durations else ()
    if lengths and band is not None and band[1] <= 2.0 * np.pi * FrequencyResponse.CYCLES / lengths[0]:
        return (
            f"--band {band[0]:g}:{band[1]:g}: windows of {lengths[0]:.1f} s resolve nothing below "
            f"{2.0 * np.pi * FrequencyResponse.CYCLES / lengths[0]:.2g} rad/s; give a higher band or longer windows"
        )
    total = sum(durations)
    return (
        f"the windows hold too little without a gap ({total:.1f} s, inputs {', '.join(inputs)}, outputs {', '.join(outputs)}); "
        "give longer or more windows by --maneuver, or fewer inputs by --input"
    )


def _unknown_axes(responses: Sequence[FrequencyResponse]) -> list[Notice]:
    """Return which rates no input drives coherently."""
    best = {
        o: max(int(known(r).sum()) for r in responses if r.output == o)
        for o in dict.fromkeys(r.output for r in responses)
    }
    lost = tuple(o for o, count in best.items() if o in AXES and count == 0)
    return [notice("frequency-axis-unknown", outputs=lost, coherence=MIN_COHERENCE)] if lost else []


@dataclass(frozen=True, eq=False)
class SteadyModel:
    """The model at the mean condition of the windows; without a point where it does not trim."""

    vehicle: Vehicle
    condition: dict[str, float]  #: airspeed (m/s), altitude (m), density (kg/m3), of those that are known
    point: motion.Trim | None
    axes: AxisCommands | None  #: of a vehicle with rotors
    why: str = ""  #: there is no point


def steady_model(flights: Sequence[Flight], masks: Mapping[str, BoolArray], vehicle: Vehicle) -> SteadyModel:
    """Return a model at the mean condition of the samples (n,) of each flight that a mask has."""
    condition = {}
    for name, channel in (("airspeed", "V"), ("altitude", "altitude"), ("density", "density")):
        values = [f.column(channel)[masks[f.name]] for f in flights if channel in f.names]
        finite = np.concatenate([v[np.isfinite(v)] for v in values]) if values else np.zeros(0)
        if finite.size:
            condition[name] = float(np.mean(finite))
    if vehicle.rotors:
        condition.pop("airspeed", None)
    plain = vehicle.coupled_to(())
    plain = plain.reduced("full") if plain.reduce == "lateral" else plain
    try:
        density = condition.get("density") if "density" in plain.inputs else None
        point = trim(plain, condition.get("airspeed"), condition.get("altitude", 200.0), density=density)
        axes = axis_commands(plain, point.start, point.inputs) if plain.rotors else None
    except SimulationError as error:
        return SteadyModel(plain, condition, None, None, str(error))
    return SteadyModel(plain, condition, point, axes)


def _modeled(
    steady: SteadyModel, result: Result | None, inputs: Sequence[str], outputs: Sequence[str]
) -> tuple[dict[tuple[str, str], ModelResponse], list[Notice]]:
    """Return the responses of the model, and notices."""
    if steady.point is None:
        return {}, [notice("frequency-no-trim", reason=steady.why)]
    try:
        found: UncertainModel = uncertain_model(steady.vehicle, steady.point, result)
    except StoopError as error:
        return {}, [notice("frequency-no-trim", reason=str(error))]
    axes = steady.axes
    if axes is not None and not set(inputs) & set(axes.channels):
        found = found.with_inputs(tuple(motion.EXCITATIONS), axes.channels, axes.mixing)
    frequency = np.geomspace(*MODEL_BAND, MODEL_POINTS)
    notices = list(found.notices) + ([notice("frequency-no-band")] if result is None else [])
    return found.responses(inputs, outputs, frequency), notices


def _figures(
    responses: Sequence[FrequencyResponse], modeled: Mapping[tuple[str, str], ModelResponse]
) -> list[Figures]:
    """Return the figures of each rate by the input that drives it most, of flight and model."""
    out = []
    for output in FORMS:
        own = [r for r in responses if r.output == output and _drives(r.input, output)]
        if not own:
            continue
        one = max(own, key=lambda r: (int(known(r).sum()), r.input in AXES[output]))
        good = known(one)
        flown, error = None, one.bound / NORMAL_95
        if good.sum() > 1:
            draws = flight_draws(one.frequency[good], one.response[good], error[good], one.window[good])
            flown = Known(
                one.frequency[good], one.response[good], one.coherence[good], draws, error[good], one.window[good]
            )  # fmt: skip
            out.append(_figures_of("flight", one.input, output, flown, flown))
        model = modeled.get((one.input, output))
        if model is not None:
            span = FIT_BAND if flown is None else (flown.frequency[0], flown.frequency[-1])
            within_band = (model.frequency >= span[0]) & (model.frequency <= span[1])
            above = model.frequency >= FIT_BAND[0]  # the phugoid lies below
            out.append(
                _figures_of("model", one.input, output, _part(model, above), _part(model, within_band))
            )
    return out


def _part(model: ModelResponse, chosen: BoolArray) -> Known:
    frequency = model.frequency[chosen]
    return Known(frequency, model.response[chosen], np.ones(len(frequency)), model.draws[:, chosen])


def _drives(name: str, output: str) -> bool:
    """Tell whether an input may be that of the axis of a rate: not one known to be of another axis."""
    axis = next((a for a, names in DRIVERS.items() if name in names), name)
    return output == {"roll": "p", "pitch": "q", "yaw": "r", "heave": "az"}.get(axis, output)


def _figures_of(source: str, input_name: str, output: str, whole: Known, part: Known) -> Figures:
    figures = bandwidth(whole) if output in ATTITUDES else None
    return Figures(source, input_name, output, figures, equivalent_system(part, input_name, output))
