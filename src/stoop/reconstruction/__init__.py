"""Whether a flight's channels agree with each other: flight-path reconstruction, delays, the drag polar."""
