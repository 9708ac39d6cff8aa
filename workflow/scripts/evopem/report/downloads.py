"""Tables in the page, as links that save them as CSV files without a server or a script."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import quote

from evopem.figures.figure_data import thin_table

if TYPE_CHECKING:
    import pandas as pd

# Keeps the report below 5 MB, however long the recording.
MOST_ROWS = 5000


@dataclass(frozen=True)
class Download:
    """A CSV file in a link.

    Attributes
    ----------
    file : str
        Name that it is saved under.
    address : str
        ``data:`` address with the table.
    rows : int
        Number of rows.
    rows_of : int
        Number of rows of the whole table; larger than `rows` where it was thinned.
    """

    file: str
    address: str
    rows: int
    rows_of: int


def csv_download(table: pd.DataFrame, dataset: str, figure: str) -> Download:
    """Put a figure's table into a link, thinned where it is longer than :data:`MOST_ROWS`.

    Parameters
    ----------
    table : pandas.DataFrame
    dataset, figure : str
        For the name of the file; characters that a file system may refuse become underscores.
    """
    kept = thin_table(table, MOST_ROWS)
    text = kept.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    name = re.sub(r"[^\w.-]+", "_", f"{dataset}-{figure}.csv")
    # Without escapes for commas and digits this is shorter than base64.
    address = "data:text/csv;charset=utf-8," + quote(text, safe=",.+-()/")
    return Download(name, address, len(kept), len(table))
