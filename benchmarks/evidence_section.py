"""One section of a Markdown file of evidence, replaced and the others left as they are."""

from __future__ import annotations

import re
from pathlib import Path


def replace_section(file: Path, title: str, lines: list[str]) -> None:
    """Write ``lines`` as the section ``## title``: in its place, or at the end where there is none.

    Parameters
    ----------
    file : Path
        A Markdown file.
    title : str
        Without the number signs.
    lines : list of str
        The section's text.
    """
    text = file.read_text(encoding="utf-8")
    section = "\n".join([f"## {title}", "", *lines]).rstrip() + "\n"
    pattern = re.compile(rf"^## {re.escape(title)}\n.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
    if pattern.search(text):
        text = pattern.sub(lambda _: section + "\n", text)
    else:
        text = text.rstrip() + "\n\n" + section
    file.write_text(text.rstrip() + "\n", encoding="utf-8")
