"""Another method where errors of the state grow too much over the windows of a fixed wing."""

from __future__ import annotations

from typing import Final

from stoop.base.notices import notice
from stoop.estimate import methods
from stoop.strategy.decision import Change, Decision, Setup
from stoop.vehicle.channels import AIR_FRAME

UNSTABLE: Final = "stabilized-output-error"
UNSTABLE_LATE: Final = "multiple-shooting"  #: where the delay of a sensor is free: a filter must know it


def late_sensors(setup: Setup) -> bool:
    """Whether the delay of a sensor is free."""
    from stoop.vehicle.delays import output_delays

    return any(setup.vehicle.parameters[row].free for _, row in output_delays(setup.vehicle))


def stabilize(setup: Setup) -> Change | None:
    """Return the fit by a method that keeps an unstable vehicle near the record; a named method stays."""
    from stoop.estimate.instability import growth_at_start

    usual = setup.options.method
    if setup.vehicle.frame != AIR_FRAME or usual != methods.DEFAULT or not setup.fitted:
        return None
    growth = growth_at_start(setup.vehicle, setup.flights, setup.fitted)
    if not growth.excessive:
        return None
    unstable = UNSTABLE_LATE if late_sensors(setup) else UNSTABLE
    free = setup.free_method
    code, name, other = ("unstable", unstable, usual) if free else ("unstable-open-loop", usual, unstable)
    rate, seconds, factor = growth.rate, growth.seconds, growth.factor
    about = notice(code, rate=rate, seconds=seconds, factor=factor, method=name, other=other)
    found = f"errors grow by a factor of {factor:.0e} over {seconds:.1f} s"
    return Change(setup.by(name).noting(about), found, name if free else f"{name} kept, which was named")


INSTABILITY = Decision(
    "instability", "Do errors grow too much over the windows to simulate them?", problem=stabilize
)
