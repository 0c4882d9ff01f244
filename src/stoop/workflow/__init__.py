"""The main job: flights and a vehicle file in; estimates, figures, identified vehicle and report out."""

from typing import Any

import stoop
from stoop.assessment.bootstrap import Bootstrap
from stoop.assessment.profile import Profile
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.identification import fit

__all__ = ["Bootstrap", "FittedModel", "Profile", "fit"]


def __getattr__(name: str) -> Any:
    """Return `stoop.Posterior`, a class of a package."""
    if name != "Posterior":
        raise AttributeError(f"module 'stoop.workflow' has no attribute '{name}'")
    return stoop.Posterior
