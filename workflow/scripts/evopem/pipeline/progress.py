"""How far an identification has come: a line that is overwritten, or one for each stage."""

import shutil
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TextIO

Announce = Callable[[str, int, int], None]

# Seconds between two lines about one stage where there is no terminal.
PAUSE = 30.0


@dataclass
class ProgressLine:
    """One line that each stage overwrites, or a line for each stage."""

    stream: TextIO  # standard error, so that the results alone can be piped on
    overwrites: bool  # as a terminal does
    _started: float = field(default_factory=time.monotonic)
    _shown: float = 0.0
    _stage: tuple[str, str] = ("", "")
    _width: int = 0

    def announce(self, words: str, number: int, count: int) -> None:
        """Say that a stage begins: what it does, its number from 1, and how many there are."""
        self._stage = f"[{number}/{count}]", words
        self._show("")

    def tell(self, words: str) -> None:
        """Say how far the stage has come; not each time where lines are kept."""
        if self.overwrites or time.monotonic() - self._shown >= PAUSE:
            self._show(f": {words}")

    def _show(self, words: str) -> None:
        self._shown = time.monotonic()
        number, title = self._stage
        text = f"{number} {self._shown - self._started:5.1f} s  {title}{words}"
        if not self.overwrites:
            self.stream.write(f"{text}\n")
        else:
            # A line that is wrapped could not be overwritten.
            text = text[: shutil.get_terminal_size().columns - 1]
            self.stream.write(f"\r{text:<{self._width}}")
            self._width = len(text)
        self.stream.flush()

    def close(self) -> None:
        """Remove the line from the terminal."""
        if self.overwrites and self._width:
            self.stream.write(f"\r{'':<{self._width}}\r")
            self.stream.flush()


@contextmanager
def progress(shown: bool) -> Iterator[Announce | None]:
    """A function that receives each stage before it begins; None where nothing is shown."""
    if not shown:
        yield None
        return
    # A notebook overwrites a line as a terminal does; a file of messages keeps all lines.
    ipython = sys.modules.get("IPython")
    in_notebook = ipython is not None and hasattr(ipython.get_ipython(), "kernel")
    line = ProgressLine(sys.stderr, sys.stderr.isatty() or in_notebook)
    try:
        yield line.announce
    finally:
        line.close()
