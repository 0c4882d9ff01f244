import io
import json
import os
import sqlite3
import struct
import tomllib
import zipfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from robustness.corpus import cases
from robustness.documents import ENVIRONMENT, PLAN, Bowl
from robustness.small_runs import inputs

from stoop.base import cache
from stoop.base.npz import read_arrays
from stoop.base.toml import MAX_DEPTH, check_bounds, parse_json, parse_source
from stoop.errors import IdentificationError, ManeuverError, OutputError, StoopError, VehicleError
from stoop.optimize import create, load_tagged, minimize, save_state
from stoop.optimize.minimize import Stop
from stoop.parallel import store
from stoop.parallel.store import open_store
from stoop.results.result import MAX_BYTES, from_json, read_result
from stoop.simulation.maneuver import parse_maneuver
from stoop.vehicle import parse_vehicle
from stoop.vehicle.builtin import builtin_text
from stoop.workflow.load import load
from stoop.workflow.outputs import ARCHIVES, ATTACHED


def test_bounds_of_texts() -> None:
    for text, word in (
        (". ".join(['"a"'] * 20_000) + " = 1", "parts"), ("# '''\n" + "[" + "a." * 20_000 + "b]", "parts"),
        ("a = " + "[" * (MAX_DEPTH + 2) + "]" * (MAX_DEPTH + 2), "deep"), ("a = " + "[" * 100_000, "recursion"),
        ("a = 1" + "0" * 400, "308 digits"), ("a = " + "9" * 5000, "4300"),
    ):  # fmt: skip
        with pytest.raises(VehicleError, match=word):
            parse_source(text, "v.toml", VehicleError)
    for text in (f"a = [{'0.5, ' * 500}]", "# don't = [\na = 1e308\nb = " + "[" * 60 + "]" * 60):
        assert parse_source(text, "v.toml", VehicleError) == tomllib.loads(text)
    for text in ("[" * 100_000, "[" * 70 + "]" * 70, "1" + "0" * 400, '{"a": [-1' + "0" * 310 + "]}", "x"):
        with pytest.raises(ValueError, match=r"deep|digits|Expecting"):
            parse_json(text)
        with pytest.raises(StoopError, match="no JSON that can be read"):
            from_json(text)
    check_bounds([2**1022, -(2**1022), True, None, 1e308, {"a": [{}]}])
    with pytest.raises(ValueError, match="b: an integer of more than 308 digits"):
        check_bounds({"a": {"b": [2**1023], "c": [1]}})
    with pytest.raises(VehicleError) as caught:
        parse_vehicle(f'{"k" * 900_000} = 1\nname = "a"', "v.toml")
    assert len(str(caught.value)) < 5000, "a message is short whatever it quotes"


def test_a_maneuver_takes_no_minutes_and_a_vehicle_has_64_loadings() -> None:
    one = '[[input]]\ncontrol = "elevator"\nstart = 0.0\namplitude = 0.1\nshape = '
    wave, step = f'{one}"multisine"\nduration = 1000.0\nband = 1.0\n', f'{one}"pulse"\nduration = 1.0\n'
    assert parse_maneuver(f"duration = 1000.0\n{wave}", "m.toml").input[0].waves == 1000
    for text in (wave, step * 100):
        with pytest.raises(ManeuverError, match="times samples"):
            parse_maneuver(f"duration = 30000.0\n{text}", "m.toml")
    lines = [f"\n[loadings.a{i}]\n'mass.mass' = 1000.0" for i in range(65)]
    vehicle = builtin_text("twin-boom") + "".join(lines[:64])
    assert len(parse_vehicle(vehicle, "v.toml").file.loadings) == 64
    with pytest.raises(VehicleError, match="too many entries"):
        parse_vehicle(vehicle + lines[64], "v.toml")


def test_results_of_other_types_are_refused() -> None:
    case = next(case for case in cases("document:result") if case.outcome == "read")
    sound = json.loads(case.files[case.entry])
    notice = {"code": "residuals-colored", "severity": "info", "subject": "", "values": {"samples": 5.0}}
    from_json(json.dumps(sound | {"notices": [notice]}))
    for change, word in (
        ({"cost": "12"}, "float"), ({"cost": True}, "float"), ({"seed": 1.5}, "int"), ({"optimizer": []}, "str"),
        ({"notices": [notice | {"values": {}}]}, "samples"), ({"notices": [notice | {"severity": "loud"}]}, "severity"),
        ({"notices": [notice | {"values": {"samples": "x"}}]}, "malformed"),
    ):  # fmt: skip
        with pytest.raises(StoopError, match=word):
            from_json(json.dumps(sound | change))


def sparse(path: Path, size: int) -> Path:
    path.touch(mode=0o600)
    os.truncate(path, size)
    return path


def test_files_of_many_megabytes_are_not_read(tmp_path: Path) -> None:
    with pytest.raises(StoopError, match="larger than"):
        read_result(sparse(tmp_path / "result.json", MAX_BYTES + 1))
    folder = tmp_path / "cache"
    folder.mkdir(mode=0o700)
    sparse(folder / "a", cache.MAX_BYTES + 1)
    assert not cache.intact(folder)
    np.savez(tmp_path / "search.npz", header=np.zeros(4))
    content = bytearray((tmp_path / "search.npz").read_bytes())
    size = content.index(b"PK\x01\x02") + 24
    content[size : size + 4] = struct.pack("<I", 2**29)
    (tmp_path / "search.npz").write_bytes(content)
    with pytest.raises(IdentificationError, match="unfolds to more than 256 MiB"):
        load_tagged(tmp_path / "search.npz")


def test_arrays_that_are_not_there_are_not_made_and_others_come_back() -> None:
    for kind, shape in (
        ("<f8", "(1099511627776,)"), ("<f8", "(4611686018427387904, 4)"), ("<f8", "(-1,)"), ("|O", "(1,)"), ("|V0", "(3,)"),
        ("a8", "(1,)"), ("<f8", "(007,)"),
    ):  # fmt: skip
        text = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}\n".encode()
        sink = io.BytesIO()
        with zipfile.ZipFile(sink, "w") as archive:
            archive.writestr("a.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + bytes(8))
        with pytest.raises(ValueError, match=r"an array|[Hh]eader"):
            read_arrays(sink, 2**20)
    arrays = {
        "a": np.arange(6.0).reshape(2, 3), "b": np.asfortranarray(np.eye(3)), "c": np.array(["x", "yz"]),
        "d": np.empty((0, 4)), "e": np.array(2),
    }  # fmt: skip
    for write in (np.savez, np.savez_compressed):
        sink = io.BytesIO()
        write(sink, **arrays)  # type: ignore[arg-type]
        found = read_arrays(sink, 2**20)
        assert list(found) == list(arrays)
        for name, x in arrays.items():
            own = found[name]
            assert (own.dtype, own.strides, own.flags.writeable) == (x.dtype, x.strides, True)
            np.testing.assert_array_equal(own, x)


def test_a_state_of_other_types_or_shapes_is_one_error(tmp_path: Path) -> None:
    path, state = tmp_path / "s.npz", create().init(Bowl(), 1, np.empty((0, 3)))
    save_state(path, state)
    with np.load(path) as file:
        arrays = dict(file)
    changes = (("generation", "3"), ("generation", True), ("optima", None), ("queue", 1.0), ("passed", 1))
    for field, value in changes:
        header = json.loads(arrays["header"].tobytes())
        header["state"]["fields"][field] = value
        changed = {**arrays, "header": np.frombuffer(json.dumps(header).encode(), dtype=np.uint8)}
        np.savez(path, **changed)  # type: ignore[arg-type]
        with pytest.raises(IdentificationError, match=field):
            load_tagged(path)
    broken = replace(state, starts=np.zeros((1, 9)))
    with pytest.raises(IdentificationError, match="cannot continue from the saved state"):
        minimize(create(), Bowl(), seed=1, state=broken, stop=Stop(generations=3))


ENDLESS_VIEW = "WITH RECURSIVE c(n) AS (SELECT 1 UNION ALL SELECT n + 1 FROM c) SELECT n, n, n, n FROM c"
TAMPERED = {
    "trigger": "CREATE TRIGGER t AFTER INSERT ON meta BEGIN DELETE FROM runs; END",
    "endless view": f"DROP TABLE runs; CREATE VIEW runs (key, identity, result, checksum) AS {ENDLESS_VIEW}",
    "huge view": "DROP TABLE meta; CREATE VIEW meta AS SELECT 'schema' AS name, zeroblob(900000000) AS value, '' AS checksum",
    "huge result": "UPDATE runs SET result = zeroblob(5000)",
    "text that is none": "",
}


@pytest.mark.parametrize("way", TAMPERED)
def test_a_store_that_was_tampered_with_is_refused(way: str, tmp_path: Path, monkeypatch: Any) -> None:
    path = tmp_path / "runs.sqlite"
    with open_store(path, PLAN, ENVIRONMENT) as opened:
        opened.add(PLAN.runs[:2], ['{"y":1.5}'] * 2)
    monkeypatch.setattr(store, "MAX_BYTES", 3000)
    with closing(sqlite3.connect(path)) as connection:
        connection.executescript(TAMPERED[way])
    if not TAMPERED[way]:
        path.write_bytes(path.read_bytes().replace(b"table", b"tabl\xd4"))
    refused = pytest.raises(OutputError, match=r"damaged|no store|too big")
    with refused, open_store(path, PLAN, ENVIRONMENT) as opened:
        opened.results(PLAN.runs)


ENDLESS: dict[str, Callable[[Path], object]] = {
    "a link to an endless device": lambda path: path.symlink_to("/dev/zero"),
    "a pipe": os.mkfifo, "holes of a gigabyte": lambda path: sparse(path, 2**30), "a folder": Path.mkdir,
}  # fmt: skip


@pytest.mark.parametrize("way", ENDLESS)
def test_files_beside_a_result_are_counted_while_they_are_read(way: str, tmp_path: Path) -> None:
    for name in (*ARCHIVES, *ATTACHED):
        folder = tmp_path / name
        folder.mkdir()
        for place in ("result.json", "vehicle.toml", "flight.nc"):
            (folder / place).write_bytes(inputs()[f"model/{place}"])
        ENDLESS[way](folder / name)
        with pytest.raises(StoopError, match=rf"{name}: cannot be read \(.*\); remove it, or fit again$"):
            load(folder)
