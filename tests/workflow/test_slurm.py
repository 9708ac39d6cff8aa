"""The workflow on a real SLURM: `make test-slurm` starts one where it can."""

import csv
import os
import shutil
import signal
import subprocess
import tempfile
import time
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from .conftest import ROOT, TINY, Folder


def answers():
    if os.environ.get("EVOPEM_TEST_SLURM") != "1":
        return False
    return (
        bool(shutil.which("sinfo")) and subprocess.run("sinfo", capture_output=True).returncode == 0
    )


pytestmark = pytest.mark.skipif(
    not answers(), reason="no SLURM was asked for (make test-slurm) or answers"
)
PROFILE = ("--workflow-profile", str(ROOT / "profiles" / "slurm"))
ON_SLURM = (*PROFILE, "--slurm-init-seconds-before-status-checks", "3")
ONE_JOB = TINY | {"one_job_per": "recording", "report": "none", "candidates_per_job": "auto"}
RESULTS = (
    *("model.json", "model.mat", "modes.csv", "candidates.csv", "frequency_response.csv"),
    *("validation.json", "residual_autocorrelation.csv", "cross_correlation.csv"),
    *("simulation.csv", "spectrum.csv", "spectrum.json", "summary.json", "transforms.json"),
)


class Runs:
    """Runs side by side, each in a folder of its own: SLURM's waits then overlap."""

    def __init__(self, base):
        self.base, self.folders, self.running = base, {}, {}

    def start(self, name, config, *arguments, command=None):
        folder = self.folders.setdefault(name, Folder(self.base / name))
        folder.path.mkdir(exist_ok=True)
        folder.configure(config)
        with (folder.path / "output.txt").open("a") as output:
            self.running[name] = subprocess.Popen(
                command or folder.command(*arguments),
                cwd=folder.path,
                stdout=output,
                stderr=subprocess.STDOUT,
                start_new_session=True,
                # What a shell starts in the background ignores interrupts, and so do its children.
                preexec_fn=partial(signal.signal, signal.SIGINT, signal.SIG_DFL),
            )
        return folder

    def end(self, name, seconds=400):
        """Wait for a run; what it printed, its exit code."""
        code = self.running[name].wait(timeout=seconds)
        return (self.folders[name].path / "output.txt").read_text(), code

    def stop(self):
        for run in self.running.values():
            if run.poll() is None:
                os.killpg(run.pid, signal.SIGINT)
        for run in self.running.values():
            run.wait(timeout=60)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    # SLURM's accounting outlives the folders of pytest and tells runs apart by their folders alone.
    started = Runs(Path(tempfile.mkdtemp(dir=tmp_path_factory.mktemp("slurm"))))
    started.start("stages", TINY | {"candidates_per_job": "auto"}, *ON_SLURM, *threads(2))
    started.start("time", ONE_JOB, *ON_SLURM, *needs("mem_mb=1000", "runtime=attempt"))
    started.start("memory", ONE_JOB, *ON_SLURM, *needs("mem_mb=200*attempt**2", "runtime=5"))
    started.start("cancelled", ONE_JOB, *ON_SLURM)
    hold_up(started.folders["time"])
    yield started
    started.stop()


def threads(count):
    return ("--set-threads", f"estimate_candidates={count}")


def needs(*resources):
    rule = "identification"
    return ("--set-resources", *(f"{rule}:{resource}" for resource in resources))


def until(found, what, seconds=120):
    deadline = time.monotonic() + seconds
    while not (value := found()):
        assert time.monotonic() < deadline, f"{what} did not come"
        time.sleep(0.3)
    return value


def listed(command, *arguments):
    """What SLURM lists, a row a line."""
    printed = subprocess.run(
        [command, "--noheader", *arguments], capture_output=True, text=True, check=True
    ).stdout
    return [line.split("|") for line in printed.splitlines()]


def accounted(*fields):
    """What SLURM keeps of all jobs and their steps, those that ended included."""
    # By default the list begins at the last midnight, which may pass during the tests.
    return listed(
        *("sacct", "--starttime=now-1days", "--parsable2", "--units=M"),
        f"--format=JobID,WorkDir,{','.join(fields)}",
    )


def jobs_of(folder):
    """SLURM's jobs of a run, those still there: their numbers."""
    rows = listed("squeue", "--format=%i|%Z")
    return [number for number, place in rows if Path(place) == folder.path]


def states(folder):
    """How the jobs of a run ended, in their order."""
    # Steps of a job have no folder of their own.
    return [
        state.split()[0]
        for _, place, state in accounted("State")
        if place and Path(place) == folder.path
    ]


def peak_of_first_job(folder):
    """The most memory, in MB, that SLURM saw the first job of a run use."""
    rows = accounted("MaxRSS")
    first = next(number for number, place, _ in rows if place and Path(place) == folder.path)
    peaks = [peak for number, _, peak in rows if number.startswith(f"{first}.") and peak]
    return max(float(peak.removesuffix("M")) for peak in peaks)


def script_of(folder):
    """The process in which a job of a run computes."""
    for process in Path("/proc").glob("[0-9]*"):
        try:
            words = (process / "cmdline").read_bytes().split(b"\0")
            here = (process / "cwd").resolve() == folder.path
        except OSError:
            continue
        if here and any(b".snakemake/scripts/" in word for word in words):
            return int(process.name)
    return None


def hold_up(folder):
    """Stop the process of a run's job, for it to last until SLURM, or somebody, ends it."""
    os.kill(until(lambda: script_of(folder), "the job's process"), signal.SIGSTOP)


def test_a_run_that_is_stopped_leaves_no_job_and_goes_on_later(runs):
    """Ctrl-C takes the jobs along, also after somebody cancelled one of them.

    The executor does not notice that (it knows no state "CANCELLED by 0") and would wait for ever.
    """
    folder = runs.folders["cancelled"]
    for cancelled_by_hand in (False, True):
        hold_up(folder)
        if cancelled_by_hand:
            (number,) = jobs_of(folder)
            subprocess.run(["scancel", number], check=True)
        os.killpg(runs.running["cancelled"].pid, signal.SIGINT)
        _, code = runs.end("cancelled")
        assert code != 0
        until(lambda: not jobs_of(folder), "the end of all jobs")
        until(lambda: script_of(folder) is None, "the end of all processes")
        assert not (folder.results / "truth" / "model.json").exists()
        runs.start("cancelled", ONE_JOB, *ON_SLURM)
    output, code = runs.end("cancelled")
    assert code == 0, output
    assert states(folder) == ["CANCELLED", "CANCELLED", "COMPLETED"]


def test_a_job_out_of_time_gets_more(runs):
    """Its first attempt is held up until SLURM ends it after the minute that it asked for."""
    folder = runs.folders["time"]
    until(lambda: "TIMEOUT" in states(folder), "SLURM's time limit", seconds=180)
    output, code = runs.end("time")
    assert code == 0, output
    assert states(folder) == ["TIMEOUT", "COMPLETED"]


def test_a_job_out_of_memory_gets_more(runs):
    output, code = runs.end("memory")
    assert code == 0, output
    folder = runs.folders["memory"]
    # Without cgroups SLURM kills the step that it sees above its limit, and the job then fails.
    assert states(folder)[0] in ("OUT_OF_MEMORY", "FAILED")
    assert peak_of_first_job(folder) > 200
    assert states(folder)[-1] == "COMPLETED"


def test_an_array_job_takes_a_fleet_in_shards(runs, recorded):
    """Two tasks identify two recordings each, the last job lists them, one of them bad."""
    folder = Folder(runs.base / "fleet")
    (folder.path / "data").mkdir(parents=True)
    for number in range(1, 4):
        np.savetxt(folder.path / "data" / f"{number}.csv", recorded[number:], delimiter=",")
    (folder.path / "data" / "4.csv").write_text("1.5,2.5\n3.5,oops\n" * 300)
    fleet = {"r*": {"file": "data/*.csv", "sampling_rate": 100}}
    config = ONE_JOB | {"recordings_per_job": 2, "datasets": fleet}
    array_job = [str(ROOT / "profiles" / "slurm" / "array_job.sh"), "2", "--time=5", "--mem=1000"]
    runs.folders["fleet"] = folder
    runs.start("fleet", config, command=array_job)
    output, code = runs.end("fleet")
    assert code == 0, output
    until(lambda: not jobs_of(folder), "the end of the array job", seconds=240)
    with (folder.results / "fleet.csv").open() as stream:
        rows = {row["dataset"]: row for row in csv.DictReader(stream)}
    assert [row["status"] for row in rows.values()] == ["complete"] * 3 + ["failed"]
    assert "4.csv, line 2" in rows["r4"]["problem"]


def test_any_scheduler_with_a_submit_command(runs):
    """The generic profile with two lines for this one."""
    submit = "sbatch --parsable --mem={resources.mem_mb} --time={resources.runtime} -c {threads}"
    runs.start(
        "generic",
        ONE_JOB,
        *("--workflow-profile", str(ROOT / "profiles" / "generic")),
        *("--cluster-generic-submit-cmd", submit),
        *("--cluster-generic-cancel-cmd", "scancel"),
    )
    output, code = runs.end("generic")
    assert code == 0, output
    folder = runs.folders["generic"]
    assert (folder.results / "truth" / "model.json").exists()
    assert states(folder) == ["COMPLETED"]


def test_results_are_those_of_a_local_run(runs, finished):
    output, code = runs.end("stages")
    assert code == 0, output
    folder = runs.folders["stages"]
    assert set(states(folder)) == {"COMPLETED"}
    assert len(states(folder)) == 3  # preparation, order search, results
    for name in RESULTS:
        here, there = (each.results / "truth" / name for each in (folder, finished))
        assert here.read_bytes() == there.read_bytes(), name
    one_job = runs.folders["memory"].results / "truth" / "model.json"
    assert one_job.read_bytes() == (finished.results / "truth" / "model.json").read_bytes()


def test_nothing_is_left_running(runs):
    assert [job for folder in runs.folders.values() for job in jobs_of(folder)] == []
