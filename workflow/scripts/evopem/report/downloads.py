"""Tables inside the page, as links that save them as CSV files without a server or a script."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import TYPE_CHECKING
from urllib.parse import quote

from evopem.figures.figure_data import thin_table

if TYPE_CHECKING:
    import pandas as pd

# Keeps the report of a record of any length below 5 MB.
MOST_ROWS = 5000


@dataclass(frozen=True)
class Download:
    """A CSV file held by a link.

    Attributes
    ----------
    file : str
        Name to save it under.
    address : str
        A ``data:`` address that holds the table.
    rows : int
        Rows in it.
    rows_of : int
        Rows of the whole table; more than `rows` where it was thinned.
    """

    file: str
    address: str
    rows: int
    rows_of: int


def csv_download(table: pd.DataFrame, dataset: str, figure: str) -> Download:
    """Set a figure's table into a link, thinned where it is long.

    Parameters
    ----------
    table : pandas.DataFrame
    dataset, figure : str
        For the file's name; characters that a file system may refuse become underscores.
    """
    kept = thin_table(table, MOST_ROWS)
    text = kept.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    name = re.sub(r"[^\w.-]+", "_", f"{dataset}-{figure}.csv")
    # Commas and digits stay as they are: shorter than base64.
    address = "data:text/csv;charset=utf-8," + quote(text, safe=",.+-()/")
    return Download(name, address, len(kept), len(table))
