"""States of interrupted searches, made hostile: arrays with their types and shapes, packed, whatever they say."""

from __future__ import annotations

import io
import json
import struct
import warnings
import zipfile
import zlib
from functools import cache
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np

from stoop.base.arrays import FloatArray
from stoop.optimize import State, create, load_tagged, minimize, save_state
from stoop.optimize.minimize import Stop
from stoop_studies.robustness.document_trees import (
    Branch,
    Node,
    Raw,
    hostile,
    to_json,
    tree_of,
)
from stoop_studies.robustness.log_grammars import Draw
from stoop_studies.robustness.trials import READ, BrokenPromiseError

DESCRS: Final = (
    "<f8",
    ">f8",
    "<f4",
    "<i8",
    "|b1",
    "|O",
    "<U8",
    "|V8",
    "|S0",
    "<U0",
    "<c16",
    "<M8[s]",
    "[('a', '<f8')]",
    "|V0",
    "<f16",
)
EXTENTS: Final = (0, 1, 2, 3, 7, 1000, 2**31, 2**40, 2**62, -1)
BLOCK: Final = 2**20  #: bytes of zeros that a packed member repeats
BOMB: Final = 1200  #: such blocks, which unfold to more than a gigabyte
PACKINGS: Final = {
    zipfile.ZIP_STORED: 0.79,
    zipfile.ZIP_DEFLATED: 0.2,
    zipfile.ZIP_BZIP2: 0.01,
}  #: how an archive is packed -> share
UNDERSTATED: Final = 0.02  #: share of the archives with a member that states half of its size


class Bowl:
    """A cheap problem: a bowl with a nuisance and two rungs."""

    dimension, extra, prices = 3, 1, (0.25, 1.0)

    def residuals(self, Z: FloatArray, rung: int) -> FloatArray:
        """Return residuals (B, 5)."""
        return np.column_stack([Z - 0.3, np.sin(3.0 * Z[:, 0])])

    def costs(self, X: FloatArray, rung: int) -> FloatArray:
        """Return costs (B,)."""
        Z = np.column_stack([X, np.zeros(len(X))])
        return np.asarray(np.sum(self.residuals(Z, rung) ** 2, axis=1))

    def jacobian(self, z: FloatArray, rung: int, r: FloatArray) -> tuple[FloatArray, float]:
        """Return derivatives (5, 4)."""
        return np.vstack([np.eye(4), [3.0 * np.cos(3.0 * z[0]), 0.0, 0.0, 0.0]]), 1.0

    def reference(self, rung: int) -> float:
        """Return the cost of the trivial model."""
        return 1.0


def _npy(node: Node) -> bytes:
    """Return an array as a file holds it, whatever its head says."""
    parts: dict[str, Any] = dict(node.pairs) if isinstance(node, Branch) else {"data": node}
    shape = parts.get("shape", 0)
    extents = (
        f"({' '.join(f'{_literal(n)},' for n in shape)})" if isinstance(shape, list) else _literal(shape)
    )
    descr, order = _literal(parts.get("descr")), _literal(parts.get("fortran_order"))
    head = f"{{'descr': {descr}, 'fortran_order': {order}, 'shape': {extents}, }}"
    text = head.encode("utf-8", "replace")[:60_000] + b"\n"
    data = parts.get("data")
    try:
        content = (
            bytes.fromhex(data) if isinstance(data, str) else repr(data).encode("utf-8", "replace")[:10_000]
        )
    except ValueError:
        content = str(data).encode("utf-8", "replace")
    return b"\x93NUMPY\x01\x00" + struct.pack("<H", len(text)) + text + content


def _literal(node: Node) -> str:
    """Return a node as Python writes it; raw text as it is."""
    return node.text if isinstance(node, Raw) else repr(node)[:20_000]


@cache
def _zeros() -> tuple[bytes, bytes]:
    """Return a packed block of zeros that can be repeated, and the end of such a stream."""
    packer = zlib.compressobj(9, zlib.DEFLATED, -15)
    packer.compress(bytes(BLOCK))
    packer.flush(zlib.Z_FULL_FLUSH)
    return packer.compress(bytes(BLOCK)) + packer.flush(zlib.Z_FULL_FLUSH), packer.flush()


def bomb(name: str, stated: int = BLOCK * BOMB) -> bytes:
    """Return a zip with one member of zeros that unfolds to a gigabyte, and states a size."""
    block, end = _zeros()
    packed = block * BOMB + end
    head = struct.pack("<HHHHHIII", 20, 0, 8, 0, 33, 0, len(packed), stated)
    local = b"PK\x03\x04" + head + struct.pack("<HH", len(name), 0) + name.encode()
    central = (
        b"PK\x01\x02\x14\x00" + head + struct.pack("<HHHHHII", len(name), 0, 0, 0, 0, 0, 0) + name.encode()
    )
    start = len(local) + len(packed)
    tail = b"PK\x05\x06" + struct.pack("<HHHHIIH", 0, 0, 1, 1, len(central), start, 0)
    return local + packed + central + tail


def write_state(node: Node, rng: Random) -> bytes:
    """Write an archive of arrays; now and then one that unfolds to more than it states, or to a gigabyte."""
    parts: dict[str, Any] = dict(node.pairs) if isinstance(node, Branch) else {}
    if rng.random() < 0.01:
        return bomb(rng.choice(("header.npy", "a0.npy", "x")), rng.choice((BLOCK * BOMB, BLOCK)))
    header = to_json(parts.get("header"), rng)
    sink = io.BytesIO()
    arrays = parts.get("arrays")
    members = list(arrays.pairs) if isinstance(arrays, Branch) else []
    (packing,) = rng.choices(tuple(PACKINGS), tuple(PACKINGS.values()))
    with warnings.catch_warnings(), zipfile.ZipFile(sink, "w") as archive:
        warnings.simplefilter("ignore")  # two members may have one name
        for name, one in members:
            info = zipfile.ZipInfo(f"{name[:200]}.npy".encode("ascii", "replace").decode())
            archive.writestr(info, _npy(one), packing)
        whole = Branch(
            [("descr", "|u1"), ("fortran_order", False), ("shape", [len(header)]), ("data", header.hex())]
        )
        archive.writestr(zipfile.ZipInfo("header.npy"), _npy(whole), packing)
        if rng.random() < UNDERSTATED:  # in the directory, which is written at the end
            rng.choice(archive.infolist()).file_size //= 2
    return sink.getvalue()


@cache
def kept_states() -> tuple[Node, ...]:
    """Return states of the searches at several steps."""
    found: list[Node] = []
    with TemporaryDirectory(prefix="stoop-") as folder:
        for name, steps in (("ps-gde-lm", 0), ("ps-gde-lm", 3), ("ps-gde-lm", 9), ("scipy-least-squares", 1)):
            state = minimize(create(name), Bowl(), seed=1, stop=Stop(generations=steps)).state
            if state is None:
                continue
            path = Path(folder) / "s.npz"
            save_state(path, state, "tag")
            with np.load(path) as file:
                header = tree_of(json.loads(file["header"].tobytes()))
                arrays = [(n, _array(file[n])) for n in file.files if n != "header"]
            found.append(Branch([("header", header), ("arrays", Branch(arrays))]))
    return tuple(found)


def _array(values: Any) -> Node:
    """Return the tree of an array."""
    return Branch(
        [
            ("descr", values.dtype.str),
            ("fortran_order", False),
            ("shape", list(values.shape)),
            ("data", values.tobytes().hex()),
        ]
    )


def draw_state(draw: Draw) -> Node:
    """Draw a state: one of the sound ones with other arrays, types, shapes and numbers."""
    sound = draw.rng.choice(kept_states())
    parts: dict[str, Any] = dict(sound.pairs) if isinstance(sound, Branch) else {}
    arrays: list[tuple[str, Node]] = []
    for name, one in parts["arrays"].pairs:
        if draw.bad():
            shape: Node = [draw.rng.choice(EXTENTS) for _ in range(draw.rng.randrange(4))]
            data = np.array([draw.number("d") for _ in range(draw.rng.choice((0, 1, 4, 12)))]).tobytes().hex()
            one = Branch(
                [
                    ("descr", draw.rng.choice(DESCRS)),
                    ("fortran_order", draw.rng.random() < 0.5),
                    ("shape", shape),
                    ("data", data),
                ]
            )
        arrays.append((draw.word(name), one))
    return Branch([("header", with_hostile_leaves(draw, parts["header"])), ("arrays", Branch(arrays))])


def with_hostile_leaves(draw: Draw, node: Node) -> Node:
    """Return a tree in which some leaves are hostile."""
    if isinstance(node, Branch):
        return Branch([(key, with_hostile_leaves(draw, one)) for key, one in node.pairs])
    if isinstance(node, list):
        return [with_hostile_leaves(draw, one) for one in node]
    return hostile(draw.rng) if draw.rng.random() < 0.3 * draw.hostile else node


def ask_state(folder: Path, content: bytes, rng: Random) -> str:
    """Read a state; write it and read it again; go on from it for a few steps."""
    path = folder / "search.npz"
    path.write_bytes(content)
    state, tag = load_tagged(path)
    save_state(path, state, tag)
    again, tag_again = load_tagged(path)
    if repr(again) != repr(state) or tag_again != tag:
        raise BrokenPromiseError("written and read differ")
    _go_on(state)
    return READ


def _go_on(state: State) -> None:
    optimizer = create(state.optimizer)
    with np.errstate(all="ignore"):
        minimize(
            optimizer, Bowl(), seed=1, state=state, stop=Stop(generations=state.generation + 2, budget=300.0)
        )
