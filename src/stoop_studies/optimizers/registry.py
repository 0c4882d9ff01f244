"""Optimizers of the studies, for the entry point group ``stoop.optimizers``; importing this loads none of them."""

from __future__ import annotations

from typing import Final

from stoop.optimize.registry import Entry

PLACE: Final = "stoop_studies.optimizers"
POPULATION: Final = f"{PLACE}.evolution:PopulationState"
EVOLUTIONS: Final = (
    "ps-gde", "de-rand-1-bin", "de-best-2-bin", "weighted-centroid", "multi-population", "hybrid", "trigonometric", "sacpmde",
    "asmde", "derl",
)  # fmt: skip
ENTRIES: Final[dict[str, Entry]] = {
    **{
        name: Entry(f"{PLACE}.compositions:{name.replace('-', '_')}", state=POPULATION) for name in EVOLUTIONS
    },
    "ga": Entry(f"{PLACE}.ga:GeneticAlgorithm", state=POPULATION),
    "pso": Entry(f"{PLACE}.pso:ParticleSwarm", state=f"{PLACE}.pso:SwarmState"),
    "ordered-shade": Entry(f"{PLACE}.shade:OrderedShade", state=f"{PLACE}.shade:OrderedShadeState"),
    "l-shade": Entry(f"{PLACE}.shade:LShade", plans=True, state=f"{PLACE}.shade:ShadeState"),
    "jso": Entry(f"{PLACE}.shade:JSO", plans=True, state=f"{PLACE}.shade:ShadeState"),
    "pymoo-ga": Entry(f"{PLACE}.libraries:pymoo_ga"),
    "pymoo-pso": Entry(f"{PLACE}.libraries:pymoo_pso"),
    "pygmo-sade": Entry(f"{PLACE}.libraries:pygmo_sade"),
}
