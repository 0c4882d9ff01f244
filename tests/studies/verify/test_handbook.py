from collections import defaultdict

import numpy as np
import pytest

from stoop_draft.vehicle_draft.geometry import Geometry
from stoop_draft.vehicle_draft.handbook import derivatives
from stoop_studies.verify import handbook


def test_a_priori_derivatives_are_those_that_were_published_within_their_errors() -> None:
    """Of nine airplanes whose geometry is known: root mean square and mean of the errors in standard deviations."""
    z = defaultdict(list)
    for key, airplane in handbook.airplanes().items():
        if "derivatives" in airplane and len(airplane["geometry"]["wing"]) > 3:
            at = airplane["airspeed"], airplane.get("alpha"), airplane["density"]
            found = derivatives(Geometry.of(airplane["geometry"], key), *at)
            for name, published in airplane["derivatives"].items():
                z[name].append((found[name].value - published) / found[name].std)
    counted = {name: np.array(errors) for name, errors in z.items() if len(errors) >= 5}
    assert len(counted) == 21
    for name, errors in counted.items():
        assert np.sqrt(np.mean(errors**2)) < 1.3, name
        assert abs(errors.mean()) < (0.95 if name == "Cmalpha" else 0.5), name


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
    rows = [{"airplane": a, "derivative": "Clp", "measured_z": 1.0 + (a > "a")} for a in "abc"]
    # a: scale from b and c, with one more error of one: sqrt((1 + 4 + 4)/3)
    assert handbook.left_out(rows, "measured")[0] == pytest.approx(1.0 / np.sqrt(3.0))


def test_sizes_keep_the_side_of_an_inverted_tail():
    found = handbook.sizes(handbook.airplanes()["aerosonde"]["geometry"])
    assert found["tail"] == {"dihedral": -0.65}
    assert set(handbook.sizes(handbook.airplanes()["navion"]["geometry"])) == {"template", "mass", "wing"}
