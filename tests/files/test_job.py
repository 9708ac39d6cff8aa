"""Messages of a job, and the record that it leaves unless it succeeds."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from evopem.errors import InputError
from evopem.files.job import job, unfinished_jobs

SCRIPTS = Path(__file__).parents[2] / "workflow" / "scripts"


@pytest.fixture
def log(tmp_path):
    return tmp_path / "a" / "logs" / "recording.log"


def run_job(log, body):
    """Run a job in a process of its own."""
    code = f"import sys\nfrom evopem.files.job import job\nwith job(*sys.argv[1:]) as log:\n{body}"
    return subprocess.run(
        [sys.executable, "-c", code, log],
        env=os.environ | {"PYTHONPATH": str(SCRIPTS)},
        capture_output=True,
        text=True,
        check=False,
    )


def test_bad_input_is_one_sentence_in_the_log_and_on_standard_error(log, capsys):
    with pytest.raises(SystemExit) as stop, job(log):
        raise InputError("x.csv", "it is empty", "record something")
    assert stop.value.code == 1
    assert capsys.readouterr().err == "x.csv: it is empty; record something.\n"
    assert log.read_text().splitlines()[0].endswith("x.csv: it is empty; record something.")
    assert "Traceback" not in log.read_text()


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no /dev/full")
def test_on_a_full_disk_the_error_is_one_sentence_though_the_log_cannot_be_written(log):
    log.parent.mkdir(parents=True)
    log.symlink_to("/dev/full")
    body = """
    from evopem.errors import InputError
    log.info("progress")
    raise InputError("x.csv", "it is empty", "record something")
"""
    run = run_job(log, body)
    assert (run.returncode, run.stderr) == (1, "x.csv: it is empty; record something.\n")


def test_a_lack_of_memory_is_one_sentence(log, capsys):
    with pytest.raises(SystemExit) as stop, job(log):
        np.empty(2**60, dtype=np.uint8)
    assert stop.value.code == 1
    message = capsys.readouterr().err
    assert message.startswith(f"{log.parents[1]}/recording: this job needs more memory")
    assert message.count("\n") == 1


def test_any_other_error_has_its_traceback_in_the_log(log):
    with pytest.raises(ZeroDivisionError), job(log):
        1 / 0  # noqa: B018
    assert "Traceback" in log.read_text()


def test_a_log_that_cannot_be_opened_is_one_sentence(tmp_path, capsys):
    (tmp_path / "a").write_text("a file where a folder is needed")
    with pytest.raises(SystemExit) as stop, job(tmp_path / "a" / "logs" / "recording.log"):
        pass
    assert stop.value.code == 1
    message = capsys.readouterr().err
    assert ": cannot be written (" in message
    assert message.count("\n") == 1


def test_progress_and_warnings_go_to_the_log(log):
    run = run_job(
        log, "    import warnings\n    log.info('half done')\n    warnings.warn('take care')\n"
    )
    assert run.returncode == 0
    assert run.stdout + run.stderr == ""
    assert "half done" in log.read_text()
    assert "take care" in log.read_text()


def test_a_job_that_succeeds_leaves_no_record(log):
    output = log.parents[1] / "recording.npz"
    with job(log, outputs=[output]):
        (running,) = unfinished_jobs(log.parent)
        assert running.job == "recording"
        output.write_text("samples")
    assert unfinished_jobs(log.parent) == []
    assert list(log.parent.iterdir()) == [log]


def test_a_job_that_fails_leaves_its_sentence_until_it_succeeds(log):
    output = log.parents[1] / "recording.npz"
    for _ in range(2):
        with pytest.raises(SystemExit), job(log, outputs=[output]):
            raise InputError("x.csv", "it is empty", "record something")
        (record,) = unfinished_jobs(log.parent)
        assert record.sentence == "x.csv: it is empty; record something."
    with job(log, outputs=[output]):
        output.write_text("samples")
    assert unfinished_jobs(log.parent) == []


def test_an_unexpected_error_is_described_by_its_log(log):
    with pytest.raises(ZeroDivisionError), job(log, outputs=[log.parents[1] / "x"]):
        1 / 0  # noqa: B018
    (record,) = unfinished_jobs(log.parent)
    assert record.sentence.startswith(f"{log}: the job failed with ZeroDivisionError")


def test_a_job_that_is_killed_is_said_to_end_without_a_message(log):
    """Not the last line of its log, which is about progress."""
    body = "    import os\n    log.info('generation 2')\n    os.kill(os.getpid(), 9)\n"
    head = "import sys\nfrom evopem.files.job import job\n"
    code = f"{head}with job(sys.argv[1], (), [sys.argv[2]]) as log:\n{body}"
    run = subprocess.run(
        [sys.executable, "-c", code, log, log.parents[1] / "recording.npz"],
        env=os.environ | {"PYTHONPATH": str(SCRIPTS)},
        check=False,
    )
    assert run.returncode == -signal.SIGKILL
    (record,) = unfinished_jobs(log.parent)
    assert record.sentence.startswith("the job recording ended without a message")


def fail(log, *outputs):
    with pytest.raises(SystemExit), job(log, outputs=outputs):
        raise InputError("x.csv", "it is empty", "record something")


@pytest.mark.parametrize("later", ["phases/delay", "identification"])
def test_a_job_that_makes_the_whole_ends_the_records_of_its_parts(tmp_path, later):
    """Also when it fails, and when there are no parts any more."""
    folder = tmp_path / "a"
    fail(folder / "logs" / "phases" / "delay" / "part-7.log", folder / "phases/delay/part-7.json")
    fail(folder / "logs" / "spectrum.log", folder / "spectrum.json")
    outputs = [folder / "phases" / "delay.json"]
    outputs += [folder / "spectrum.json"] if later == "identification" else []
    left = [] if later == "identification" else ["spectrum"]
    with pytest.raises(ZeroDivisionError), job(folder / "logs" / f"{later}.log", outputs=outputs):
        1 / 0  # noqa: B018
    assert [record.job for record in unfinished_jobs(folder / "logs")] == [later, *left]
    with job(folder / "logs" / f"{later}.log", outputs=outputs):
        for output in outputs:
            output.parent.mkdir(exist_ok=True)
            output.write_text("{}")
    assert [record.job for record in unfinished_jobs(folder / "logs")] == left


def test_a_job_that_makes_only_a_part_leaves_the_record_of_the_whole(tmp_path):
    folder = tmp_path / "a"
    whole = [folder / "recording.npz", folder / "model.json"]
    fail(folder / "logs" / "identification.log", *whole)
    for name, output in zip(("recording", "model"), whole, strict=True):
        assert [each.job for each in unfinished_jobs(folder / "logs")] == ["identification"]
        with job(folder / "logs" / f"{name}.log", outputs=[output]):
            output.write_text("{}")
    assert unfinished_jobs(folder / "logs") == []


def test_the_newest_record_comes_first(tmp_path):
    logs = tmp_path / "a" / "logs"
    for number in (1, 2, 3):
        fail(logs / f"{number}.log", tmp_path / "a" / f"{number}.json")
    for number, time in ((1, 20), (2, 30), (3, 10)):
        os.utime(logs / f"{number}.unfinished.json", (time, time))
    (logs / "4.unfinished.json").write_text((logs / "3.unfinished.json").read_text()[:20])
    assert [record.job for record in unfinished_jobs(logs)] == ["2", "1", "3"]
