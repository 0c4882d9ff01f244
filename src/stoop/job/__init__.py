"""The main job: flights and a vehicle file in; estimates, figures, identified vehicle and report out."""

from stoop.job.bootstrap import Bootstrap
from stoop.job.outputs import write_outputs
from stoop.job.posterior import Posterior
from stoop.job.profile import Profile
from stoop.job.run import Job, identify

__all__ = ["Bootstrap", "Job", "Posterior", "Profile", "identify", "write_outputs"]
