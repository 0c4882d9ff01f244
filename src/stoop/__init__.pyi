"""Written by scripts/interface.py."""

from stoop import errors as errors
from stoop.api import assess as assess
from stoop.api import look as look
from stoop.api import reconstruct as reconstruct
from stoop.assessment.bootstrap import Bootstrap as Bootstrap
from stoop.assessment.profile import Profile as Profile
from stoop.base.notices import Notice as Notice
from stoop.estimate.fit import Options as Options
from stoop.flight import Flight as Flight
from stoop.flight.load import load_flight as load_flight
from stoop.flight.load import save_flight as save_flight
from stoop.results.result import read_result as read_result
from stoop.simulation import trim as trim
from stoop.simulation.fly import simulate_flight as simulate_flight
from stoop.simulation.maneuver import load_maneuver as load_maneuver
from stoop.strategy import Strategy as Strategy
from stoop.vehicle import Vehicle as Vehicle
from stoop.vehicle.builtin import load_vehicle as load_vehicle
from stoop.workflow.fitted_model import FittedModel as FittedModel
from stoop.workflow.flying import linearize as linearize
from stoop.workflow.flying import simulate as simulate
from stoop.workflow.identification import fit as fit
from stoop.workflow.load import load as load
from stoop.workflow.validation import validate as predict
from stoop.workflow.validation import validate as validate
from stoop_analysis.posterior import Posterior as Posterior
from stoop_analysis.workflow.derivatives import derivatives as derivatives
from stoop_analysis.workflow.frequency import frequency as frequency
from stoop_analysis.workflow.frequency import frequency_responses as frequency_responses
from stoop_analysis.workflow.propagation import propagate as propagate
from stoop_draft.check import check as check
from stoop_draft.vehicles import new_vehicle as new_vehicle
from stoop_export.export import export as export
from stoop_export.jsbsim_autopilot import fly_in_jsbsim as fly_in_jsbsim
from stoop_fleet.store import open_fleet as open_fleet
from stoop_fleet.update import update_fleet as update_fleet
from stoop_plan.design import design as design
from stoop_plan.design import save_design as save_design
from stoop_plan.flight_logs import save_flight_as as save_flight_as
from stoop_plan.input_design.windows import find_windows as find_windows
from stoop_tune.tuning import tune as tune

__version__: str
__all__ = [
    "Bootstrap",
    "FittedModel",
    "Flight",
    "Notice",
    "Options",
    "Posterior",
    "Profile",
    "Strategy",
    "Vehicle",
    "assess",
    "check",
    "derivatives",
    "design",
    "errors",
    "export",
    "find_windows",
    "fit",
    "fly_in_jsbsim",
    "frequency",
    "frequency_responses",
    "linearize",
    "load",
    "load_flight",
    "load_maneuver",
    "load_vehicle",
    "look",
    "new_vehicle",
    "open_fleet",
    "predict",
    "propagate",
    "read_result",
    "reconstruct",
    "save_design",
    "save_flight",
    "save_flight_as",
    "simulate",
    "simulate_flight",
    "trim",
    "tune",
    "update_fleet",
    "validate",
]
