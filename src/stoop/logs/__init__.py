"""Bytes -> recorded channels; one file per format; independent of any aircraft."""

from stoop.logs.read import read
from stoop.logs.recording import Defect, Recording, Stream

__all__ = ["Defect", "Recording", "Stream", "read"]
