"""The stages of a data set in one process, together and one by one."""

import os
from collections import Counter
from pathlib import Path
from shutil import copytree

import numpy as np
import pytest
import yaml
from identified import without_figures
from scipy.io import loadmat

from evopem.config.defaults import complete
from evopem.config.structures import phases_of
from evopem.errors import InputError
from evopem.estimation.model_record import load_record
from evopem.pipeline.identification import identify_dataset, jobs, run_stage
from evopem.pipeline.planning.stages import results_of
from evopem.report.numbers import number
from evopem.results.layout import DatasetFiles

PHASES = phases_of("armax")

ANALYSIS = {
    "recipe": "chapter",
    "split": {"discard": 20},
    "spectrum": {"nfft": 512},
    "delay": {"orders": [3, 3], "nk": [2, 3]},
    "orders": {"plant": [3, 4], "nc": [2, 3], "nb": [3, 3]},
    "search": {"mu": 3, "lambda": 6, "nu": 2, "evaluations": 50},
}
WRITTEN = {"datasets": {"arm": {"synthesis": "armax", "samples": 700}}, "defaults": ANALYSIS}
SETTINGS = complete(WRITTEN).datasets["arm"]
STAGES = (
    *("synthesize", "prepare", "estimate_spectrum"),
    *("estimate_candidates", "select_candidate", "complete_model", "validate", "report"),
)
SEARCHES = tuple(
    name
    for phase in PHASES
    for name in (f"estimate_candidates/{phase}/1", f"select_candidate/{phase}")
)


@pytest.fixture(scope="module", autouse=True)
def undrawn():
    """That equal results give equal drawings is tested in tests/workflow/test_runs.py."""
    with without_figures():
        yield


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """The files of a data set that was taken through all stages in one process."""
    files = DatasetFiles(str(tmp_path_factory.mktemp("identified") / "arm"))
    identify_dataset(files, SETTINGS, with_report=True)
    return files


def contents(files):
    return {path: path.read_bytes() for path in Path(files.folder).rglob("*") if path.is_file()}


def test_it_makes_every_result_and_leaves_no_parts(arm):
    made = set(map(str, contents(arm)))
    assert made == set(results_of(SETTINGS, arm, with_report=True))
    assert {arm.truth, arm.phase("nb"), arm.model_mat, arm.report, *arm.figures} <= made


def test_the_stages_are_listed_in_their_order(arm):
    names = tuple(job.name for job in jobs(SETTINGS, arm))
    assert names == STAGES[:3] + SEARCHES + STAGES[5:]


@pytest.fixture(scope="module")
def repeated(arm):
    """The contents of the files that each stage, run alone, writes again; the first contents."""
    first = contents(arm)
    written = {}
    for stage in STAGES:
        for path in first:
            os.utime(path, (1, 1))
        run_stage(stage, arm.folder, log=None)
        written[stage] = {
            path: content for path, content in contents(arm).items() if path.stat().st_mtime > 1
        }
    return written, first


@pytest.mark.parametrize("stage", STAGES)
def test_a_stage_alone_reproduces_its_files_byte_for_byte(repeated, stage):
    written, first = repeated
    assert written[stage]
    again = {path: first[path] for path in written[stage] if path in first}
    assert [path for path, content in again.items() if content != written[stage][path]] == []


def test_every_file_is_written_by_one_stage(repeated):
    written, first = repeated
    made = (path for files in written.values() for path in files if path in first)
    assert Counter(made) == Counter(list(first))


def test_progress_reaches_the_log(arm):
    lines = []
    run_stage("select_candidate/nc", arm.folder, log=lines.append)
    assert "nc: ARMAX(4,4,2,3), candidate 1 of 2" in lines
    assert "has the smallest BIC" in lines[-1]


def test_a_folder_without_a_configuration_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"config\.yaml: does not hold the complete configuration"):
        run_stage("complete_model", tmp_path)


def test_a_recorded_file_without_a_report(tmp_path, arm, monkeypatch):
    """From files instead of a simulation, an independent one for validation among them."""
    import numpy as np

    from evopem.files.json_form import load
    from evopem.signals.prepared_data import Transforms
    from evopem.signals.recording import load_recording

    monkeypatch.chdir(tmp_path)
    recording = load_recording(arm.recording)
    table = np.column_stack([recording.input, recording.output])
    for name, rows in (("a.csv", table[:500]), ("b.csv", table[500:])):
        np.savetxt(name, rows, delimiter=",", fmt="%.17g")
    keys = {"file": "a.csv", "validation_file": "b.csv", "sampling_rate": 100}
    settings = complete({"datasets": {"bench": keys}, "defaults": ANALYSIS}).datasets["bench"]
    files = DatasetFiles.of_dataset("bench")
    identify_dataset(files, settings, with_report=False)
    made = set(map(str, (path for path in contents(files))))
    assert made == set(results_of(settings, files, with_report=False))
    assert {files.validation_recording, files.validation_recording_info} <= made
    assert files.report not in made
    assert load(Transforms, files.transforms).validation_source == "file"


def test_the_key_continuous_time_gives_the_plant_in_s(arm, tmp_path):
    folder = tmp_path / "arm"
    copytree(arm.folder, folder)
    files = DatasetFiles(str(folder))
    config = Path(files.config)
    settings = yaml.safe_load(config.read_text())
    settings["datasets"]["arm"]["continuous_time"] = "zero-order"
    config.write_text(yaml.safe_dump(settings, sort_keys=False))
    run_stage("complete_model", folder, log=None)
    run_stage("report", folder, log=None)
    record = load_record(files.model)
    found = record.continuous
    (delay,) = record.orders.nk
    if found.method == "conversion":
        assert np.isclose(found.model.delays[0], (delay - 1) / record.sampling_rate)
    gain, error = found.model.static_gain()
    expected = record.model.frequency_response(np.zeros(1)).real.item()
    assert abs(gain - expected) < (1e-6 if found.method == "conversion" else 5.0 * error)
    theirs = loadmat(files.model_mat)["Continuous"][0, 0]
    num, den = theirs["Numerator"][0, 0].ravel(), theirs["Denominator"][0, 0].ravel()
    assert np.isclose(num[-1] / den[-1], gain, rtol=1e-6)
    page = Path(files.report).read_text()
    assert "In continuous time" in page
    assert "In continuous time" not in Path(arm.report).read_text()
    for quantity in found.model.quantities():
        assert number(quantity.value, 5) in page
    degree = found.model.transfer_function().relative_degree
    assert f"{record.input_names[0]} → {record.output_names[0]} {degree}." in page
