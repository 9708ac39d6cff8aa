"""How far an identification has come: a bar by tqdm, else lines on standard error."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager

from evopem.pipeline.identification import Announce
from evopem.pipeline.progress import ProgressLine

_FORMAT = "{n_fmt}/{total_fmt} {bar} {elapsed} {desc}"


@contextmanager
def progress(shown: bool) -> Iterator[Announce | None]:
    """A function that receives each stage before it begins; None where nothing is shown."""
    if not shown:
        yield None
        return
    # A notebook overwrites a line as a terminal does; a file of messages keeps all lines.
    overwrites = sys.stderr.isatty() or _in_notebook()
    if overwrites and importlib.util.find_spec("tqdm"):
        with _bar() as announce:
            yield announce
        return
    line = ProgressLine(sys.stderr, overwrites)
    try:
        yield line.announce
    finally:
        line.close()


def _in_notebook() -> bool:
    """Whether a kernel runs this code; it has imported IPython."""
    ipython = sys.modules.get("IPython")
    return ipython is not None and hasattr(ipython.get_ipython(), "kernel")


@contextmanager
def _bar() -> Iterator[Announce]:
    with warnings.catch_warnings():
        # Without ipywidgets it shows the bar as text, and says so.
        warnings.simplefilter("ignore")
        bar = importlib.import_module("tqdm.auto").tqdm(leave=False, bar_format=_FORMAT)

    def announce(stage: str, number: int, stages: int) -> None:
        bar.total = stages
        bar.set_description_str(stage, refresh=False)
        bar.n = number - 1
        bar.refresh()

    try:
        yield announce
    finally:
        bar.close()
