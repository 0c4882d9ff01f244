"""LaTeX -> MathML that a page may hold: only elements and attributes of mathematics survive."""

from __future__ import annotations

from typing import Final
from xml.etree import ElementTree as ET

from markupsafe import Markup, escape

MATHML: Final = "http://www.w3.org/1998/Math/MathML"
# fmt: off
ELEMENTS: Final = frozenset((
    "math", "mrow", "mi", "mn", "mo", "ms", "mtext", "mspace", "msub", "msup", "msubsup", "munder", "mover",
    "munderover", "mfrac", "msqrt", "mroot", "mtable", "mtr", "mtd", "mstyle", "mpadded", "mphantom",
    "menclose",
))
ATTRIBUTES: Final = frozenset((
    "display", "mathvariant", "stretchy", "width", "height", "depth", "fence", "form", "separator", "lspace",
    "rspace", "accent", "accentunder", "columnalign", "rowspacing", "columnspacing", "linethickness",
    "displaystyle", "scriptlevel", "minsize", "maxsize", "movablelimits",
))
# fmt: on


def mathml(latex: str, display: str = "inline") -> Markup:
    """Return `latex` as a MathML element; what cannot be rendered is shown as it was written.

    Parameters
    ----------
    latex : str
        May come from a file: nothing but mathematics gets into the page.
    display : str
        ``"inline"`` or ``"block"``.
    """
    from latex2mathml.converter import convert  # it loads large tables

    try:
        # A bare & or < from the converter makes this fail, which is what should happen.
        root = ET.fromstring(convert(latex, display=display))  # noqa: S314 (made by us: has no DTD)
    except Exception:
        return Markup("<code>{}</code>").format(latex)
    return Markup(_serialized(root))  # noqa: S704 (every part is escaped below)


def _serialized(element: ET.Element) -> str:
    name = element.tag.removeprefix(f"{{{MATHML}}}")
    inside = _text(element.text) + "".join(_serialized(child) + _text(child.tail) for child in element)
    if name not in ELEMENTS:
        return inside
    kept = "".join(f' {key}="{_text(value)}"' for key, value in element.items() if key in ATTRIBUTES)
    return f"<{name}{kept}>{inside}</{name}>"


def _text(text: str | None) -> str:
    return str(escape(text or ""))
