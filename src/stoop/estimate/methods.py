"""Methods of identification by name.

``fit(vehicle, flights, windows, options, callback, state) -> Estimate``
    Turns windows of flights into an estimate; `stoop.estimate.fit.estimation_problem` gives the problem.

    `callback` gets the state after each step and `state` is one to go on from; regressions ignore both.

To add a method, write its function and its :class:`stoop.estimate.estimate.Estimate`, and add one row to `_METHODS`.
"""

from __future__ import annotations

import importlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Final

from stoop.base.notices import Notice, notice
from stoop.base.text import nearest
from stoop.base.variables import EULER, RATES, SPECIFIC_FORCE, VARIABLES
from stoop.errors import IdentificationError, StoopError
from stoop.flight import Flight
from stoop.vehicle import Vehicle
from stoop.vehicle.defaults import wider_bounds
from stoop.vehicle.schema import WIND
from stoop.vehicle.vehicle import AIR_FRAME, GROUND_FRAME, leaves

if TYPE_CHECKING:
    from stoop.estimate.estimate import Estimate
    from stoop.estimate.fit import Options
    from stoop.estimate.refit_problem import RefitProblem
    from stoop.problem.windows import Window

DEFAULT: Final = "output-error"
IN_GUSTS: Final = "filter-error"  #: where air data and inertial sensors show gusts
UNSTABLE: Final = (
    "stabilized-output-error"  #: where errors grow too much over the windows of a fixed wing, and ...
)
UNSTABLE_LATE: Final = "multiple-shooting"  #: ... the delay of a sensor is free, which a filter must know
SCORING: Final = "scoring"  #: the search of filter error, in its states
CALM: Final = frozenset({DEFAULT, "multiple-shooting"})  #: take the effect of gusts for that of the aircraft
#: by kind of vehicle: open loop one on rotors falls before a record ends
USUAL: Final = {AIR_FRAME: DEFAULT, GROUND_FRAME: "multiple-shooting"}
SLOW_MOTORS: Final = "equation-error"  #: with rotors whose motors were logged at less than `MIN_MOTOR_RATE`
MIN_MOTOR_RATE: Final = 100.0
"""Hz. What moves the motors faster than half the rate of their log looks slow in it, and the vehicle seems to answer less. Of a
simulated flight with shaken motors (tests/recovery/test_slow_motors.py) multiple shooting makes the inertia 0.39 too large at 50
Hz, 0.13 at 100 Hz and 0.05 at 125 Hz; equation error 0.24, 0.06 and 0.03. Above, only multiple shooting knows its error bars."""
#: with rotors where neither velocity nor attitude was recorded: rates are then all that regressors hold of the motion, their
#: noise hardly biases, and a simulation would have to estimate the states of every window from nothing
STATELESS: Final = "equation-error"
NOT_WIDENED: Final = "stopped by the user while default bounds that an estimate reached were widened"
MAX_WIDENINGS: Final = 3  #: of default bounds that an estimate reaches; each doubles a box
GRID_SHARE: Final = 0.98  #: of the grid's rate: what was logged faster than that is used as it was logged


@dataclass(frozen=True)
class Method:
    """One method; its function is imported when it is first used."""

    fit: str  #: ``"module:function"``, see the head of this module
    estimate: str  #: ``"module:class"``, the :class:`stoop.estimate.estimate.Estimate` that it returns
    purpose: str  #: what it is for, in a few words
    simulates: bool = (
        True  #: whether residuals are those of a simulation, whose likelihood posterior and profile show
    )

    def fitter(self) -> Callable[..., Any]:
        """Return the function that fits."""
        found: Callable[..., Any] = _imported(self.fit)
        return found

    def estimates(self) -> type[Estimate]:
        """Return the class of its estimates."""
        found: type[Estimate] = _imported(self.estimate)
        return found


def _imported(name: str) -> Any:
    module, _, attribute = name.partition(":")
    return getattr(importlib.import_module(module), attribute)


FILTER: Final = "stoop.estimate.filter_error:FilterEstimate"
REGRESSION: Final = "stoop.estimate.regression.method:RegressionEstimate"
_METHODS: Final[dict[str, Method]] = {
    DEFAULT: Method(
        "stoop.estimate.fit:fit", "stoop.estimate.fit:OutputErrorEstimate", "flights in calm air"
    ),
    "filter-error": Method("stoop.estimate.filter_error:steady", FILTER, "flights in turbulence"),
    "filter-error-ekf": Method(
        "stoop.estimate.filter_error:varying",
        FILTER,
        "likewise, with a gain that follows large maneuvers",
    ),
    UNSTABLE: Method(
        "stoop.estimate.filter_error:stabilized",
        FILTER,
        "unstable vehicles in calm air: measurements keep the simulation near the record",
    ),
    "multiple-shooting": Method(
        "stoop.estimate.multiple_shooting:fit",
        "stoop.estimate.multiple_shooting:ShootingEstimate",
        "vehicles that are unstable or fly on rotors: short windows",
    ),
    "equation-error": Method(
        "stoop.estimate.regression.method:equation_error",
        REGRESSION,
        "a first look without a simulation: smoothed samples",
        simulates=False,
    ),
    "frequency-domain": Method(
        "stoop.estimate.regression.method:frequency_domain",
        REGRESSION,
        "likewise, on the Fourier coefficients of a band",
        simulates=False,
    ),
}


def restore(name: str, arrays: Mapping[str, Any], where: str) -> Estimate:
    """Return the estimate of a method from its :meth:`stoop.estimate.estimate.Estimate.state`; `where` names its file.

    Raises
    ------
    IdentificationError
        The arrays are not those of an estimate of the method.
    """
    try:
        return find(name).estimates().restored(arrays)
    except (KeyError, TypeError, ValueError, AttributeError, IndexError, StoopError) as error:
        raise IdentificationError(
            f"{where}: holds no estimate of {name or DEFAULT} that this version reads ({error}); fit again"
        ) from error


def refit_problem(kind: str) -> type[RefitProblem]:
    """Return the class of least-squares problems that has a name in packed problems."""
    problems = (method.estimates().refits for method in _METHODS.values())
    return next(one for one in problems if one.kind == kind)


def names() -> tuple[str, ...]:
    """Return the names of all methods."""
    return tuple(_METHODS)


@dataclass(frozen=True)
class MethodChoice:
    """A method, and why where neither the user nor the vehicle alone decided."""

    name: str
    notices: tuple[Notice, ...] = ()
    instead: str = ""  #: the method where this one, which the data called for, does not explain them

    def fit(
        self,
        vehicle: Vehicle,
        flights: Mapping[str, Flight],
        windows: Sequence[Window],
        options: Options,
        callback: Callable[..., None] | None = None,
        state: Any = None,
    ) -> tuple[str, Estimate]:
        """Return the method that was used, and its fit."""
        problem = (flights, windows, replace(options, method=self.name), callback, state)
        if not self.instead:
            found = run(vehicle, *problem)
            biased: tuple[Notice, ...] = ()
            if any(n.code == "gusts-ignored" for n in self.notices):
                from stoop.estimate.gust_bias import gust_bias

                biased = gust_bias(found, flights)
            return self.name, replace(found, notices=(*self.notices, *biased, *found.notices))
        from stoop.estimate.gusts import unexplained, with_turbulence

        try:
            found = run(with_turbulence(vehicle), *problem)
            doubts = unexplained(found, self.name, self.instead)
        except IdentificationError as error:  # a filter that diverges from every start
            doubts = (notice("filter-diverges", text=str(error), method=self.instead),)
        if not doubts:
            return self.name, replace(found, notices=(*self.notices, *found.notices))
        begun = None if state is None or state.optimizer == SCORING else state
        name, found = MethodChoice(self.instead, doubts).fit(
            vehicle, flights, windows, options, callback, begun
        )
        return name, found


def choose_method(
    name: str, vehicle: Vehicle, flights: Iterable[Flight], windows: Sequence[Window] = ()
) -> MethodChoice:
    """Return the named method, or the one that suits vehicle, flights and windows where none is named."""
    flights = list(flights)
    usual = USUAL[vehicle.frame]
    if vehicle.frame == AIR_FRAME and (name or usual) in CALM and windows:
        return _in_air(name or usual, not name, vehicle, {f.name: f for f in flights}, windows)
    if name:
        return MethodChoice(name)
    rates, channels = [MIN_MOTOR_RATE], {rotor.channel for rotor in vehicle.file.rotor.values()}
    for flight in flights:
        for channel in channels & flight.sources.keys():  # measured speeds are smooth, commands are not
            rate = flight.sources[channel].rate
            if VARIABLES[channel].kind != "measurement" and 0.0 < rate < GRID_SHARE * flight.rate:
                rates.append(rate)
    recorded = [set(flight.channels) for flight in flights]
    sensed = all({*RATES, *SPECIFIC_FORCE} <= own and not own & {*WIND, *EULER} for own in recorded)
    if flights and sensed and vehicle.frame == GROUND_FRAME:
        return MethodChoice(STATELESS, (notice("no-states-recorded", method=STATELESS, other=usual),))
    if min(rates) >= MIN_MOTOR_RATE:
        return MethodChoice(usual)
    why = notice(
        "motors-logged-slowly", rate=min(rates), limit=MIN_MOTOR_RATE, method=SLOW_MOTORS, other=usual
    )
    return MethodChoice(SLOW_MOTORS, (why,))


def _in_air(
    usual: str, free: bool, vehicle: Vehicle, flights: Mapping[str, Flight], windows: Sequence[Window]
) -> MethodChoice:
    """Return filter error in gusts where the method is `free`, else the method of calm air and what to expect of it."""
    from stoop.estimate.gusts import exceed_sensors, gust_levels
    from stoop.simulation.delays import output_delays

    late = any(vehicle.parameters[row].free for _, row in output_delays(vehicle))  # a filter needs known ones
    calm = _in_calm_air(usual, free, UNSTABLE_LATE if late else UNSTABLE, vehicle, flights, windows)
    levels = gust_levels(vehicle, flights, windows)
    if not exceed_sensors(vehicle, levels):
        return calm
    gusts = dict(zip("uvw", levels.tolist(), strict=True))
    if late or not free:
        ignored = notice("gusts-ignored", **gusts, method=calm.name, other=IN_GUSTS)
        return replace(calm, notices=(*calm.notices, ignored))
    why = notice("gusts-filtered", **gusts, method=IN_GUSTS, other=calm.name)
    return MethodChoice(IN_GUSTS, (why,), instead=calm.name)


def _in_calm_air(
    usual: str,
    free: bool,
    unstable: str,
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
) -> MethodChoice:
    """Return the usual method, or that of `unstable` vehicles where errors grow too much over the windows."""
    from stoop.estimate.instability import growth_at_start

    if usual != DEFAULT:
        return MethodChoice(usual)
    growth = growth_at_start(vehicle, flights, windows)
    if not growth.excessive:
        return MethodChoice(usual)
    code, name, other = ("unstable", unstable, usual) if free else ("unstable-open-loop", usual, unstable)
    about = notice(
        code, rate=growth.rate, seconds=growth.seconds, factor=growth.factor, method=name, other=other
    )
    return MethodChoice(name, (about,))


def run(
    vehicle: Vehicle,
    flights: Mapping[str, Flight],
    windows: Sequence[Window],
    options: Options,
    callback: Callable[..., None] | None = None,
    state: Any = None,
) -> Estimate:
    """Return the fit by the method of the options; default bounds that it reaches are widened, and it is done again.

    Bounds of the file stay. What is saved, and resumed, is the first search.
    """
    fitter, remarks = find(options.method).fitter(), dict[str, Notice]()
    found: Estimate = fitter(vehicle, flights, windows, options, callback, state)
    unbounded = {name for name, q in leaves(vehicle.file) if q.bounds is None}
    for _ in range(MAX_WIDENINGS):
        held = {u.name: u.estimate for u in found.unknowns if u.fixed == "bound" and u.name in unbounded}
        at = [p for p in vehicle.parameters if p.name in held]
        boxes = {p.name: wider_bounds(p.name, p.value, (p.lower, p.upper), held[p.name]) for p in at}
        boxes = {p.name: boxes[p.name] for p in at if boxes[p.name] != (p.lower, p.upper)}
        if not boxes or found.outcome.status == "interrupted":
            break
        vehicle = vehicle.with_numbers({name: {"bounds": box} for name, box in boxes.items()})
        before = found
        try:
            found = fitter(vehicle, flights, windows, options, None, None)
        except KeyboardInterrupt:  # what was found within the narrower bounds stands
            return replace(found, outcome=replace(found.outcome, status="interrupted", advice=NOT_WIDENED))
        for name, (low, high) in boxes.items():
            remarks[name] = notice("bounds-widened", name, bound=held[name], low=low, high=high)
        found = replace(found, trajectories=before.trajectories + found.trajectories)
    return replace(found, notices=(*remarks.values(), *found.notices)) if remarks else found


def find(name: str) -> Method:
    """Return a method by its name, output error where none is named; an IdentificationError says that there is none."""
    found = _METHODS.get(name or DEFAULT)
    if found is None:
        raise IdentificationError(f"method '{name}': not known; {nearest(name, _METHODS)}")
    return found
