"""The main job: flights and a vehicle file in; estimates, figures, identified vehicle and report out."""

from stoop.assessment.bootstrap import Bootstrap
from stoop.assessment.profile import Profile
from stoop.workflow.fitted_model import FittedModel
from stoop.workflow.identification import identify
from stoop_analysis.posterior import Posterior

__all__ = ["Bootstrap", "FittedModel", "Posterior", "Profile", "identify"]
