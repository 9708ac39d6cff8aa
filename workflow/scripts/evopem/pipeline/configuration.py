"""Configuration: the complete settings of a data set beside its results."""

from __future__ import annotations

from pathlib import Path

from evopem.config.settings import DatasetSettings
from evopem.config.state_space_keys import state_space_yaml
from evopem.config.state_space_settings import MultichannelDataset
from evopem.config.yaml_form import yaml_text
from evopem.files.atomic import write_text
from evopem.files.checksums import delete_results
from evopem.results.layout import DatasetFiles


def write_configuration(files: DatasetFiles, settings: DatasetSettings) -> None:
    """Write the complete configuration of a data set, ready to be run again."""
    delete_results(files.folder, {Path(files.details).name})  # its contents are written anew
    write_text(files.config, yaml_text(settings))


def write_multichannel_configuration(files: DatasetFiles, settings: MultichannelDataset) -> None:
    """The same of a data set with several channels."""
    delete_results(files.folder, {Path(files.details).name})
    write_text(files.config, state_space_yaml(settings))
