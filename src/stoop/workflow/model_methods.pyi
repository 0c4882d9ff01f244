"""Written by scripts/interface.py."""

from collections.abc import Mapping as Mapping
from collections.abc import Sequence as Sequence
from pathlib import Path as Path
from stoop.base.arrays import FloatArray as FloatArray
from stoop.extend.flights import Flights as Flights
from stoop.extend.flights import Windows as Windows
from stoop.flight import Flight as Flight
from stoop.problem.windows import Windows as Windows
from stoop.simulation import LinearModel as LinearModel
from stoop.simulation import Trim as Trim
from stoop.simulation.maneuver import Maneuver as Maneuver
from stoop.workflow.flights import Flights as Flights
from stoop.workflow.validation import Validated as Validated
from stoop_analysis.draws import Source as Source
from stoop_analysis.frequency import FrequencyAnalysis as FrequencyAnalysis
from stoop_analysis.workflow.derivatives import DerivativeTables as DerivativeTables
from stoop_analysis.workflow.propagation import Propagated as Propagated
from stoop_export.exporter import Exported as Exported
from stoop_plan.input_design.optimization import Proposal as Proposal
from stoop_tune.tuning import JudgedGains as JudgedGains
from typing import Any as Any
from typing import Literal as Literal
import xarray as xr

def add_methods(model: type) -> None: ...

class ModelMethods:
    def derivatives(self, airspeed: float | None=..., altitude: float | None=..., climb_angle: float=..., axes: str=..., dimensional: bool=...) -> DerivativeTables: ...
    def design(self, duration: float | None=..., airspeed: float | None=..., altitude: float=..., amplitude: Mapping[str, float] | None=..., envelope: Mapping[str, tuple[float, float]] | None=..., shapes: Sequence[str]=..., seed: int=..., min_amplitude: Mapping[str, float] | None=..., beat: float | None=..., evaluations: int | None=..., target: str | None=...) -> Proposal: ...
    def export(self, to: str, folder: str | Path | None=..., airspeed: float | None=..., altitude: float | None=..., climb_angle: float=..., overwrite: bool=..., draws: int | None=..., seed: int=...) -> Exported: ...
    def frequency(self, flights: Flights, maneuvers: Windows=..., inputs: Sequence[str]=..., outputs: Sequence[str]=..., band: tuple[float, float] | None=...) -> FrequencyAnalysis: ...
    def linearize(self, point: Trim | None=..., airspeed: float | None=..., altitude: float=...) -> LinearModel: ...
    def predict(self, flights: Flights, windows: Windows=..., command: str=..., initial_state: Mapping[str, float] | Literal['measured'] | None=...) -> Validated: ...
    def propagate(self, expressions: Mapping[str, str] | None=..., airspeed: tuple[float, float] | None=..., altitude: float | None=..., draws: int=..., seed: int=..., source: Source | None=...) -> Propagated: ...
    def simulate(self, inputs: Maneuver | str | Path | Mapping[str, Any] | xr.Dataset | Flight, time: FloatArray | None=..., *, airspeed: float | None=..., altitude: float=..., seed: int=..., noise: bool=..., name: str=..., initial_state: Mapping[str, float] | None=..., autopilot: str | Path | Sequence[str | Path] | Mapping[str, float] | None=...) -> Flight: ...
    def tune(self, parameters: str | Path | Mapping[str, float], airspeed: tuple[float, float] | None=..., draws: int=..., seed: int=..., source: Source | None=...) -> JudgedGains: ...
    def validate(self, flights: Flights, windows: Windows=..., command: str=..., initial_state: Mapping[str, float] | Literal['measured'] | None=...) -> Validated: ...
