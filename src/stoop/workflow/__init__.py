"""The main job: flights and a vehicle file in; estimates, figures, identified vehicle and report out."""

from stoop.assessment.bootstrap import Bootstrap
from stoop.assessment.posterior import Posterior
from stoop.assessment.profile import Profile
from stoop.workflow.identification import Job, identify

__all__ = ["Bootstrap", "Job", "Posterior", "Profile", "identify"]
