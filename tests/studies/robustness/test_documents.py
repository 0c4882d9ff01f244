"""Hostile documents in little, and the bounds that hold for every document that stoop reads."""

from __future__ import annotations

import io
import json
import os
import sqlite3
import tomllib
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from studies.robustness import documents, kept_files
from studies.robustness.hostile import Again, Raw, damaged_trees, to_json, to_toml
from studies.robustness.small_runs import inputs

from stoop.assessment.uncertainty import agreement
from stoop.base import cache
from stoop.base.npz import read_arrays
from stoop.base.toml import MAX_DEPTH, check_bounds, parse_json, parse_source
from stoop.errors import IdentificationError, OutputError, StoopError, VehicleError
from stoop.estimate.noise import read_covariance
from stoop.optimize import create, load_tagged, minimize, save_state
from stoop.optimize.minimize import Stop
from stoop.parallel import store
from stoop.parallel.store import open_store
from stoop.results.result import MAX_BYTES, from_json, read_result
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop.workflow.load import load
from stoop.workflow.outputs import ARCHIVES, ATTACHED


def test_what_is_written_is_what_stood_in_the_tree() -> None:
    content = {"a": 1, "b": {"c": [1.5, 'x\n\x1b"'], "d e": {"f": True}}, "g": [{"h": -1}, {"h": 2}]}
    assert tomllib.loads(to_toml(content).decode()) == content
    assert json.loads(to_json(content)) == content
    assert to_json({"a": Raw("1e999"), Again('"a"'): None}) == b'{"a": 1e999, "a": null}'


@given(damaged_trees([{"a": 1, "b": {"c": [1.5, "x"]}}]))
def test_a_damaged_tree_can_be_written(tree: object) -> None:
    assert to_toml(tree) is not None
    assert to_json(tree)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (".".join(["a"] * 20_000) + " = 1", "parts"),
        (". ".join(['"a"'] * 20_000) + " = 1", "parts"),
        ("# '''\n" + "[" + "a." * 20_000 + "b]", "parts"),
        ("a = {" + "b.c." * 100 + "d = 1}", "parts"),
        ("a = " + "[" * (MAX_DEPTH + 2) + "]" * (MAX_DEPTH + 2), "deep"),
        ("a = " + "[" * 100_000, "recursion"),
        ("a = 1" + "0" * 400, "308 digits"),
        ("a = " + "9" * 5000, "4300"),
    ],
)
def test_toml_beyond_its_bounds_is_refused_at_once(text: str, said: str) -> None:
    with pytest.raises(VehicleError, match=said):
        parse_source(text, "v.toml", VehicleError)


@pytest.mark.parametrize(
    "text",
    [
        "# " + "." * 500 + "\na = 1",
        'a = "' + "x." * 500 + '"',
        "a = '''\n" + "x." * 500 + "\n'''",
        'a = """' + "x. " * 500 + '\\""""',
        "a = [" + ", ".join(["0.5"] * 500) + "]",
        "# don't = [\na = 1e308\nb = " + "[" * 60 + "]" * 60,
    ],
)
def test_toml_within_its_bounds_is_read(text: str) -> None:
    assert parse_source(text, "v.toml", VehicleError) == tomllib.loads(text)


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "[" * 70 + "]" * 70, "1" + "0" * 400, '{"a": [-1' + "0" * 310 + "]}", "x"]
)
def test_json_beyond_its_bounds_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"deep|digits|Expecting"):
        parse_json(text)
    with pytest.raises(StoopError, match="no JSON that can be read"):
        from_json(text)


def test_what_a_float_can_hold_is_within_bounds() -> None:
    check_bounds([2**1022, -(2**1022), True, None, 1e308, {"a": [{}]}])
    with pytest.raises(ValueError, match="b: an integer of more than 308 digits"):
        check_bounds({"a": {"b": [2**1023], "c": [1]}})


def test_a_message_is_short_whatever_it_quotes() -> None:
    with pytest.raises(VehicleError) as caught:
        parse_vehicle(f'{"k" * 900_000} = 1\nname = "a"', "v.toml")
    assert len(str(caught.value)) < 5000
    assert str(caught.value).endswith("more)")


NOTICE = {"code": "residuals-colored", "severity": "info", "subject": "", "values": {"samples": 5.0}}


def test_a_short_maneuver_does_not_take_minutes() -> None:
    from stoop.errors import ManeuverError
    from stoop.simulation.maneuver import parse_maneuver

    wave = '[[input]]\ncontrol = "elevator"\nshape = "multisine"\nstart = 0.0\namplitude = 0.1\nduration = 1000.0\nband = 1.0\n'
    step = '[[input]]\ncontrol = "elevator"\nshape = "pulse"\nstart = 0.0\namplitude = 0.1\nduration = 1.0\n'
    assert parse_maneuver(f"duration = 1000.0\n{wave}", "m.toml").input[0].waves == 1000
    for given_inputs in (wave, step * 100):
        with pytest.raises(ManeuverError, match="times samples"):
            parse_maneuver(f"duration = 30000.0\n{given_inputs}", "m.toml")


def test_a_vehicle_has_some_loadings_at_most() -> None:
    text = builtin_text("twin-boom")
    lines = [f"\n[loadings.a{i}]\n'mass.mass' = 1000.0" for i in range(65)]
    assert len(parse_vehicle(text + "".join(lines[:64]), "v.toml").file.loadings) == 64
    with pytest.raises(VehicleError, match="too many entries"):
        parse_vehicle(text + "".join(lines), "v.toml")


def _document() -> dict[str, Any]:
    return documents.kept_results()[0]


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda d: d.update(cost="12"), "float"),
        (lambda d: d.update(cost=True), "float"),
        (lambda d: d.update(seed=1.5), "int"),
        (lambda d: d.update(optimizer=[]), "str"),
        (lambda d: d["parameters"]["CLalpha"].update(at_bound="no"), "bool"),
        (lambda d: d.update(notices=[NOTICE | {"values": {}}]), "samples"),
        (lambda d: d.update(notices=[NOTICE | {"severity": "loud"}]), "severity"),
        (lambda d: d.update(notices=[NOTICE | {"values": {"samples": "x"}}]), "malformed"),
    ],
)
def test_results_of_other_types_are_refused(change: Callable[[dict[str, object]], None], said: str) -> None:
    document = _document()
    from_json(json.dumps(document))
    change(document)
    with pytest.raises(StoopError, match=said):
        from_json(json.dumps(document))


def test_priors_of_no_width_overflow_nothing() -> None:
    document = _document()
    for one in document["parameters"].values():
        one.update(prior_std=1e-300, std_error=1.0, identifiable=True, at_bound=False)
    document["uncertainty"] = {}
    one = from_json(json.dumps(document))
    document["inputs"] = {}  # of other flights
    other = from_json(json.dumps(document))
    found = agreement({"a": one, "b": other})
    assert not any(single.counted for p in found.parameters.values() for single in p.singles)


def test_a_result_of_many_megabytes_is_not_read(tmp_path: Path) -> None:
    path = tmp_path / "result.json"
    path.touch()
    with path.open("r+b") as file:
        file.truncate(MAX_BYTES + 1)  # sparse
    with pytest.raises(StoopError, match="larger than"):
        read_result(path)


def test_a_packed_bomb_does_not_unfold(tmp_path: Path) -> None:
    path = tmp_path / "search.npz"
    path.write_bytes(kept_files.bomb("header.npy"))
    assert path.stat().st_size < 2**22
    with pytest.raises(IdentificationError, match="unfolds to more than 256 MiB"):
        load_tagged(path)


def test_states_are_packed_in_several_ways_and_understated() -> None:
    packings, sizes = set(), set()
    for size in range(100):
        tree = {**kept_files.kept_states()[0], "header": "x" * size}
        with zipfile.ZipFile(io.BytesIO(kept_files.write_state(tree))) as archive:
            members = archive.infolist()
        packings |= {one.compress_type for one in members}
        sizes |= {(one.filename, one.file_size) for one in members[:1]}
    assert packings == {zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED, zipfile.ZIP_BZIP2}
    assert len(sizes) == 2, "of the first member another size is stated"


def _archive(head: str, data: bytes = b"") -> io.BytesIO:
    sink = io.BytesIO()
    text = head.encode() + b"\n"
    with zipfile.ZipFile(sink, "w") as archive:
        archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text + data)
    return sink


@pytest.mark.parametrize(
    "head",
    [
        "{'descr': '<f8', 'fortran_order': False, 'shape': (1099511627776,), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (4611686018427387904, 4), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (-1,), }",
        "{'descr': '|O', 'fortran_order': False, 'shape': (1,), }",
        "{'descr': '|V0', 'fortran_order': False, 'shape': (3,), }",
        "{'descr': 'a8', 'fortran_order': False, 'shape': (1,), }",
        "{'descr': '<f8', 'fortran_order': False, 'shape': (007,), }",
        "x",
    ],
)
def test_arrays_that_are_not_there_are_not_made(head: str) -> None:
    with pytest.raises(ValueError, match=r"an array|[Hh]eader"):
        read_arrays(_archive(head, bytes(8)), 2**20)


def test_arrays_come_back_as_numpy_wrote_them() -> None:
    arrays = {
        "a": np.arange(6.0).reshape(2, 3),
        "b": np.asfortranarray(np.eye(3)),
        "c": np.array(["x", "yz"]),
    }
    arrays |= {"d": np.empty((0, 4)), "e": np.array(2)}
    for write in (np.savez, np.savez_compressed):
        sink = io.BytesIO()
        write(sink, **arrays)  # type: ignore[arg-type]
        found = read_arrays(sink, 2**20)
        assert list(found) == list(arrays)
        for name, values in arrays.items():
            assert found[name].dtype == values.dtype
            assert found[name].flags.writeable
            assert found[name].strides == values.strides  # sums in another order have other bits
            np.testing.assert_array_equal(found[name], values)


@pytest.mark.parametrize(
    ("field", "value"),
    [("generation", "3"), ("generation", True), ("optima", None), ("queue", 1.0), ("passed", 1)],
)
def test_a_state_of_other_types_is_refused(tmp_path: Path, field: str, value: object) -> None:
    path = tmp_path / "s.npz"
    state = create().init(kept_files.Bowl(), 1, np.empty((0, 3)))
    save_state(path, state)
    with np.load(path) as file:
        arrays = dict(file)
    header = json.loads(arrays["header"].tobytes())
    header["state"]["fields"][field] = value
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)
    np.savez(path, **arrays)  # type: ignore[arg-type]
    with pytest.raises(IdentificationError, match=field):
        load_tagged(path)


def test_a_state_from_which_no_search_can_go_on_is_one_error() -> None:
    from dataclasses import replace

    state = create().init(kept_files.Bowl(), 1, np.empty((0, 3)))
    broken = replace(state, starts=np.zeros((1, 9)))
    with pytest.raises(IdentificationError, match="cannot continue from the saved state"):
        minimize(create(), kept_files.Bowl(), seed=1, state=broken, stop=Stop(generations=3))


@pytest.mark.parametrize("statement", [s for s in kept_files.STATEMENTS if "TRIGGER" in s or "VIEW" in s])
def test_a_store_with_views_or_triggers_is_refused(tmp_path: Path, statement: str) -> None:
    path = tmp_path / "runs.sqlite"
    sound = kept_files.write_store(kept_files.kept_stores()[0])
    path.write_bytes(sound)
    with open_store(path, kept_files.PLAN, kept_files.ENVIRONMENT) as opened:
        assert len(opened.missing(kept_files.PLAN.runs)) == 1
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(statement)
    with (
        pytest.raises(OutputError, match=r"damaged|no store"),
        open_store(path, kept_files.PLAN, kept_files.ENVIRONMENT),
    ):
        pass


def test_a_store_with_a_huge_result_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "MAX_BYTES", 3000)
    path = tmp_path / "runs.sqlite"
    path.write_bytes(kept_files.write_store(kept_files.kept_stores()[0]))
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript("UPDATE runs SET result = zeroblob(5000)")
    with (
        pytest.raises(OutputError, match="too big"),
        open_store(path, kept_files.PLAN, kept_files.ENVIRONMENT) as opened,
    ):
        opened.results(kept_files.PLAN.runs)


def test_a_store_whose_texts_are_none_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "runs.sqlite"
    content = kept_files.write_store(kept_files.kept_stores()[0])
    path.write_bytes(content.replace(b"table", b"tabl\xd4"))
    with (
        pytest.raises(OutputError, match=r"damaged|no store"),
        open_store(path, kept_files.PLAN, kept_files.ENVIRONMENT),
    ):
        pass


def test_a_cache_with_a_file_of_many_megabytes_is_not_read(tmp_path: Path) -> None:
    tmp_path.chmod(0o700)
    (tmp_path / "a").touch(mode=0o600)
    with (tmp_path / "a").open("r+b") as file:
        file.truncate(cache.MAX_BYTES + 1)  # sparse
    assert not cache.intact(tmp_path)


def test_an_empty_covariance_is_one_error(tmp_path: Path) -> None:
    path = tmp_path / "c.csv"
    path.write_text("\n\n")
    with pytest.raises(IdentificationError, match="cannot be read as numbers"):
        read_covariance(path, ("p", "q"))


ENDLESS: dict[str, Callable[[Path], None]] = {
    "a link to an endless device": lambda path: path.symlink_to("/dev/zero"),
    "a pipe": os.mkfifo,
    "holes of a gigabyte": lambda path: [path.touch(), os.truncate(path, 2**30)][0],
    "a folder": Path.mkdir,
}


@pytest.mark.parametrize("way", ENDLESS)
@pytest.mark.parametrize("name", [*ARCHIVES, *ATTACHED])
def test_what_lies_beside_a_result_is_counted_while_it_is_read(name: str, way: str, tmp_path: Path) -> None:
    for place in ("result.json", "vehicle.toml", "flight.nc"):
        (tmp_path / place).write_bytes(inputs()[f"model/{place}"])
    assert load(tmp_path).flights
    ENDLESS[way](tmp_path / name)
    with pytest.raises(StoopError, match=rf"{name}: cannot be read \(.*\); remove it, or fit again$"):
        load(tmp_path)
