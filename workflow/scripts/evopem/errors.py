"""The one error that bad input raises, and refusals of what any part of the package needs."""

import importlib.util
import re
from collections.abc import Sequence
from pathlib import Path

_CONTROLS = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]+")


class InputError(ValueError):
    """Input that cannot be used, said in one sentence a user can act on.

    Parameters
    ----------
    source : str
        The file or the configuration key at fault.
    problem : str
        What is wrong, in a clause without a full stop.
    remedy : str
        What to do about it, in a clause without a full stop.
    place : str, optional
        Where in the source: a line, a column, a sample, a channel.

    Examples
    --------
    >>> print(InputError("data.csv", "the file is empty", "export it again"))
    data.csv: the file is empty; export it again.
    """

    def __init__(self, source: str, problem: str, remedy: str, place: str = "") -> None:
        self.source = str(source)
        self.place = place
        self.problem = problem
        self.remedy = remedy
        where = f"{self.source}, {place}" if place else self.source
        # Names and values come from files: one line, and nothing a terminal would obey.
        super().__init__(_CONTROLS.sub(" ", f"{where}: {problem}; {remedy}."))

    def __reduce__(self) -> tuple[type, tuple[str, str, str, str]]:
        return (type(self), (self.source, self.problem, self.remedy, self.place))


def checked_path(source: str, given: object) -> Path:
    """A path that a user handed over; an `InputError` says that it cannot be one."""
    try:
        path = Path(given)  # type: ignore[arg-type]
        path.exists()
    except PermissionError:
        return path  # what opens it says so
    except (TypeError, OSError):
        raise InputError(source, f"{repr(given)[:40]} is no path", "give that of a file") from None
    return path


class NoModelError(ValueError):
    """A recording, or a part of one, is too short for a model, or no estimate of it is finite."""


class LostModelError(InputError, NoModelError):
    """A model that rounding has spoilt: no candidate, and no result."""


FOR_RESULTS = ("pandas", "jinja2")
FOR_FIGURES = (*FOR_RESULTS, "matplotlib")
FOR_REPORT = FOR_FIGURES  # packages of an extra, for :func:`check_packages`


def check_packages(needed: Sequence[str], source: str, work: str) -> None:
    """Refuse to begin what a missing package would end."""
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        are = "is" if len(missing) == 1 else "are"
        problem = f"{work} need {', '.join(missing)}, which {are} not installed"
        raise InputError(source, problem, 'run pip install "evopem[report]"')
