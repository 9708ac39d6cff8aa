"""The Jinja environment of the pages: filters for numbers, and the scripts."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from inspect import getmembers, isfunction
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.config.schema import shipped
from evopem.models.mode_matching import PERSISTENT_ORDERS
from evopem.report import numbers, sentences
from evopem.report.equations import symbol
from evopem.validation.checks import p_text

if TYPE_CHECKING:
    from jinja2 import Environment


def template_folder() -> Path:
    """The folder of the templates."""
    return shipped("templates")


def environment(folder: Path) -> Environment:
    """The environment that renders the templates of a folder; names are escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(folder),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    words = dict(getmembers(numbers, isfunction))
    environment.filters.update(words)
    environment.tests["finite"] = numbers.is_number
    environment.globals.update(
        words | dict(getmembers(sentences, isfunction)),
        persistent_orders=PERSISTENT_ORDERS,
        symbol=symbol,
        p_value=p_text,
        page_script=_script(folder / "page.js"),
        figures_script=_script(
            folder / "uplot" / "uPlot.iife.min.js",
            folder / "figures.js",
            licence=folder / "uplot" / "LICENSE",
        ),
    )
    return environment


def _script(*files: Path, licence: Path | None = None) -> dict[str, str]:
    """A script of the page, and the digest by which the content policy allows it."""
    parts = [file.read_text(encoding="utf-8") for file in files]
    if licence is not None:
        parts.insert(0, f"/*\n{licence.read_text(encoding='utf-8')}\n*/")
    text = "\n".join(parts)
    digest = b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return {"text": text, "digest": f"sha256-{digest}"}
