"""Bytes -> recorded channels; one file per format; knows no aircraft."""

from stoop.base.arrays import FloatArray
from stoop.logs.read import read
from stoop.logs.recording import Defect, Recording, Stream

__all__ = ["Defect", "FloatArray", "Recording", "Stream", "read"]
