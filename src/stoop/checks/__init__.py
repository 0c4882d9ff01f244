"""Whether flights are of the vehicle of a file, and show what is estimated."""
