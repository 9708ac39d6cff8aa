"""What a data set of several recordings cannot have."""

from __future__ import annotations

from evopem.config.settings import DatasetSettings, SyntheticSource
from evopem.config.state_space_settings import MultichannelDataset
from evopem.errors import InputError


def check_several_recordings(settings: DatasetSettings | MultichannelDataset, source: str) -> None:
    """Refuse keys that have no meaning for several recordings of one data set.

    Parameters
    ----------
    settings : DatasetSettings or MultichannelDataset
    source : str
        The configuration, for an error to name.

    Raises
    ------
    InputError
    """
    recorded = settings.source
    if isinstance(recorded, SyntheticSource) or len(recorded.files) == 1:
        return
    place = f"datasets.{settings.name}"
    own = settings if isinstance(settings, MultichannelDataset) else settings.preparation
    split = own.split
    whole_recordings = split.by == "recordings" and not recorded.validation_files
    if whole_recordings and isinstance(split.estimation, int):
        raise InputError(
            source,
            f"{split.estimation} is a number of samples, and whole recordings are held out",
            "give a fraction between 0 and 1, or write by: samples beside it to cut each recording",
            f"{place}.split.estimation",
        )
    if isinstance(settings, DatasetSettings) and settings.fit.changes_model:
        key = "constraints" if settings.fit.constraints else "focus"
        raise InputError(
            source,
            f"the key is for a data set of one recording, and this one has {len(recorded.files)}",
            "remove the key, or give one file",
            f"{place}.{key}",
        )
