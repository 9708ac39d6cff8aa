"""The line that says how far an identification has come."""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import TextIO

from evopem.config.structures import STRUCTURES

Stage = Callable[[], None]
Announce = Callable[[str, int, int], None]

_STAGES = {
    "configuration": "settings",
    "recording": "reading the recording",
    "validation_recording": "reading the validation recording",
    "preparation": "preparing the samples",
    "spectrum": "spectrum",
    "plan": "deciding how to prepare the samples",
    "folds": "choosing the held-out samples",
    "delay": "searching the delay",
    "delays": "searching the delays of the inputs",
    "joint": "searching the joint order",
    "nc": "searching the order of C",
    "nb": "searching the order of B",
    "structures": "comparing the structures",
    "remedies": "acting on failed checks",
    "chosen": "searching the chosen model globally",
    "other_model": "model for the other purpose",
    "decisions": "decisions",
    "model": "model and its uncertainty",
    "candidates": "table of candidates",
    "validation": "validation",
    "summary": "checks",
    "figures": "figures",
    "report": "report",
}
_FORMS = {
    "innovations": "innovations",
    "output_error": "output-error",
    "output_error_drift": "drifting output-error",
    "box_jenkins": "Box-Jenkins",
}


def stage_title(stage: str) -> str:
    """What a stage does, in words; a structure or form stands for the search of its orders."""
    if stage in STRUCTURES:
        return f"searching the orders of {stage.upper()} models"
    form = stage.rpartition("_")[0]  # of the name of a form with its weighting
    if form in _FORMS:
        return f"searching the orders of state-space models in {_FORMS[form]} form"
    return _STAGES.get(stage, stage)


def run_stages(stages: Mapping[str, Stage], announce: Announce | None = None) -> None:
    """Run stages in their order, and say before each one its name, its number and their count."""
    for number, (name, stage) in enumerate(stages.items(), start=1):
        if announce is not None:
            announce(name, number, len(stages))
        stage()


# Seconds between two lines about one stage where there is no terminal.
PAUSE = 30.0


@dataclass
class ProgressLine:
    """One line that each stage overwrites; a line for each stage where there is no terminal.

    Attributes
    ----------
    stream : TextIO
        Standard error, so that the results alone can be piped on.
    """

    stream: TextIO
    _started: float = field(default_factory=time.monotonic)
    _shown: float = 0.0
    _stage: tuple[str, str] = ("", "")
    _width: int = 0

    def announce(self, stage: str, number: int, stages: int) -> None:
        """Say that a stage begins: its name, its number from 1, and how many there are."""
        self._stage = f"[{number}/{stages}]", stage_title(stage)
        self._show("")

    def tell(self, words: str) -> None:
        """Say how far the stage has come; not each time where there is no terminal."""
        if self.stream.isatty() or time.monotonic() - self._shown >= PAUSE:
            self._show(f": {words}")

    def _show(self, words: str) -> None:
        self._shown = time.monotonic()
        number, title = self._stage
        text = f"{number} {self._shown - self._started:5.1f} s  {title}{words}"
        if not self.stream.isatty():
            self.stream.write(f"{text}\n")
        else:
            # A line that is wrapped could not be overwritten.
            text = text[: shutil.get_terminal_size().columns - 1]
            self.stream.write(f"\r{text:<{self._width}}")
            self._width = len(text)
        self.stream.flush()

    def close(self) -> None:
        """Remove the line from the terminal."""
        if self.stream.isatty() and self._width:
            self.stream.write(f"\r{'':<{self._width}}\r")
            self.stream.flush()
