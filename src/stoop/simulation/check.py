"""Whether a vehicle can fly a maneuver at all."""

from __future__ import annotations

from typing import Final

from stoop.errors import ManeuverError
from stoop.simulation.maneuver import EXCITATIONS, SETPOINTS, Battery, Maneuver
from stoop.simulation.steady import flies_on_rotors
from stoop.vehicle import Vehicle

MOST_ON_ROTORS: Final = 500_000  #: samples; an autopilot takes them one by one


def on_rotors(vehicle: Vehicle, maneuver: Maneuver) -> bool:
    """Whether rotors carry the vehicle, and an autopilot flies it: without an airspeed it stands on its rotors."""
    return flies_on_rotors(vehicle, maneuver.airspeed)


def check_maneuver(vehicle: Vehicle, maneuver: Maneuver) -> None:
    """Refuse what the vehicle does not have.

    Raises
    ------
    ManeuverError
        An input that it does not have, an airspeed for what has no wings, a velocity for what cannot hover, or a
        battery that nothing feels.
    """
    if vehicle.file.reference is None and maneuver.airspeed is not None:
        raise ManeuverError(
            f"airspeed: {vehicle.where} has no wings to fly {maneuver.airspeed:g} m/s on, so no trim there; leave it out, write "
            f"velocity, and move {', '.join(controls(vehicle, False))}"
        )
    _check_inputs(vehicle, maneuver)
    if on_rotors(vehicle, maneuver) and len(maneuver.time) > MOST_ON_ROTORS:
        raise ManeuverError(
            f"duration times rate: more than {MOST_ON_ROTORS} samples under the autopilot; lower one of them"
        )
    if maneuver.heading and vehicle.reduce == "longitudinal":
        raise ManeuverError(
            "heading: a longitudinal model flies north; remove the heading, or fly the full model"
        )
    if maneuver.velocity is not None and not vehicle.rotors:
        raise ManeuverError(
            f"velocity: {vehicle.where} has no rotors to hover on; write airspeed, and wind for the speed over ground"
        )
    if maneuver.battery is not None:
        _check_battery(vehicle, maneuver, maneuver.battery)


def controls(vehicle: Vehicle, on_wings: bool) -> list[str]:
    """Return what a maneuver may move: of what hovers on its rotors, set-points and axes of the autopilot as well."""
    ground = () if vehicle.file.ground_effect is None else (vehicle.file.ground_effect.channel,)
    if not vehicle.rotors:
        return [*vehicle.controls, *ground]
    names = () if on_wings else (*EXCITATIONS, *SETPOINTS)
    channels = set(vehicle.recorded) - {"voltage", "density"}
    return list(dict.fromkeys((*names, *vehicle.controls, *sorted(channels))))


def _check_inputs(vehicle: Vehicle, maneuver: Maneuver) -> None:
    known = controls(vehicle, not on_rotors(vehicle, maneuver))
    for spec in maneuver.input:
        if spec.control not in known:
            raise ManeuverError(
                f"{vehicle.where}: the maneuver moves '{spec.control}', but the controls are {', '.join(known) or 'none'}; "
                f"correct the maneuver file{_on_its_rotors(vehicle, spec.control)}"
            )


def _on_its_rotors(vehicle: Vehicle, control: str) -> str:
    hint = f", or leave the airspeed out: '{control}' is moved where rotors carry the vehicle"
    return hint if vehicle.rotors and control in (*EXCITATIONS, *SETPOINTS) else ""


def _check_battery(vehicle: Vehicle, maneuver: Maneuver, battery: Battery) -> None:
    rotors = vehicle.file.rotors
    if rotors is None or rotors.nominal_voltage is None or not on_rotors(vehicle, maneuver):
        raise ManeuverError(
            f"battery: no rotor of {vehicle.where} feels the voltage in this flight; write nominal_voltage into [rotors] "
            "of the vehicle file, or remove it"
        )
    if battery.sag and rotors.voltage_average:
        raise ManeuverError(
            f"battery.sag: the rotors of {vehicle.where} take the voltage over {rotors.voltage_average:g} s (voltage_average), "
            "so sag is part of their thrust; remove one of the two"
        )
