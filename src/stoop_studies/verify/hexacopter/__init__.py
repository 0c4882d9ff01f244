"""A real hexacopter: its forces learned from hover and climbs, and predicted in sprints that were never fitted."""
