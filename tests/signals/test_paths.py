"""Paths that no file system accepts are refused like files that are missing."""

import pytest
from recorded_files import read_recording

from evopem.errors import InputError


@pytest.mark.parametrize("path", ["x" * 300 + ".csv", "y/" * 5000 + "x.csv", "none.csv"])
def test_a_path_that_leads_nowhere_is_refused_in_one_sentence(path):
    with pytest.raises(InputError, match=r": there is no such file; .+\.$"):
        read_recording(path, 1, 2, sampling_rate=100.0)
