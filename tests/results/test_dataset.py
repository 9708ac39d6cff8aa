"""Results read back from the files of a data set."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from identified import WRITTEN

from evopem.config.defaults import complete, yaml_text
from evopem.config.structures import phases_of
from evopem.errors import InputError
from evopem.files.atomic import write_text
from evopem.results.dataset import read_results
from evopem.results.layout import DatasetFiles

PHASES = phases_of("armax")


@pytest.fixture
def copied(identified, tmp_path):
    """A copy of the data set's folder, to be damaged."""
    return DatasetFiles(str(shutil.copytree(identified.files.folder, tmp_path / "bench")))


def read(files, identified):
    return read_results(files)


def test_the_selection_is_the_model(identified):
    results = identified.results
    selected = results.phases["nb"].selected
    assert selected.orders == results.model.orders
    np.testing.assert_array_equal(selected.model.A, results.model.model.A)
    assert selected.criteria.bic == results.model.bic
    assert list(results.phases) == list(PHASES)
    assert results.name == "bench"


def test_the_table_of_candidates_is_that_of_the_phases(identified):
    results = identified.results
    candidates = [candidate for phase in PHASES for candidate in results.phases[phase].candidates]
    assert len(candidates) == len(results.candidates)
    for row, candidate in zip(results.candidates.itertuples(), candidates, strict=True):
        assert row.phase == candidate.phase
        assert row.bic == candidate.criteria.bic
        assert row.n_confirming == candidate.diagnostics.n_confirming
        assert row.at_stability_bound == candidate.at_stability_bound
        assert row.selected == (candidate.orders == results.phases[row.phase].orders)


def test_a_synthetic_data_set_has_a_truth_and_a_recorded_one_has_none(identified, copied):
    assert identified.results.truth.orders.na == 7
    assert read(copied, identified).validation_recording_info is None
    shutil.copy(copied.recording_info, copied.validation_recording_info)
    keys = {key: value for key, value in WRITTEN.items() if key not in ("synthesis", "samples")}
    keys |= {"file": "x.csv", "sampling_rate": 100, "split": {"discard": 100}}
    for files in ({}, {"validation_file": "v.csv"}):
        own = complete({"datasets": {"bench": keys | files}}).datasets["bench"]
        write_text(copied.config, yaml_text(own))
        found = read(copied, identified)
        assert found.truth is None
        assert (found.validation_recording_info is None) == (not files)
    info = found.validation_recording_info
    assert info == identified.results.recording_info


REQUIRED = (
    "recording",
    "recording_info",
    "prepared",
    "transforms",
    "spectrum",
    "spectrum_summary",
    "candidates",
    "model",
    "frequency_response",
    "validation",
    "residual_autocorrelation",
    "cross_correlation",
    "simulation",
)


@pytest.mark.parametrize("name", [*REQUIRED, *PHASES])
def test_a_missing_file_is_named(identified, copied, name):
    file = copied.phase(name) if name in PHASES else getattr(copied, name)
    Path(file).unlink()
    with pytest.raises(InputError) as raised:
        read(copied, identified)
    assert raised.value.source == file


@pytest.mark.parametrize("name", [*REQUIRED, "truth", *PHASES])
def test_an_empty_file_is_named(identified, copied, name):
    file = copied.phase(name) if name in PHASES else getattr(copied, name)
    Path(file).write_bytes(b"")
    with pytest.raises(InputError) as raised:
        read(copied, identified)
    assert raised.value.source == file
