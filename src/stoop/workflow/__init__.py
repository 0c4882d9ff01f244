"""The main job: flights and a vehicle file in; estimates, figures, identified vehicle and report out."""

from stoop.assess.bootstrap import Bootstrap
from stoop.assess.posterior import Posterior
from stoop.assess.profile import Profile
from stoop.workflow.identification import Job, identify
from stoop.workflow.outputs import write_outputs

__all__ = ["Bootstrap", "Job", "Posterior", "Profile", "identify", "write_outputs"]
