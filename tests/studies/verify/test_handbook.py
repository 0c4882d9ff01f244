import numpy as np
import pytest

from stoop.errors import StoopError
from stoop.vehicle_draft.geometry import Geometry
from stoop.vehicle_draft.proportions import PROPORTIONS, quarter_chord
from stoop_studies.verify import handbook


def test_a_missing_folder_is_one_line():
    with pytest.raises(
        StoopError, match=r"name the folder that holds x8-parameters/x8_param.mat by --data DIR"
    ):
        handbook.published("x8", None)


def test_numbers_of_a_folder_are_scaled(tmp_path):
    """The first table of the YAML file, with the factor of the table of airplanes: per degree to per rad, and the sign."""
    folder = tmp_path / "a430-micro-fixedwing-mocap"
    folder.mkdir()
    names = {own for own, _ in handbook.airplanes()["a430"]["published"].values()}
    lines = ["current:", "  # aero", *(f"  {n}: 2.0" for n in sorted(names)), "to_optimize:", "  CLal: 9.0"]
    (folder / "prior_parameters_all.yaml").write_text("\n".join(lines))
    found = handbook.published("a430", tmp_path)
    assert found["CLalpha"] == 2.0
    assert found["Claileron"] == pytest.approx(-np.rad2deg(2.0), rel=1e-5)


def test_left_out_scales_by_the_others():
    rows = [
        {"airplane": a, "derivative": "Clp", "measured_z": z} for a, z in (("a", 1.0), ("b", 2.0), ("c", 2.0))
    ]
    # a: scale from b and c, with one more error of one: sqrt((1 + 4 + 4)/3)
    assert handbook.left_out(rows, "measured")[0] == pytest.approx(1.0 / np.sqrt(3.0))


def test_sizes_keep_the_side_of_an_inverted_tail():
    found = handbook.sizes(handbook.airplanes()["aerosonde"]["geometry"])
    assert found["tail"] == {"dihedral": -0.65}
    assert set(handbook.sizes(handbook.airplanes()["navion"]["geometry"])) == {"template", "mass", "wing"}


def test_typical_proportions_are_those_of_airplanes():
    """The mean of the measured airplanes lies within the standard deviation of each typical number."""
    measured = [a for a in handbook.airplanes().values() if len(a["geometry"]["wing"]) > 3]
    found = {"arm": [], "tail_volume": [], "body_length": [], "body_width": [], "dihedral": [], "taper": []}
    for airplane in measured:
        g = Geometry.of(airplane["geometry"], airplane["name"])
        arm, size = g.center_of_gravity[0] - quarter_chord(g.tail), np.sqrt(g.wing.area)
        found["arm"].append(arm / size)
        found["tail_volume"].append(g.tail.area * arm / (g.wing.area * g.wing.chord))
        found["body_length"].append(g.fuselage.length / size)
        found["body_width"].append(g.fuselage.width / size)
        found["dihedral"].append(g.wing.dihedral)
        found["taper"].append(g.wing.taper)
    for name, numbers in found.items():
        value, std = getattr(PROPORTIONS["conventional"], name)
        assert abs(np.mean(numbers) - value) < std, name
