"""The whole configuration, checked and completed."""

from __future__ import annotations

from dataclasses import dataclass, field

from evopem.config.conditions import Positions
from evopem.config.settings import DatasetSettings, RunSettings
from evopem.config.state_space_settings import MultichannelDataset


@dataclass(frozen=True)
class Configuration:
    """A checked and completed configuration.

    Attributes
    ----------
    datasets : dict of str to DatasetSettings or MultichannelDataset
    run : RunSettings
    order : Positions, optional
        What recordings are ordered by where modes are followed.
    batches : dict of str to tuple of str
        Names of the recordings that one job identifies, by the number of the batch; empty where
        each recording has jobs of its own.
    """

    datasets: dict[str, DatasetSettings | MultichannelDataset]
    run: RunSettings
    order: Positions | None = None
    batches: dict[str, tuple[str, ...]] = field(default_factory=dict)

    @property
    def single_channel(self) -> dict[str, DatasetSettings]:
        """The data sets with one input and one output, or an output alone."""
        items = self.datasets.items()
        return {name: each for name, each in items if isinstance(each, DatasetSettings)}

    @property
    def multichannel(self) -> dict[str, MultichannelDataset]:
        """The data sets with several channels."""
        items = self.datasets.items()
        return {name: each for name, each in items if not isinstance(each, DatasetSettings)}
