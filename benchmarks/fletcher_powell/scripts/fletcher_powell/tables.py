"""The tables of the comparison, as the figures and the page read them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import pandas as pd


@dataclass(frozen=True)
class Tables:
    """Tables of the comparison; see `fletcher_powell.statistics`."""

    summary: pd.DataFrame
    runs: pd.DataFrame
    convergence: pd.DataFrame
    landscape: pd.DataFrame
    minima: pd.DataFrame


def read_tables(*files: str | Path) -> Tables:
    """Read the CSV files of the tables, in the order of `Tables`."""
    return Tables(*(pd.read_csv(file) for file in files))
