"""The directives ``picture`` and ``pictures``: a drawing on a page, and a list of all of them."""

from __future__ import annotations

import posixpath
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, ClassVar, Final

from docutils import nodes
from docutils.parsers.rst import directives
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment
from sphinx.util import logging
from sphinx.util.display import status_iterator
from sphinx.util.docutils import SphinxDirective
from sphinx.util.nodes import make_refnode

from pictures.registry import THEMES, Picture, draw, outdated, pictures

FOLDER: Final = "_pictures"  #: in the source folder; not part of the repository
POINT: Final = 4.0 / 3.0  #: px
_SIZE: Final = re.compile(r' (width|height)="([\d.]+)pt"')
log = logging.getLogger(__name__)


class Drawing(nodes.image):
    """One file of a picture; unlike an image it tells browsers its size, so that a page does not jump while it loads."""


class AllPictures(nodes.General, nodes.Element):
    """Where the list of all pictures stands."""


class PictureDirective(SphinxDirective):
    """A drawing by its name, with what stands below it as its caption.

    It is shown in the colors of the page: of its two files, a style sheet hides one.
    """

    required_arguments = 1
    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {"bare": directives.flag}

    def run(self) -> list[nodes.Node]:
        """Return the figure; a bare one has no anchor, and its page is not the one that explains it."""
        found = pictures().get(self.arguments[0])
        if found is None:
            raise self.error(f"there is no picture '{self.arguments[0]}' in docs/pictures")
        for file in found.files():
            self.env.note_dependency(f"{FOLDER}/{file}")
        files = drawings(found, Path(self.env.srcdir, FOLDER))
        figure = nodes.figure("", *files, classes=["picture"])
        if self.content:
            text, messages = self.parse_inline(" ".join(self.content))
            figure += nodes.caption("", "", *text, *messages)
        self.set_source_info(figure)
        if "bare" not in self.options:
            figure["ids"].append(anchor(found.name))
            _places(self.env).setdefault(found.name, self.env.docname)
        return [figure]


class PicturesDirective(SphinxDirective):
    """All pictures by the pages that explain them, each with a link to its place."""

    def run(self) -> list[nodes.Node]:
        """Return a place for them, which is filled when all pages have been read."""
        self.env.note_reread()  # other pages change what stands here
        return [AllPictures()]


def anchor(name: str) -> str:
    """Return the identifier of a picture on its page."""
    return f"picture-{name}"


def drawings(one: Picture, folder: Path) -> list[Drawing]:
    """Return both files of a picture, of which a page shows one."""
    head = (folder / one.files()[0]).read_text(encoding="utf-8")[:2000]
    sizes = dict(_SIZE.findall(head))
    width, height = (round(POINT * float(sizes[n])) for n in ("width", "height"))
    return [
        Drawing(uri=f"/{FOLDER}/{file}", alt=one.alternative, classes=[f"only-{theme}"], box=(width, height))
        for theme, file in zip(THEMES, one.files(), strict=True)
    ]


def setup(app: Sphinx) -> dict[str, Any]:
    """Add the directives, and draw what is missing before pages are read."""
    app.add_node(Drawing, html=(_visit, _depart))
    app.add_node(AllPictures)
    app.add_directive("picture", PictureDirective)
    app.add_directive("pictures", PicturesDirective)
    app.connect("builder-inited", _draw)
    app.connect("env-purge-doc", _forget)
    app.connect("env-merge-info", _merge)
    app.connect("doctree-resolved", _list)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def _draw(app: Sphinx) -> None:
    folder = Path(app.srcdir, FOLDER)
    folder.mkdir(exist_ok=True)
    old = outdated(folder)
    for one in status_iterator(
        old, "drawing pictures... ", "purple", len(old), app.verbosity, lambda p: p.name
    ):
        for flaw in draw(one, folder):
            log.warning("picture %s: %s", one.name, flaw)


def _places(env: BuildEnvironment) -> dict[str, str]:
    """Return the page of each picture, which is the first one that shows it."""
    if not hasattr(env, "picture_pages"):
        env.picture_pages = {}  # type: ignore[attr-defined]
    return env.picture_pages  # type: ignore[no-any-return, attr-defined]


def _forget(app: Sphinx, env: BuildEnvironment, docname: str) -> None:
    places = _places(env)
    for name in [n for n, page in places.items() if page == docname]:
        del places[name]


def _merge(app: Sphinx, env: BuildEnvironment, docnames: Iterable[str], other: BuildEnvironment) -> None:
    for name, page in _places(other).items():
        _places(env).setdefault(name, page)


def _list(app: Sphinx, doctree: nodes.document, docname: str) -> None:
    """Fill the places of all pictures: page after page, as they stand in the table of contents."""
    for place in list(doctree.findall(AllPictures)):
        places, builder = _places(app.env), app.builder
        out: list[nodes.Node] = []
        for page in dict.fromkeys([*_order(app.env), *places.values()]):
            shown = [pictures()[n] for n, where in places.items() if where == page]
            if not shown:
                continue
            title = nodes.strong("", app.env.titles[page].astext())
            out.append(nodes.paragraph("", "", make_refnode(builder, docname, page, "", title)))
            row = nodes.container(classes=["picture-list"])
            for one in shown:
                link = make_refnode(builder, docname, page, anchor(one.name), [])
                for drawing in drawings(one, Path(app.srcdir, FOLDER)):
                    drawing["uri"] = drawing["uri"].lstrip("/")  # as it is known since the page was read
                    drawing["candidates"] = {"*": drawing["uri"]}
                    link += drawing
                link["classes"].append("picture-link")
                row += nodes.paragraph("", "", link)
            out.append(row)
        place.replace_self(out)


def _order(env: BuildEnvironment) -> list[str]:
    """Return all pages in the order of the table of contents."""
    out = [env.config.root_doc]
    for page in out:
        out += [p for p in env.toctree_includes.get(page, []) if p not in out]
    return out


def _visit(self: Any, node: Drawing) -> None:
    width, height = node["box"]
    where = posixpath.join(self.builder.imgpath, self.builder.images[node["uri"]])
    self.body.append(
        self.emptytag(
            node,
            "img",
            "\n",
            src=where,
            alt=node["alt"],
            width=str(width),
            height=str(height),
            loading="lazy",
        )
    )


def _depart(self: Any, node: Drawing) -> None:
    """Close nothing: an image has no content."""
