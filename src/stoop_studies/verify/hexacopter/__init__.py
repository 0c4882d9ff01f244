"""A real hexacopter: its forces told from hover and climbs, and predicted in sprints that were never fitted."""
