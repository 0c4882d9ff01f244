"""Execute the notebooks of `examples` and keep their outputs: ``python scripts/execute_notebooks.py [NAME ...]``.

Without names those are executed whose outputs are not those of their code and files (a checksum tells). With ``--into
DIR`` the executed notebooks are written there, and those of `examples` stay as they are. Flights of ``../shared/data``
(or ``$STOOP_SHARED/data``) are read where a notebook names them; see `examples/index.toml`.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import os
import re
import shutil
import sys
import tempfile
import time
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
EXAMPLES = ROOT / "examples"
SHARED = Path(os.environ.get("STOOP_SHARED", ROOT.parent / "shared")) / "data"
TIMEOUT = 1800  #: s of a cell
KEPT = ("image/png", "image/svg+xml", "text/html", "text/plain")  #: what is kept of an output
ADDRESS = re.compile(r" at 0x[0-9a-f]+")  #: which differs from run to run


def index() -> dict[str, dict[str, Any]]:
    """Return name -> entry of all notebooks, in the order of the gallery."""
    text = (EXAMPLES / "index.toml").read_text(encoding="utf-8")
    return {one["name"]: one for one in tomllib.loads(text)["example"]}


def place(name: str) -> Path:
    """Return where a notebook is."""
    return EXAMPLES / f"{name}.ipynb"


def read(path: Path) -> dict[str, Any]:
    """Return the content of a notebook."""
    content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return content


def checksum(name: str, content: Mapping[str, Any]) -> str:
    """Return the SHA-256 of the code cells of a notebook and of the files that it reads."""
    digest = hashlib.sha256()
    for cell in content["cells"]:
        if cell["cell_type"] == "code":
            digest.update("".join(cell["source"]).encode() + b"\0")
    for shown, path in sorted(inputs(index()[name])):
        digest.update(shown.encode() + b"\0" + hashlib.sha256(path.read_bytes()).digest())
    return digest.hexdigest()


def inputs(entry: Mapping[str, Any]) -> Iterator[tuple[str, Path]]:
    """Give name and place of each file that a notebook reads."""
    for file in entry.get("files", []):
        yield file, EXAMPLES / file
    for folder, source in entry.get("data", {}).items():
        for path in sorted(p for p in (SHARED / source).iterdir() if p.is_file()):
            yield f"{folder}/{path.name}", path


def has_data(name: str) -> bool:
    """Return whether the flights that a notebook reads are here."""
    return all((SHARED / source).is_dir() for source in index()[name].get("data", {}).values())


def stale(name: str) -> bool:
    """Return whether the outputs of a notebook are not those of its code and files."""
    content = read(place(name))
    return bool(content["metadata"].get("stoop", {}).get("checksum") != checksum(name, content))


def execute(name: str) -> dict[str, Any]:
    """Execute a notebook in an empty folder that holds its files only; return it with its outputs and its checksum."""
    import nbformat
    from jupyter_client import AsyncKernelManager
    from jupyter_core.utils import run_sync
    from nbclient import NotebookClient

    notebook = nbformat.read(place(name), as_version=4)
    entry = index()[name]
    with (
        tempfile.TemporaryDirectory(prefix="stoop-notebook-") as folder,
        tempfile.TemporaryDirectory(prefix="stoop-kernel-") as sockets,
    ):
        for file in entry.get("files", []):
            shutil.copy(EXAMPLES / file, folder)
        for link, source in entry.get("data", {}).items():
            (Path(folder) / link).symlink_to(SHARED / source)
        # Sockets of the file system: nobody else on the machine can read them, or send code to the kernel.
        kernel = AsyncKernelManager(kernel_name="python3")
        if os.name != "nt":
            kernel.transport, kernel.ip = "ipc", str(Path(sockets) / "socket")
        settings = {"metadata": {"path": folder}}
        try:
            NotebookClient(notebook, km=kernel, timeout=TIMEOUT, resources=settings).execute()
        finally:
            run_sync(kernel.shutdown_kernel)(now=True)
    for cell in notebook.cells:
        cell.metadata = nbformat.NotebookNode()
        if cell.cell_type == "code":
            cell.execution_count = None
            cell.outputs = [nbformat.from_dict(one) for one in _outputs(cell.outputs)]
    content: dict[str, Any] = json.loads(nbformat.writes(notebook))
    content["metadata"] = {
        "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
        "language_info": {"name": "python"},
        "stoop": {"checksum": checksum(name, content)},
    }
    return content


def _outputs(outputs: list[Any]) -> Iterator[dict[str, Any]]:
    """Give the outputs of a cell without what changes from run to run; lines of one stream are joined."""
    text = ""
    for one in outputs:
        if one.output_type == "stream":
            if one.name == "stderr":
                raise ValueError(f"a cell writes to stderr: {one.text}")
            text += one.text
            continue
        if text:
            yield {"output_type": "stream", "name": "stdout", "text": text}
            text = ""
        data = {}
        for kind, value in one.data.items():
            if kind in KEPT:
                data[kind] = value if kind == "image/png" else ADDRESS.sub("", value)
        if "image/png" in data:
            data.pop("text/plain", None)  # "<Figure size ...>"
        kept: dict[str, Any] = {"output_type": one.output_type, "data": data, "metadata": {}}
        yield kept | ({"execution_count": None} if one.output_type == "execute_result" else {})
    if text:
        yield {"output_type": "stream", "name": "stdout", "text": text}


def main() -> int:
    """Execute notebooks, and write them."""
    parser = argparse.ArgumentParser(
        description="Execute the notebooks of `examples` and keep their outputs."
    )
    parser.add_argument(
        "names", metavar="NAME", nargs="*", help="default: those whose outputs are out of date"
    )
    parser.add_argument("--into", metavar="DIR", type=Path, default=EXAMPLES, help="folder to write them to")
    arguments = parser.parse_args()
    known = index()
    unknown = set(arguments.names) - set(known)
    if unknown:
        parser.error(f"there is no notebook '{min(unknown)}'; choose from {', '.join(known)}")
    for name in arguments.names or [n for n in known if has_data(n) and stale(n)]:
        began = time.monotonic()
        text = json.dumps(execute(name), indent=1, ensure_ascii=False) + "\n"
        target = arguments.into / place(name).name
        target.write_text(text, encoding="utf-8")
        print(f"{target}: {time.monotonic() - began:.0f} s, {len(text.encode()) // 1000} kB", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
