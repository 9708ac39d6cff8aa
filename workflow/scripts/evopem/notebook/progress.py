"""How far an identification has come: a bar by tqdm or rich, else lines on standard error."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager

from evopem.pipeline.identification import Announce
from evopem.pipeline.progress import ProgressLine


@contextmanager
def progress(shown: bool) -> Iterator[Announce | None]:
    """A function that receives each stage before it begins; None where nothing is shown."""
    if not shown:
        yield None
        return
    with _way()() as announce:
        yield announce


def _way() -> Callable[[], AbstractContextManager[Announce]]:
    """A bar on a terminal and in a notebook; lines in a file of messages."""
    in_notebook = _in_notebook()
    if not (sys.stderr.isatty() or in_notebook):
        return _line
    if importlib.util.find_spec("tqdm"):
        return _tqdm
    if in_notebook:  # where rich needs widgets
        return _display
    return _rich if importlib.util.find_spec("rich") else _line


def _in_notebook() -> bool:
    """Whether a kernel runs this code; it has imported IPython."""
    ipython = sys.modules.get("IPython")
    return ipython is not None and hasattr(ipython.get_ipython(), "kernel")


@contextmanager
def _tqdm() -> Iterator[Announce]:
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


_FORMAT = "{n_fmt}/{total_fmt} {bar} {elapsed} {desc}"


@contextmanager
def _rich() -> Iterator[Announce]:
    bars = importlib.import_module("rich.progress")
    with bars.Progress(transient=True) as shown:
        task = shown.add_task("", total=None)

        def announce(stage: str, number: int, stages: int) -> None:
            shown.update(task, description=stage, total=stages, completed=number - 1)

        yield announce


@contextmanager
def _display() -> Iterator[Announce]:
    """One line of a notebook's own output, empty at the end."""
    shown = importlib.import_module("IPython.display").display

    def text(line: str) -> dict[str, str]:
        return {"text/plain": line}

    handle = shown(text(""), raw=True, display_id=True)

    def announce(stage: str, number: int, stages: int) -> None:
        handle.update(text(f"{number}/{stages} {stage}"), raw=True)

    try:
        yield announce
    finally:
        handle.update(text(""), raw=True)


@contextmanager
def _line() -> Iterator[Announce]:
    line = ProgressLine(sys.stderr)
    try:
        yield line.announce
    finally:
        line.close()
