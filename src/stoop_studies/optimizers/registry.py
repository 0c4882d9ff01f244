"""Optimizers of the studies, for the entry point group ``stoop.optimizers``; importing this loads none of them."""

from __future__ import annotations

from typing import Final

from stoop.optimize.registry import Entry

ENTRIES: Final[dict[str, Entry]] = {
    "ps-gde": Entry("stoop_studies.optimizers.compositions:ps_gde"),
    "de-rand-1-bin": Entry("stoop_studies.optimizers.compositions:de_rand_1_bin"),
    "de-best-2-bin": Entry("stoop_studies.optimizers.compositions:de_best_2_bin"),
    "weighted-centroid": Entry("stoop_studies.optimizers.compositions:weighted_centroid"),
    "multi-population": Entry("stoop_studies.optimizers.compositions:multi_population"),
    "hybrid": Entry("stoop_studies.optimizers.compositions:hybrid"),
    "trigonometric": Entry("stoop_studies.optimizers.compositions:trigonometric"),
    "sacpmde": Entry("stoop_studies.optimizers.compositions:sacpmde"),
    "asmde": Entry("stoop_studies.optimizers.compositions:asmde"),
    "derl": Entry("stoop_studies.optimizers.compositions:derl"),
    "ga": Entry("stoop_studies.optimizers.ga:GeneticAlgorithm"),
    "pso": Entry("stoop_studies.optimizers.pso:ParticleSwarm"),
    "ordered-shade": Entry("stoop_studies.optimizers.ordered_shade:OrderedShade"),
    "l-shade": Entry("stoop_studies.optimizers.l_shade:l_shade", plans=True),
    "jso": Entry("stoop_studies.optimizers.l_shade:jso", plans=True),
    "pymoo-ga": Entry("stoop_studies.optimizers.libraries:pymoo_ga"),
    "pymoo-pso": Entry("stoop_studies.optimizers.libraries:pymoo_pso"),
    "pygmo-sade": Entry("stoop_studies.optimizers.libraries:pygmo_sade"),
}
