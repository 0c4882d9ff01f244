"""Bytes -> recorded channels; one file per format; knows no aircraft."""

from stoop.logs.read import read
from stoop.logs.recording import Defect, FloatArray, Recording, Stream

__all__ = ["Defect", "FloatArray", "Recording", "Stream", "read"]
