"""The main job: flights and a vehicle file in; estimates, figures, identified vehicle and report out."""

from stoop.workflow.bootstrap import Bootstrap
from stoop.workflow.identification import Job, identify
from stoop.workflow.outputs import write_outputs
from stoop.workflow.posterior import Posterior
from stoop.workflow.profile import Profile

__all__ = ["Bootstrap", "Job", "Posterior", "Profile", "identify", "write_outputs"]
