"""Logs that a browser sends: streamed to the folder, limited, and whole or not there."""

from __future__ import annotations

import contextlib
import filecmp
import itertools
import os
import re
import shutil
import tempfile
from pathlib import Path
from typing import IO, Any

import tornado.web

from stoop.extend.errors import StoopError
from stoop.extend.text import printable
from stoop_app.places import inside

RESERVE = 256 << 20  #: bytes of the disk that stay free for results
MAX_NAME = 120  #: characters
MAX_DIGITS = 18  #: of a number of bytes; the first are enough to refuse a longer one


def safe_name(name: str) -> str:
    """Return a name for a file of any name: its last part, of letters that every system takes, and not hidden."""
    last = re.split(r"[/\\]", name)[-1]
    kept = re.sub(r"[^\w.+@ -]", "_", last, flags=re.ASCII).strip(" .")
    return kept[-MAX_NAME:].strip(" .") or "log"


def size(count: float) -> str:
    """Return a number of bytes as people write it."""
    return f"{count / 1e9:.3g} GB" if count >= 1e8 else f"{count / 1e6:.3g} MB"


@tornado.web.stream_request_body
class Upload(tornado.web.RequestHandler):
    """Takes one file: ``POST upload?name=NAME[&into=FOLDER]``; answers with its place in the folder, or why not.

    ``GET upload?size=BYTES`` answers whether so large a file would be taken: a browser that sends one that is refused meanwhile
    learns no more than that the connection ended.
    """

    def initialize(self, folder: Path, limit: int) -> None:
        """Keep where files go and how large they may be."""
        self.folder, self.limit = folder, limit
        self.file: IO[bytes] | None = None
        self.received = 0

    def prepare(self) -> None:
        """Refuse what is too large before it is sent."""
        connection: Any = self.request.connection
        connection.set_max_body_size(self.limit + 1)
        self.name, self.into = self.get_query_argument("name", "log"), self.get_query_argument("into", "")
        asked = self.get_query_argument("size", "") or self.request.headers.get("Content-Length", "")
        announced = int(asked[:MAX_DIGITS]) if asked.isdecimal() else 0
        if announced > self.limit:
            self.refuse(413, f"the log holds {size(announced)}, more than the limit of {size(self.limit)}; "
                             "give its path instead, or a larger --max-upload")  # fmt: skip
            return
        try:
            inside(self.folder.parent, self.folder.name).mkdir(parents=True, exist_ok=True)
            left = shutil.disk_usage(self.folder).free - RESERVE
            if announced > left:
                self.refuse(
                    507, f"the disk has room for {size(max(left, 0))}, the log holds {size(announced)}"
                )
                return
            if self.request.method == "POST":
                self.file = tempfile.NamedTemporaryFile(dir=self.folder, prefix=".part-", delete=False)  # noqa: SIM115
        except (OSError, StoopError) as error:
            self.refuse(507, f"the log cannot be kept ({getattr(error, 'strerror', None) or error})")

    def refuse(self, code: int, why: str) -> None:
        """Answer with words."""
        self.discard()
        self.set_status(code)
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.set_header("Connection", "close")
        self.finish(why)

    def data_received(self, chunk: bytes) -> None:
        """Write a part."""
        if self.file is None:
            return
        self.received += len(chunk)
        try:
            if self.received > self.limit:
                raise OSError(0, f"it is larger than {size(self.limit)}")
            self.file.write(chunk)
        except OSError as error:
            self.refuse(507, f"the log cannot be kept ({error.strerror})")

    def get(self) -> None:
        """Answer that such a file would be taken."""

    def post(self) -> None:
        """Move the whole file to its place."""
        if self.file is None:
            return
        try:
            place = inside(self.folder, safe_name(self.into)) if self.into else self.folder
            self.file.flush()
            os.fsync(self.file.fileno())  # else a crash soon after the move can leave an empty file
            self.file.close()
            place.mkdir(exist_ok=True)
            target = place / safe_name(self.name)
            if os.path.lexists(target) and not filecmp.cmp(self.file.name, target, shallow=False):
                if self.into:
                    self.refuse(409, f"{place.name} holds another table {target.name}; rename the folder")
                    return
                others = (place / f"{n}-{target.name}" for n in itertools.count(1))
                target = next(itertools.filterfalse(os.path.lexists, others))
            Path(self.file.name).replace(target)
        except (OSError, StoopError) as error:
            self.refuse(507, f"the log cannot be kept ({getattr(error, 'strerror', None) or error})")
            return
        self.file = None
        self.set_header("Content-Type", "text/plain; charset=utf-8")
        self.finish(printable(str((place if self.into else target).relative_to(self.folder.parent))))

    def on_connection_close(self) -> None:
        """Throw away what a browser that went away has sent."""
        self.discard()

    def on_finish(self) -> None:
        """Throw away what was not moved to its place, however the request ended."""
        self.discard()

    def discard(self) -> None:
        """Remove the part that was written."""
        if self.file is not None:
            with contextlib.suppress(OSError):
                self.file.close()
                Path(self.file.name).unlink(missing_ok=True)
            self.file = None
