"""How the documentation is built: ``python3 scripts/test.py docs``, any warning is an error.

Pictures are drawn, and the pages of the Python reference and of the notebooks written, when it is built; none of them is part of
the repository.
"""

from __future__ import annotations

import builtins
import os
import sys
from importlib.metadata import version as installed_version
from pathlib import Path
from typing import Any

from docutils import nodes
from latex2mathml.converter import convert
from sphinx import addnodes
from sphinx.application import Sphinx

sys.path.insert(0, str(Path(__file__).parent))  # pictures and notebooks

project = "stoop"
author = "The stoop developers"
project_copyright = "The stoop developers"
version = release = installed_version("stoop")

extensions = [
    "myst_parser",
    "sphinx_design",
    "sphinx.ext.autodoc",
    "sphinx.ext.autosummary",
    "sphinx.ext.napoleon",
    "sphinx.ext.viewcode",
    "pictures.directives",
    "gallery_pages",
]
exclude_patterns = ["_pictures", "pictures", "gallery/cards.txt"]
templates_path = ["_templates"]
myst_enable_extensions = ["dollarmath", "colon_fence"]
myst_heading_anchors = 3
autosummary_generate = True
suppress_warnings = ["autosummary.import_cycle"]  # of names of packages, which stand with those of stoop
autodoc_member_order = "bysource"
autodoc_typehints = "none"  # the docstrings say shapes and units, which hints cannot
napoleon_google_docstring = False
napoleon_use_rtype = False
html_theme = "furo"
html_title = f"stoop {version}"
html_static_path = ["_static"]
html_css_files = ["pages.css"]
html_math_renderer = "mathml"

if os.environ.get("READTHEDOCS") or os.environ.get("STOOP_DOCS_ONLINE"):  # inventories need a network
    extensions.append("sphinx.ext.intersphinx")
    intersphinx_mapping = {
        "python": ("https://docs.python.org/3", None),
        "numpy": ("https://numpy.org/doc/stable", None),
        "scipy": ("https://docs.scipy.org/doc/scipy", None),
        "xarray": ("https://docs.xarray.dev/en/stable", None),
        "pandas": ("https://pandas.pydata.org/docs", None),
    }


def setup(app: Sphinx) -> None:
    """Write formulas as MathML, which browsers show by themselves: the pages need no network."""
    app.add_html_math_renderer("mathml", (_inline, None), (_block, None))
    app.connect("doctree-read", _at_home, priority=400)  # before viewcode looks for the source
    app.connect("doctree-read", _plain_words)


def _inline(writer: Any, node: nodes.math) -> None:
    writer.body.append(convert(node.astext()))
    raise nodes.SkipNode


def _block(writer: Any, node: nodes.math_block) -> None:
    writer.body.append(f'<div class="formula">{convert(node.astext(), display="block")}</div>')
    raise nodes.SkipNode


def _at_home(app: Sphinx, doctree: nodes.document) -> None:
    """Tell the links to the source where the names of ``stoop`` are written, some of them under another name."""
    import stoop

    for signature in doctree.findall(addnodes.desc_signature):
        found = getattr(stoop, signature.get("fullname") or "", None)
        if signature.get("module") == "stoop" and hasattr(found, "__qualname__"):
            signature["module"], signature["fullname"] = found.__module__, found.__qualname__
            signature["ids"].append(
                f"{found.__module__}.{found.__qualname__}"
            )  # where the source links back to


def _plain_words(app: Sphinx, doctree: nodes.document) -> None:
    """Take "path of a log" in the place of a type for words: "path" is not the attribute of that name."""
    for node in list(doctree.findall(addnodes.pending_xref)):
        target = node.get("reftarget", "")
        if (
            node.get("refspecific")
            and target.islower()
            and "." not in target
            and not hasattr(builtins, target)
        ):
            node.replace_self(node.children)
