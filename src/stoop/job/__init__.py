"""The main job: flights and a vehicle file in; estimates, figures, identified vehicle and report out."""

from stoop.job.outputs import write_outputs
from stoop.job.run import Job, identify

__all__ = ["Job", "identify", "write_outputs"]
