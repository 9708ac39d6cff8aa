"""The Jinja environment of the pages: filters for numbers, and the scripts."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.report import numbers
from evopem.report.equations import symbol
from evopem.report.sentences import IN_TEMPLATES
from evopem.validation.checks import p_text

if TYPE_CHECKING:
    from jinja2 import Environment

# Functions of :mod:`evopem.report.numbers` that templates have.
FILTERS = ("number", "fixed", "percent", "count", "raw", "standard_error", "hertz")
WORDS = (
    *("number", "count", "with_error", "root", "hertz", "enumeration", "plural", "times"),
    *("superscript", "to_its_error"),
)


def template_folder() -> Path:
    """The folder of the templates.

    It is a subpackage of an installed evopem, and ``workflow/templates`` in a checkout.
    """
    package = Path(__file__).resolve().parents[1]
    installed = package / "templates"
    return installed if installed.is_dir() else package.parents[1] / "templates"


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
    environment.filters.update({name: getattr(numbers, name) for name in FILTERS})
    environment.tests["finite"] = numbers.is_number
    environment.globals.update({name: getattr(numbers, name) for name in WORDS} | IN_TEMPLATES)
    environment.globals.update(
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
