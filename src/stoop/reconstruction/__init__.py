"""Whether the channels of a flight agree with each other: flight-path reconstruction and delays."""
