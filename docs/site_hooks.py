"""Hooks of the documentation site: equations as MathML, and search without a network."""

import html
import re
from typing import Any

from latex2mathml.converter import convert

_MARKED = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\(?P<mark>[(\[])(?P<latex>.*?)\\[)\]]</(?P=tag)>',
    re.DOTALL,
)


def on_page_content(content: str, **_: Any) -> str:
    """Replace what arithmatex has marked."""
    return _MARKED.sub(_mathml, content)


def _mathml(found: re.Match[str]) -> str:
    block = found["mark"] == "["
    math: str = convert(html.unescape(found["latex"]), display="block" if block else "inline")
    return f"<p>{math}</p>" if block else math


def on_post_page(output: str, page: Any, **_: Any) -> str:
    """Take the script that searches pages opened from disk from the site, not from a network.

    It is iframe-worker 1.0.4 of the npm registry, unchanged (MIT licence, beside it).
    """
    depth = page.url.count("/")
    local = "../" * depth + "assets/iframe-worker/index.js"
    return output.replace("https://unpkg.com/iframe-worker/shim", local)
