"""How far an identification has come: a bar by tqdm or rich, else lines on standard error."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from evopem.pipeline.identification import Announce
from evopem.pipeline.progress import ProgressLine, stage_title


@contextmanager
def progress(shown: bool) -> Iterator[Announce | None]:
    """A function that receives each stage before it begins; None where nothing is shown.

    Parameters
    ----------
    shown : bool
    """
    if not shown:
        yield None
        return
    bars = {"tqdm": _tqdm, "rich": _rich}
    # A file of messages gets lines.
    if not (sys.stderr.isatty() or "ipykernel" in sys.modules):
        bars = {}
    bar = next((make for name, make in bars.items() if importlib.util.find_spec(name)), _line)
    with bar() as announce:
        yield announce


@contextmanager
def _tqdm() -> Iterator[Announce]:
    with warnings.catch_warnings():
        # Without ipywidgets it shows the bar as text, and says so.
        warnings.simplefilter("ignore")
        bar = importlib.import_module("tqdm.auto").tqdm(leave=False, bar_format=_FORMAT)

    def announce(stage: str, number: int, stages: int) -> None:
        bar.total = stages
        bar.set_description_str(stage_title(stage), refresh=False)
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
            shown.update(task, description=stage_title(stage), total=stages, completed=number - 1)

        yield announce


@contextmanager
def _line() -> Iterator[Callable[[str, int, int], None]]:
    line = ProgressLine(sys.stderr)
    try:
        yield line.announce
    finally:
        line.close()
