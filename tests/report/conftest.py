"""Result files with figures, made once a session."""

import pytest
from result_files import write_results

from evopem.figures import draw_all, result_paths


@pytest.fixture(scope="session")
def results(tmp_path_factory):
    """The directory of one data set's results, figures included."""
    directory = write_results(tmp_path_factory.mktemp("results") / "arm")
    draw_all(result_paths(directory), directory / "figures")
    return directory
