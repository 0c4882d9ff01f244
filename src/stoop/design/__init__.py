"""What to fly next: inputs that make the error bars small."""
