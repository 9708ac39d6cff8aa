"""Sections of the pages in docs/evidence: a sentence or two, where and when measured, a table."""

from __future__ import annotations

import datetime
import platform
import re
import subprocess
from collections.abc import Iterable, Sequence
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "evidence"


def write_section(
    page: str,
    title: str,
    text: str,
    command: str,
    columns: Sequence[str] = (),
    rows: Iterable[Sequence[str]] = (),
    after: str = "",
) -> None:
    """Write the section ``## title`` of a page: in its place, or at the end where there is none.

    Parameters
    ----------
    page, title : str
        ``search`` is docs/evidence/search.md; the title is without number signs.
    text : str
        What was measured, and how it may mislead.
    command : str
        What was run.
    columns, rows : sequences of str
        The table, if there is one.
    after : str
        What follows the table.
    """
    table = [_row(each) for each in (columns, ["---"] * len(columns), *rows)] if columns else []
    parts = [f"## {title}", f"{text}\n{_measured(command)}", "\n".join(table), after]
    section = "\n\n".join(filter(None, parts)) + "\n"
    file = FOLDER / f"{page}.md"
    written = file.read_text(encoding="utf-8") if file.exists() else f"# {page.capitalize()}\n"
    pattern = re.compile(rf"^## {re.escape(title)}\n.*?(?=^## |\Z)", re.MULTILINE | re.DOTALL)
    if pattern.search(written):
        written = pattern.sub(lambda _: section + "\n", written)
    else:
        written = f"{written.rstrip()}\n\n{section}"
    file.write_text(written.rstrip() + "\n", encoding="utf-8")


def _row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(map(str, cells)) + " |"


def _measured(command: str) -> str:
    revision = ["git", "rev-parse", "--short", "HEAD"]
    commit = subprocess.run(revision, cwd=FOLDER, capture_output=True, text=True).stdout.strip()
    return f"`{command}`; {datetime.date.today()}, {commit}, {platform.machine()}."
