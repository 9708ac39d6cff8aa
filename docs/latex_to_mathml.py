"""Hook of the documentation site: equations become MathML, which browsers show without a script."""

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
