"""An SVG file as an element of an HTML page."""

from __future__ import annotations

import re
from xml.etree import ElementTree

from markupsafe import Markup

from evopem.figures import style

SVG = "http://www.w3.org/2000/svg"
XLINK = "http://www.w3.org/1999/xlink"
# Each colour becomes a variable, so that the page can have a light and a dark theme.
VARIABLES = {
    style.INK: "--figure-ink",
    style.MUTED: "--figure-muted",
    style.GRID: "--figure-grid",
    style.PAPER: "--figure-paper",
    style.MODEL: "--figure-model",
    style.ERROR: "--figure-error",
    style.TRUTH: "--figure-truth",
    style.FOURTH: "--figure-fourth",
    style.FIFTH: "--figure-fifth",
}


def inline_svg(text: str, name: str, label: str) -> Markup:
    """A figure as an ``svg`` element without fixed size, style sheet, metadata and scripts.

    `name` makes its ids unique in the page; `label` describes it for screen readers.
    """
    ElementTree.register_namespace("", SVG)
    ElementTree.register_namespace("xlink", XLINK)
    root = ElementTree.fromstring(text)
    for parent in list(root.iter()):
        for child in list(parent):
            if child.tag in {f"{{{SVG}}}{tag}" for tag in ("metadata", "style", "script")}:
                parent.remove(child)
    for element in root.iter():
        for attribute, value in list(element.attrib.items()):
            if attribute.lower().startswith("on"):
                del element.attrib[attribute]
            elif attribute == "id":
                element.set(attribute, f"{name}-{value}")
            elif attribute in {"href", f"{{{XLINK}}}href"} and value.startswith("#"):
                element.set(attribute, f"#{name}-{value[1:]}")
            elif attribute in {"style", "clip-path", "fill", "stroke"}:
                value = re.sub(r"url\(#", f"url(#{name}-", value)
                for colour, variable in VARIABLES.items():
                    value = value.replace(colour, f"var({variable})")
                element.set(attribute, value)
    for attribute in ("width", "height", "version"):
        root.attrib.pop(attribute, None)
    root.set("role", "img")
    root.set("aria-label", label)
    return Markup(ElementTree.tostring(root, encoding="unicode"))
