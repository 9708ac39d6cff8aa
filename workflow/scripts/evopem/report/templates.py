"""The Jinja environment of the pages: filters for numbers, and the only script."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from pathlib import Path
from typing import TYPE_CHECKING

import evopem
from evopem.report import numbers

if TYPE_CHECKING:
    from jinja2 import Environment


def template_folder() -> Path:
    """The folder of the templates.

    It is a subpackage of an installed evopem, and ``workflow/templates`` in a checkout.
    """
    package = Path(evopem.__file__).resolve().parent
    installed = package / "templates"
    return installed if installed.is_dir() else package.parents[1] / "templates"


def environment(template_directory: Path) -> Environment:
    """The environment that renders the templates of a folder; names are escaped."""
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(template_directory),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(
        number=numbers.number,
        fixed=numbers.fixed,
        percent=numbers.percent,
        count=numbers.count,
        raw=numbers.raw,
        standard_error=numbers.standard_error,
    )
    environment.globals.update(
        with_error=numbers.with_error,
        root=numbers.root,
        hertz=numbers.hertz,
        script=_script(template_directory / "page.js"),
    )
    return environment


def _script(file: Path) -> dict[str, str]:
    """The script of the page, and the digest by which the content policy allows it."""
    text = file.read_text(encoding="utf-8")
    digest = b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return {"text": text, "digest": f"sha256-{digest}"}
