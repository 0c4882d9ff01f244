"""Frequency responses of the flights beside those of a model: what of each the model leaves in its residuals."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class ResponseMisfit:
    """Part of the response of a rate to an input that a model does not explain."""

    input: str  #: control, or axis that rotors command
    output: str
    low: float  #: rad/s; the frequencies at which the response of the flights is known
    high: float
    coherence: float  #: mean partial coherence there
    #: rms magnitude of the response of the residuals, random error taken off, over that of the flights
    share: float
    #: likewise, with the largest random error of about forty taken off
    least: float
