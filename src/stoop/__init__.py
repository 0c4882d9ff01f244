"""stoop: from a flight log to a flight-dynamics model one can trust."""
