import pytest

from stoop.errors import IdentificationError
from stoop.optimize import create
from stoop_studies.optimizers.compositions import ps_gde
from stoop_studies.optimizers.evolution import uniform
from stoop_studies.optimizers.local_search import LevenbergMarquardt, PreySchedule, SteepestDescent
from stoop_studies.optimizers.mutation import unordered
from stoop_studies.variants import build


def test_a_variant_exchanges_pieces() -> None:
    for words, made in (
        ("", create("ps-gde")),
        (":scale=0.6", create("ps-gde")),
        (":mutation=unordered:initialization=uniform:search=none", ps_gde(unordered, uniform, None)),
        (":scale=0.5:rate=0.8:members=30", ps_gde(scale=0.5, rate=0.8, members=30)),
        (":search=levenberg:period=5:share=0.1", ps_gde(prey=PreySchedule(LevenbergMarquardt(), 5, 0.1))),
        (":swapped=yes", ps_gde(prey=PreySchedule(SteepestDescent(), swapped=True))),
    ):
        assert build(f"ps-gde{words}") == made
    for name, told in (
        ("ga:scale=0.5", "there are variants of ps-gde only"), ("ps-gde:speed=2", "no speed can be chosen"),
        ("ps-gde:scale=fast", "scale is a number, not 'fast'"),
        ("ps-gde:mutation=magic", "no mutation magic; use one of ordered, unordered"),
    ):  # fmt: skip
        with pytest.raises(IdentificationError, match=told):
            build(name)
