"""Optimizers of the studies, for the entry point group ``stoop.optimizers``; importing this loads none of them."""

from __future__ import annotations

from typing import Final

from stoop.optimize.registry import Entry

ENTRIES: Final[dict[str, Entry]] = {
    "ps-gde": Entry("stoop_studies.optimizers.ps_gde:ps_gde"),
    "de-rand-1-bin": Entry("stoop_studies.optimizers.de_rand_1_bin:de_rand_1_bin"),
    "de-best-2-bin": Entry("stoop_studies.optimizers.de_best_2_bin:de_best_2_bin"),
    "weighted-centroid": Entry("stoop_studies.optimizers.weighted_centroid:weighted_centroid"),
    "multi-population": Entry("stoop_studies.optimizers.multi_population:multi_population"),
    "hybrid": Entry("stoop_studies.optimizers.hybrid:hybrid"),
    "trigonometric": Entry("stoop_studies.optimizers.trigonometric:trigonometric"),
    "sacpmde": Entry("stoop_studies.optimizers.sacpmde:sacpmde"),
    "asmde": Entry("stoop_studies.optimizers.asmde:asmde"),
    "derl": Entry("stoop_studies.optimizers.derl:derl"),
    "ga": Entry("stoop_studies.optimizers.ga:GeneticAlgorithm"),
    "pso": Entry("stoop_studies.optimizers.pso:ParticleSwarm"),
    "ordered-shade": Entry("stoop_studies.optimizers.ordered_shade:OrderedShade"),
    "l-shade": Entry("stoop_studies.optimizers.l_shade:l_shade", plans=True),
    "jso": Entry("stoop_studies.optimizers.jso:jso", plans=True),
    "pymoo-ga": Entry("stoop_studies.optimizers.pymoo_loop:pymoo_ga"),
    "pymoo-pso": Entry("stoop_studies.optimizers.pymoo_loop:pymoo_pso"),
    "pygmo-sade": Entry("stoop_studies.optimizers.pygmo_sade:pygmo_sade"),
}
