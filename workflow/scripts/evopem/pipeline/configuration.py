"""Configuration: the complete settings of a data set beside its results."""

from __future__ import annotations

from evopem.config.settings import DatasetSettings
from evopem.config.yaml_form import yaml_text
from evopem.files.atomic import write_text
from evopem.results.layout import DatasetFiles


def write_configuration(files: DatasetFiles, settings: DatasetSettings) -> None:
    """Write the complete configuration of a data set, ready to be run again."""
    write_text(files.config, yaml_text(settings))
