"""Names of data sets, which become names of folders of the results."""

from __future__ import annotations

import re
from collections.abc import Iterable

from evopem.config.sample_sheet import Origin
from evopem.errors import InputError

RESULTS_FOLDER = "results"

RESERVED_NAMES = (
    "index.html",
    "fleet.csv",
    "fleet_modes.csv",
    "fleet.parquet",
    "logs",
    "benchmarks",
    "checksums",
    "fletcher_powell",
)
"""Names of other files and folders of the results."""

MAX_LENGTH = 100
"""Most characters of a name: file systems take 255 bytes, and Snakemake's own names add to it."""

_NAME = re.compile(r"[A-Za-z0-9][A-Za-z0-9_.-]*")
_DEVICE = re.compile(r"(con|prn|aux|nul|com[0-9]|lpt[0-9])(\..*)?", re.IGNORECASE)
# Snakemake takes a wildcard that ends like this for an endless recursion of rules.
_PERIODIC = re.compile(r"(.+?)\1{19}$")


def check_names(names: Iterable[str], origin: Origin) -> None:
    """Refuse names that cannot be folders on every file system, or wildcards of Snakemake.

    Raises
    ------
    InputError
        Naming the place where the name was written.
    """
    folders: dict[str, str] = {}
    for name in names:
        problem, remedy = _problem(name, folders)
        if problem:
            raise InputError(origin.source, problem, remedy, origin.of_name(name))
        folders[name.lower()] = name


def is_valid(name: str) -> bool:
    """Whether a text can be the name of a data set, beside no others."""
    return not _problem(name, {})[0]


def _problem(name: str, folders: dict[str, str]) -> tuple[str, str]:
    """What is wrong with a name and what to do; two empty texts where nothing is."""
    shown = name if len(name) <= 60 else f"{name[:57]}..."
    if len(name) > MAX_LENGTH:
        return (
            f"the data set name {shown!r} has {len(name)} characters",
            f"give it a name of at most {MAX_LENGTH}",
        )
    if name.lower() in RESERVED_NAMES:
        return (
            f"{name} is the name of something else among the results",
            "give the data set another name",
        )
    if not _NAME.fullmatch(name) or ".." in name or name.endswith(".") or _DEVICE.fullmatch(name):
        return (
            f"the data set name {shown!r} cannot be the name of a folder everywhere",
            "use letters, digits, _, - and single dots, a letter or digit first",
        )
    if _PERIODIC.search(name):
        return (
            f"the data set name {shown!r} ends in 20 equal parts, which Snakemake does not accept",
            "shorten the repetition at its end",
        )
    twin = folders.get(name.lower(), name)
    if twin != name:
        return f"{twin} and {name} are one folder where letter case does not count", "rename one"
    return "", ""
