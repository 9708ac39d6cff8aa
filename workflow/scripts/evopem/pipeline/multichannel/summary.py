"""The summary of a data set with several channels."""

from __future__ import annotations

from evopem.files.json_form import save
from evopem.results.layout import DatasetFiles
from evopem.results.multichannel import summarize_multichannel


def summarize_state_space(files: DatasetFiles) -> None:
    """Put order, errors, modes and checks of a data set into one small file."""
    save(summarize_multichannel(files), files.summary)
