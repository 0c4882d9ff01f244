"""What a flight shows of a vehicle without a fit: the drag polar, and loss of effectiveness of rotors."""
