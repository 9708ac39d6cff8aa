"""Configuration: the complete settings of a data set beside its results."""

from __future__ import annotations

from pathlib import Path

from evopem.config.defaults import yaml_text
from evopem.config.settings import DatasetSettings
from evopem.files.atomic import write_text
from evopem.files.checksums import delete_results
from evopem.results.layout import DatasetFiles


def write_configuration(files: DatasetFiles, settings: DatasetSettings) -> None:
    """Write the complete configuration of a data set, ready to be run again."""
    delete_results(files.folder, {Path(files.details).name})  # its contents are written anew
    write_text(files.config, yaml_text(settings))
