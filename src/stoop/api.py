"""What `import stoop` offers: one function for each verb of the command line, with Python's own objects as arguments."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any, Literal

from stoop.flight import Flight
from stoop.problem.windows import Windows, as_windows
from stoop.vehicle import Vehicle
from stoop.vehicle.builtin import resolve_vehicle as load_vehicle
from stoop.workflow import Job, identify
from stoop.workflow.identification import as_flight, as_flights

if TYPE_CHECKING:
    import xarray as xr

    from stoop.assessment.assessment import Assessment
    from stoop.assessment.frequency_analysis import FrequencyAnalysis
    from stoop.base.notices import Notice
    from stoop.exporters.exporter import Exported
    from stoop.input_design.optimization import Proposal
    from stoop.reconstruction.compatibility import Compatibility
    from stoop.report.sheet import Page
    from stoop.vehicle_draft.draft import Drafted
    from stoop.workflow.propagation import Propagated
    from stoop.workflow.validation import Validated

OneFlight = Flight | str | Path
FlownBy = Literal["pilot", "ardupilot", "px4", "crazyflie"]
fit = identify


def look(flight: OneFlight) -> Page:
    """Return a page of a flight: its channels, path, spectra, frequency responses, and the windows worth fitting.

    Parameters
    ----------
    flight : Flight, or path of a log

    Returns
    -------
    Page
        With a method ``save(path)``; a notebook shows it.
    """
    from stoop.input_design.overview import overview
    from stoop.report.flight import flight_sheet
    from stoop.report.sheet import Page

    return Page(flight_sheet(overview(as_flight(flight))))


def frequency_responses(
    flights: OneFlight | xr.Dataset | Sequence[OneFlight | xr.Dataset],
    maneuvers: Windows = (),
    model: Job | Vehicle | str | Path | None = None,
    inputs: Sequence[str] = (),
    outputs: Sequence[str] = (),
    band: tuple[float, float] | None = None,
) -> FrequencyAnalysis:
    """Estimate frequency responses of outputs to inputs that may move together, beside those of a model.

    Parameters
    ----------
    flights : Flight, path of a log, xarray.Dataset, or a sequence of them
    maneuvers : windows, optional
        Those that the model was fitted to when absent, else the airborne part; nothing is estimated across their ends.
    model : Job, folder of a saved one, Vehicle, built-in vehicle or vehicle file, optional
        Of an identification the responses of the model have a 95 % band.
    inputs : sequence of str, optional
        Controls of the model (deflections, rad), axes that its rotors command (rad/s2, m/s2), or channels; those that move when
        absent.
    outputs : sequence of str, optional
        Channels; rates and specific forces when absent.
    band : (low, high), rad/s, optional

    Returns
    -------
    FrequencyAnalysis
        ``responses`` (with ``frequency``, ``response``, ``coherence``, ``bound``), ``model``, ``figures`` (bandwidth, phase
        delay, low-order equivalent systems), ``notices``; ``to_xarray()`` gives labelled arrays.

    Raises
    ------
    FlightError
        An input is unknown or does not move, an output is unknown, or the windows are too short.
    """
    from stoop.workflow.frequency import analyze_frequency

    known = as_flights(flights)
    texts = [_text(w) for w in as_windows(maneuvers, {flight.name: flight for flight in known})]
    if model is None or isinstance(model, Vehicle):
        return analyze_frequency(known, texts, model, inputs, outputs, band)
    with _saved(model) as place:
        return analyze_frequency(known, texts, place, inputs, outputs, band)


def predict(
    fitted: Job | str | Path,
    flights: OneFlight | xr.Dataset | Sequence[OneFlight | xr.Dataset],
    maneuvers: Windows = (),
) -> Validated:
    """Predict windows that were not fitted.

    Parameters
    ----------
    fitted : Job, or path of the folder that it was saved to
    flights : Flight, path of a log, xarray.Dataset, or a sequence of them
    maneuvers : windows, optional
        The maneuvers found in the flights when absent.

    Raises
    ------
    StoopError
        A window was fitted, or cannot be flown.
    """
    from stoop.workflow.validation import validate

    known = as_flights(flights)
    windows = as_windows(maneuvers, {flight.name: flight for flight in known})
    with _saved(fitted) as folder:
        return validate(folder, known, [_text(w) for w in windows])


def assess(fitted: Job, *assessments: Assessment, watch: Callable[[str], None] | None = None) -> Job:
    """Return a fit with the uncertainty by further methods, such as ``stoop.Bootstrap()`` or ``stoop.Profile()``.

    Parameters
    ----------
    fitted : Job
    *assessments : Bootstrap, Profile, Posterior, or one of your own
    watch : callable, optional
        Gets a line of progress now and then.
    """
    return fitted.assess(*assessments, watch=watch)


def check(flight: OneFlight | xr.Dataset, vehicle: Vehicle | str | Path | None = None) -> tuple[Notice, ...]:
    """Return which lines of the mapping, or of a vehicle file, contradict the data of a flight.

    Parameters
    ----------
    flight : Flight, path of a log, or xarray.Dataset
    vehicle : Vehicle, str or Path, optional
        Or the name of a built-in one, or a vehicle file.

    Raises
    ------
    StoopError
        The flight lacks a channel that the vehicle needs.
    """
    from stoop.checks.vehicle import check as checked

    model = vehicle if vehicle is None or isinstance(vehicle, Vehicle) else load_vehicle(vehicle)
    return checked(as_flight(flight), model)


def new_vehicle(
    flights: OneFlight | xr.Dataset | Sequence[OneFlight | xr.Dataset] = (),
    *,
    template: str | None = None,
    mass: float | None = None,
    span: float | None = None,
    chord: float | None = None,
    area: float | None = None,
    engine: str | None = None,
    geometry: str | Path | None = None,
    name: str | None = None,
    aerodynamics: str = "handbook",
) -> Drafted:
    """Draft a vehicle file; its ``text`` is to be saved, its ``vehicle`` to be used, its ``notices`` to be read.

    Parameters
    ----------
    flights : Flight, path of a log, xarray.Dataset, or a sequence of them, optional
        Of this vehicle; from dimensions alone when absent.
    template : str, optional
        "conventional", "v-tail", "flying-wing", "glider", "quadplane", "quad", "hexa" or "octo"; by the log when absent.
    mass : float, kg
    span : float, m
        Of the wing; of a multirotor the largest distance between motors.
    chord : float, m
        Of the wing, mean.
    area : float, m2, optional
        Of the wing; span times chord when absent.
    engine : str, optional
        "electric", "piston", "jet" or "none".
    geometry : path, optional
        Of a geometry file.
    name : str, optional
        Of the vehicle.
    aerodynamics : str
        Derivatives of the geometry file by "handbook" or "aerosandbox" (extra ``geometry``).

    Raises
    ------
    VehicleError
        Something is missing, contradicts itself, or AeroSandbox is not installed.
    """
    from stoop.vehicle_draft.draft import draft
    from stoop.vehicle_draft.geometry import Geometry
    from stoop.vehicle_draft.request import Request

    table = None if geometry is None else Geometry.load(geometry)
    request = Request(template, mass, span, chord, area, engine, table, name, aerodynamics)
    return draft(request, as_flights(flights))


def reconstruct(flight: OneFlight | xr.Dataset, windows: Windows = ()) -> tuple[Compatibility, Flight]:
    """Reconstruct the flight path: return the errors of the instruments, and the flight without them.

    Parameters
    ----------
    flight : Flight, path of a log, or xarray.Dataset
    windows : windows, optional
        The airborne part when absent.

    Raises
    ------
    FlightError
        The flight holds nothing that could be compared.
    """
    from stoop.workflow.reconstruction import check_compatibility

    one = as_flight(flight)
    spans = [(w.start, w.stop) for w in as_windows(windows, {one.name: one})]
    return check_compatibility(one, spans)


def design(
    model: Job | str | Path,
    duration: float | None = None,
    airspeed: float | None = None,
    altitude: float = 200.0,
    amplitude: Mapping[str, float] | None = None,
    envelope: Mapping[str, tuple[float, float]] | None = None,
    shapes: Sequence[str] = (),
    seed: int = 0,
    min_amplitude: Mapping[str, float] | None = None,
    beat: float | None = None,
    evaluations: int | None = None,
    target: FlownBy | None = None,
) -> Proposal:
    """Design the maneuver that makes the standard errors smallest.

    Parameters
    ----------
    model : Job, folder of a saved one, built-in vehicle or vehicle file
    duration : float, s, optional
        20 s when absent; by hand 40 s, sweeps 60 s.
    airspeed : float, m/s, optional
        V* of the vehicle when absent.
    altitude : float, m
    amplitude : mapping, optional
        Largest deflection of each control, rad; on rotors of each command, rad/s2 or m/s2.
    envelope : mapping, optional
        Lowest and highest value of a channel, SI.
    shapes : sequence of str, optional
        Of :data:`stoop.input_design.SHAPES`; the usual ones when absent.
    seed : int
    min_amplitude : mapping, optional
        Smallest amplitude of each control that can be flown; 0.5 deg when absent.
    beat : float, s, optional
        Of counts, where a pilot flies the steps by hand; 0.5 s when absent for the target "pilot".
    evaluations : int, optional
        Maneuvers tried for each family; 2000 when absent, on rotors 200.
    target : {"pilot", "ardupilot", "px4", "crazyflie"}, optional
        Who flies it: chooses families that it can fly.

    Raises
    ------
    SimulationError
        No maneuver stays within the limits.
    """
    from stoop.input_design.information import Limits
    from stoop.input_design.optimization import propose
    from stoop.simulation import trim
    from stoop.workflow.design import min_amplitudes, prior_model, usual_plan

    with _saved(model) as place:
        known = prior_model(place)
    steady = trim(known.vehicle, airspeed, altitude)
    smallest = min_amplitudes(known.vehicle.controls, target, min_amplitude)
    limits = Limits.about(known.vehicle, steady, amplitude, envelope=envelope, min_amplitude=smallest)
    plan, families = usual_plan(steady, target, shapes, duration, beat, evaluations, seed=seed)
    return propose(known, steady, limits, plan, families)


def save_design(
    proposal: Proposal,
    folder: str | Path,
    target: FlownBy | None = None,
    throws: Mapping[str, float] | None = None,
    overwrite: bool = False,
) -> Path:
    """Save a designed maneuver: maneuver files, page, and the files with which a pilot or an autopilot flies it.

    Parameters
    ----------
    proposal : Proposal
        Of :func:`design`.
    folder : path
    target : {"pilot", "ardupilot", "px4", "crazyflie"}, optional
        Who flies it.
    throws : mapping, optional
        Deflection of each surface at full output, rad.
    overwrite : bool

    Returns
    -------
    Path
        The folder, with ``maneuver.toml`` for :func:`load_maneuver`.

    Raises
    ------
    StoopError
        The target cannot fly the maneuver, or the folder cannot be written.
    """
    from stoop.workflow.design import flight_files, write_proposal

    flight = flight_files(proposal, target, throws) if target is not None else {}
    write_proposal(proposal, Path(folder), "stoop.design(...)", overwrite, flight)
    return Path(folder)


def propagate(
    fitted: Job | str | Path,
    expressions: Mapping[str, str] | None = None,
    airspeed: tuple[float, float] | None = None,
    altitude: float | None = None,
    draws: int = 2000,
    seed: int = 0,
    source: Literal["posterior", "covariance"] | None = None,
) -> Propagated:
    """Carry the uncertainty of a fit into trims over the airspeed, limits, stability, modes, control, glide and expressions.

    Parameters
    ----------
    fitted : Job, or path of the folder that it was saved to
    expressions : mapping, optional
        Expressions of the vehicle's numbers, such as ``"CLalpha / CD0"``, by the names that they get.
    airspeed : (low, high), m/s, optional
        Of the curves; what was flown in the fitted maneuvers when absent.
    altitude : float, m, optional
        The flight's when absent.
    draws : int
    seed : int
    source : {"posterior", "covariance"}, optional
        The posterior where it was sampled when absent.

    Returns
    -------
    Propagated
        Figures by name, ``to_dataframe()``, ``to_xarray()`` and ``page()``; SI and rad.

    Raises
    ------
    StoopError
        The posterior did not converge, there is no covariance, an expression has an unknown name, or nothing trims.
    """
    from stoop.workflow.propagation import propagate as propagated

    with _saved(fitted) as folder:
        return propagated(folder, expressions, airspeed, altitude, draws, seed, source)


def export(
    model: Job | str | Path,
    to: str,
    folder: str | Path | None = None,
    airspeed: float | None = None,
    altitude: float | None = None,
    overwrite: bool = False,
) -> Exported:
    """Export a model as files of another tool.

    Parameters
    ----------
    model : Job, folder of a saved one, built-in vehicle or vehicle file
    to : str
        One of the targets of ``stoop export --to``.
    folder : path, optional
        Where the files are written; they are only returned when absent.
    airspeed, altitude : float, m/s and m, optional
        Of the steady flight.
    overwrite : bool
        Whether files in the folder may be replaced.

    Raises
    ------
    StoopError
        The model cannot be exported so, or the folder holds other files.
    """
    from stoop.exporters.exporter import Condition
    from stoop.exporters.targets import export as exported
    from stoop.workflow.export import read_model, write

    with _saved(model) as place:
        found = exported(read_model(str(place)), to, Condition(airspeed, altitude, 0.0))
    if folder is not None:
        write(found, Path(folder), overwrite)
    return found


def _text(window: Any) -> str:
    loading = f"#{window.loading}" if window.loading else ""
    return f"{window.flight}@{window.start!r}:{window.stop!r}{loading}"


@contextmanager
def _saved(model: Job | str | Path) -> Iterator[Path]:
    """Give the folder of a fit; one that was not saved lies in a temporary folder meanwhile."""
    if not isinstance(model, Job):
        yield Path(model)
        return
    with TemporaryDirectory(prefix="stoop-") as name:
        yield model.save(Path(name) / "result")
