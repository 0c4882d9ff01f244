"""Margins of the gains that flew, in one call: parameters from the log, loops at the airspeeds of the fitted maneuvers."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Final

import numpy as np

from stoop.assessment.draws import POSTERIOR_FILE, Source, draws_of
from stoop.base.notices import notice
from stoop.control_laws.parameters import read_parameters
from stoop.control_laws.table import Firmware, firmwares
from stoop.errors import StoopError
from stoop.simulation import trim
from stoop.tuning.judgment import LoopMargins, commands_of, judge, plants_of
from stoop.tuning.loops import AxisLoop
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.load import takes_model
from stoop.workflow.propagation import flown_domain
from stoop.workflow.summary import refusal

DRAWS: Final = 2000
SPEEDS: Final = 3  #: airspeeds of a range


@takes_model
def tune(
    model: FittedModel,
    parameters: str | Path | Mapping[str, float],
    airspeed: tuple[float, float] | None = None,
    draws: int = DRAWS,
    seed: int = 0,
    source: Source | None = None,
) -> LoopMargins:
    """Judge the gains that flew: margins of the rate and attitude loops of an autopilot around a fitted model.

    Each loop is opened at its actuator with the others closed. The law is that of the firmware whose parameters the log
    holds, with its filters, at its own rate; the model brings lags and delays of actuators.

    Parameters
    ----------
    model : FittedModel, or the folder of one
    parameters : str, Path or mapping
        A log that holds the autopilot's parameters, a file of parameters (``.params``, ``.parm``, ``.param``), or
        parameters by name.
    airspeed : (low, high), m/s, optional
        What was flown in the fitted maneuvers when absent.
    draws : int
    seed : int
    source : {"posterior", "covariance"}, optional
        The posterior where it was sampled when absent.

    Returns
    -------
    LoopMargins
        ``to_dataframe()`` has estimates and percentiles 5, 50 and 95 of the draws.

    Raises
    ------
    StoopError
        The parameters are missing, or of another kind of vehicle, the model is not driven by commands about the axes,
        or the loops are unstable around it.
    """
    values = parameters if isinstance(parameters, Mapping) else read_parameters(Path(parameters))
    vehicle = model.vehicle.coupled_to(())
    vehicle = vehicle.reduced("full") if vehicle.reduce == "lateral" else vehicle
    firmware = _firmware(values, bool(vehicle.rotors))
    laws = {a: firmware.law(values, a) for a in firmware.axes}
    commands = commands_of(vehicle, firmware, values)
    drawn = draws_of(model.result, model.attachments.get(POSTERIOR_FILE), draws, seed, source, model.source)
    domain = flown_domain(model, airspeed)
    speeds = [0.0] if firmware.rotors else np.linspace(*domain.airspeed, SPEEDS).tolist()
    found = []
    for speed in speeds:
        ratio = firmware.airspeed_ratio(values, speed)
        loops = {a: AxisLoop(laws[a], firmware.attitude_gain(values, a), ratio) for a in commands.axes}
        point = trim(vehicle, speed or None, domain.altitude)
        found += judge(plants_of(vehicle, point, drawn, commands), loops, speed)
    lacks = tuple(dict.fromkeys(text for law in laws.values() for text in law.lacks))
    notices = [*refusal(model.result, model.source), *drawn.notices]
    notices += [notice("tune-law-lacks", firmware=firmware.title, features=lacks)] if lacks else []
    return LoopMargins(firmware.title, tuple(found), len(drawn.values), drawn.source, tuple(notices))


def _firmware(parameters: Mapping[str, float], rotors: bool) -> Firmware:
    """Return the law of the parameters for a kind of vehicle."""
    known = firmwares(parameters)
    for one in known:
        if one.rotors == rotors:
            return one
    kind = "on rotors" if rotors else "on wings"
    raise StoopError(
        f"tune: the parameters are those of {known[0].title}, but the model flies {kind}: take its own log"
    )
