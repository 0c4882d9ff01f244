"""The main job: flights and a vehicle file in; estimates, figures, identified vehicle and report out."""

from typing import Any

from stoop.assessment.bootstrap import Bootstrap
from stoop.assessment.profile import Profile
from stoop.base.packages import places, resolved
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.identification import fit

__all__ = ["Bootstrap", "FittedModel", "Profile", "fit"]


def __getattr__(name: str) -> Any:
    """Return a function or class of a package, such as ``Posterior``."""
    place = places("functions").get(name)
    if place is None:
        raise AttributeError(f"module 'stoop.workflow' has no attribute '{name}'")
    return resolved(place)
