"""Results that a run has not finished, or that were changed afterwards, are not read."""

import shutil
from pathlib import Path

import pytest
from identified import finish

import evopem
from evopem.files.checksums import write_checksums
from evopem.files.job import job
from evopem.results.dataset import read_results
from evopem.results.identity import check_results, incompleteness
from evopem.results.layout import DatasetFiles


@pytest.fixture
def files(identified, tmp_path):
    files = DatasetFiles(str(shutil.copytree(identified.files.folder, tmp_path / "bench")))
    finish(files)
    return files


def test_a_link_to_a_result_is_verified_as_the_result(files, tmp_path):
    link = tmp_path / "link.json"
    link.symlink_to(files.model)
    assert evopem.load(link).sampling_rate > 0
    Path(files.model).write_text(Path(files.model).read_text().replace("1", "2", 1))
    with pytest.raises(evopem.InputError, match="was changed or damaged"):
        evopem.load(link)


@pytest.mark.parametrize(
    ("job_name", "program"), [("identification", "snakemake"), ("evopem", "evopem")]
)
def test_the_remedy_names_what_made_the_results(files, job_name, program):
    shutil.rmtree(Path(files.folder, "checksums"))
    made = [file for file in Path(files.folder).rglob("*") if file.is_file()]
    write_checksums(made, files.folder, job_name)
    Path(files.validation).write_text("{}")
    with pytest.raises(evopem.InputError, match=f"and run {program} again"):
        evopem.read_results(files.folder)
    Path(files.model).write_text("{}")
    with pytest.raises(evopem.InputError, match=f"and run {program} again, which"):
        evopem.load(files.model)
    Path(files.model).unlink()
    with pytest.raises(evopem.InputError, match=f"not been made; run {program} again"):
        evopem.read_results(files.folder)
    with pytest.raises(KeyboardInterrupt), job(files.log(job_name), (), [files.model]):
        raise KeyboardInterrupt
    with pytest.raises(evopem.InputError, match=f"was interrupted; run {program} again"):
        evopem.read_results(files.folder)


def test_whole_results_are_read(files):
    check_results(files)
    assert evopem.read_results(files.folder).name == "bench"
    assert evopem.load(files.model).sampling_rate > 0


@pytest.mark.parametrize("name", ["validation.json", "model.json", "config.yaml", "simulation.csv"])
def test_a_changed_file_is_named_and_not_read(files, name):
    file = Path(files.folder) / name
    content = file.read_text()
    file.write_text(content.replace("1", "2", 1) if name != "simulation.csv" else content[:300])
    with pytest.raises(evopem.InputError, match=f"{name}: was changed or damaged"):
        evopem.read_results(files.folder)
    if name == "model.json":
        with pytest.raises(evopem.InputError, match="was changed or damaged"):
            evopem.load(file)


@pytest.mark.parametrize("name", ["simulation.csv", "config.yaml", "recording.npz"])
def test_a_result_that_no_finished_job_has_written_is_not_read(files, name):
    for listed in Path(files.folder, "checksums").rglob("*.sha256"):
        kept = [each for each in listed.read_text().splitlines(True) if f"  {name}" not in each]
        listed.write_text("".join(kept))
    with pytest.raises(evopem.InputError, match=f"{name}: has no checksum"):
        evopem.read_results(files.folder)


def test_another_data_set_s_file_is_not_read_along(files):
    """Whether there is a validation recording the configuration says, and not the folder."""
    shutil.copy(files.recording_info, files.validation_recording_info)
    assert read_results(files).validation_recording_info is None
    with pytest.raises(evopem.InputError, match=r"validation_recording\.json: has no checksum"):
        evopem.read_results(files.folder)


def killed(files, *outputs):
    """Leave what a job leaves that was killed: its record, and none of some outputs."""
    record = Path(files.log("identification")).with_suffix(".unfinished.json")

    def work():
        for output in outputs:
            Path(output).unlink()
        raise KeyError

    with pytest.raises(KeyError), job(files.log("identification"), (), [files.summary, *outputs]):
        work()
    record.write_text(record.read_text().replace('"message": "', '"message": "killed '))


def test_an_interrupted_run_again_leaves_nothing_that_is_read(files):
    """A new model beside the old validation and summary."""
    killed(files, files.report if Path(files.report).exists() else files.validation)
    with pytest.raises(evopem.InputError, match="not whole"):
        evopem.read_results(files.folder)
    with pytest.raises(evopem.InputError, match=r"has not|unfinished|not whole"):
        check_results(files)


@pytest.mark.parametrize("made", ["summary", "candidates", "simulation"])
def test_a_mixture_of_two_runs_is_not_read(files, made):
    """Every file is as its job wrote it, and the model is newer than what was made from it."""
    output = getattr(files, made)
    content = Path(output).read_bytes()
    with job(files.log(made), [files.model, files.recording], [output]):
        Path(output).write_bytes(content)
    check_results(files)
    with job(files.log("model"), (), [files.model]):
        model = Path(files.model)
        model.write_text(model.read_text().replace('"evopem": "', '"evopem": "x'))
    with pytest.raises(evopem.InputError, match=f"{output}: was not made from the .* model.json"):
        evopem.read_results(files.folder)
    with job(files.log(made), [files.model, files.recording], [output]):
        Path(output).write_bytes(content)
    check_results(files)


def test_results_without_checksums_were_not_finished(files):
    shutil.rmtree(Path(files.folder) / "checksums")
    with pytest.raises(evopem.InputError, match="has no checksum"):
        evopem.read_results(files.folder)


def test_a_job_that_the_present_results_do_not_have_does_not_count(files):
    """A structure whose search had failed was taken out of the configuration."""
    with pytest.raises(SystemExit), job(files.log("search"), (), [files.search("bj")]):
        raise evopem.InputError("x.csv", "is too short", "record longer")
    assert incompleteness(files).status == "failed"
    Path(files.summary).touch()  # made anew, by a run without that search
    finish(files)
    write_checksums([files.summary], files.folder, "summary")
    check_results(files)


def test_jobs_of_the_same_run_may_read_before_it_ends(files, identified):
    shutil.rmtree(Path(files.folder) / "checksums")
    assert read_results(files).name == "bench"
