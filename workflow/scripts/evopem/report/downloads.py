"""Tables in the page, as links that save them as CSV files without a server or a script."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import quote

import numpy as np
import pandas as pd

from evopem.figures.style import extremes

# Keep the report below 3 MB, however long the recording and however many its channels.
MOST_ROWS, MOST_CELLS = 5000, 40_000


@dataclass(frozen=True)
class Download:
    """A CSV file in a link."""

    file: str  # name that it is saved under
    address: str  # ``data:`` address with the table
    rows: int  # number of rows
    rows_of: int  # number of rows of the whole table; larger than `rows` where it was thinned


def csv_download(
    table: pd.DataFrame, dataset: str, figure: str, most_cells: int = MOST_CELLS
) -> Download:
    """Put a figure's table into a link, thinned where it is longer than :data:`MOST_ROWS`."""
    kept = thin_table(table, min(MOST_ROWS, most_cells // max(table.shape[1], 1)))
    text = kept.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    name = re.sub(r"[^\w.-]+", "_", f"{dataset}-{figure}.csv")
    # Without escapes for commas and digits this is shorter than base64.
    address = "data:text/csv;charset=utf-8," + quote(text, safe=",.+-()/")
    return Download(name, address, len(kept), len(table))


def thin_table(table: pd.DataFrame, rows: int) -> pd.DataFrame:
    """Leave out rows beyond about so many and keep the extremes of every column.

    Columns of words divide the table into series; the first numeric column is their abscissa.
    """
    if len(table) <= rows:
        return table
    words = [
        name
        for name in table.columns[:4]
        if not pd.api.types.is_numeric_dtype(table[name])
        and table[name].nunique() < len(table) ** 0.5
    ]
    series = [table]
    if words:
        series = [part for _, part in table.groupby(words, sort=False, dropna=False)]
    return pd.concat([_thin(part, max(rows * len(part) // len(table), 8)) for part in series])


def _thin(part: pd.DataFrame, rows: int) -> pd.DataFrame:
    if len(part) <= rows:
        return part
    numbers = part.select_dtypes("number").iloc[:, 1:]
    drawn = [name for name in numbers if numbers[name].notna().any()]
    bins = max(rows // (2 * max(len(drawn), 1)), 1)
    # `extremes` keeps a series of at most 4 × bins points whole; here it must not.
    kept = [extremes(part[name], max(min(bins, len(part) // 4 - 1), 1)) for name in drawn]
    return (
        part.iloc[np.unique(np.concatenate(kept))] if kept else part.iloc[:: len(part) // rows + 1]
    )
