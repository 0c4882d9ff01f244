"""Units of FMI: what is written is read back by ElementTree. FMPy flies them in test_other_simulators."""

import io
import zipfile
from dataclasses import replace
from xml.etree import ElementTree as ET

import numpy as np

from stoop.simulation import Trim, trim
from stoop.vehicle import Vehicle
from stoop_analysis.derivatives import ParameterCovariance
from stoop_export import fmu
from stoop_studies.verify.export import load


def test_delays_are_left_out_and_actuator_numbers_with_them() -> None:
    vehicle = load("crooked")
    starts = {q.name: q.start for q in fmu.make_unit(vehicle, trim(vehicle, None, 200.0)).quantities}
    assert {"CLa", "CLV"} <= set(starts)
    assert not [n for n in starts if n.endswith((".delay", ".rate_limit", ".dead_zone", ".sigma"))]
    assert np.isfinite([*starts.values()]).all()


def test_no_text_of_the_vehicle_reaches_the_source(steady: Trim, twin_boom: Vehicle) -> None:
    odd = replace(twin_boom, file=twin_boom.file.model_copy(update={"name": '*/ "<&>\\'}))
    made = fmu.make_unit(odd, steady)
    content = fmu.unit_bytes(made, "3.0")
    assert content == fmu.unit_bytes(made, "3.0")  # no date
    with zipfile.ZipFile(io.BytesIO(content)) as archive:
        root = ET.fromstring(archive.read("modelDescription.xml"))  # noqa: S314
        assert root.attrib["modelName"] == '*/ "<&>\\'
        assert b"<&>" not in archive.read(f"sources/{made.name}.c")


def test_parameters_say_what_is_known_of_them(twin_boom: Vehicle, steady: Trim) -> None:
    known = ParameterCovariance(("CLalpha", "Cmq"), np.diag([0.01, np.inf]))
    made = fmu.make_unit(twin_boom, steady, known)
    said = {q.name: q.description for q in made.quantities if q.name in ("CLalpha", "Cmq", "Clp")}
    assert said == {"CLalpha": "standard error 0.1", "Cmq": "not identified by the flight", "Clp": ""}
    assert b'description="not identified by the flight"' in fmu.description(made, "2.0")


def test_outputs_are_named_by_their_places(steady: Trim, twin_boom: Vehicle) -> None:
    """FMI 2.0 counts variables from one, 3.0 by their references."""
    made = fmu.make_unit(twin_boom, steady)
    for version in fmu.VERSIONS:
        root = ET.fromstring(fmu.description(made, version))  # noqa: S314 - our own
        variables = list(root.find("ModelVariables") or ())
        assert [v.attrib["valueReference"] for v in variables] == [str(i) for i in range(len(variables))]
        if version == "2.0":
            places = [int(u.attrib["index"]) - 1 for u in root.iterfind("ModelStructure/Outputs/Unknown")]
        else:
            places = [int(u.attrib["valueReference"]) for u in root.iterfind("ModelStructure/Output")]
        assert {variables[i].attrib["causality"] for i in places} == {"output"}
        assert {variables[i].attrib["name"] for i in places} >= {*twin_boom.outputs, "north", "east"}
        start = {v.attrib["name"]: v if version == "3.0" else v[0] for v in variables}["Cmq"].attrib
        assert (float(start["start"]), start["unit"]) == (twin_boom.value("Cmq"), "1")
