"""A job ends with the process that started it, however that ends."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

JOB = """
import time
from evopem.files.job import end_with_parent
end_with_parent()
print("started", flush=True)
time.sleep(60)
"""
PARENT = """
import os, subprocess, sys, time
from evopem.files.job import interrupt_on_hangup
interrupt_on_hangup()
job = subprocess.Popen([sys.executable, "-c", sys.argv[1]], stdout=subprocess.PIPE)
job.stdout.readline()
try:
    print(job.pid, flush=True)
    time.sleep(60)
except KeyboardInterrupt:
    sys.exit(3)
"""


def is_running(process):
    try:
        stat = Path(f"/proc/{process}/stat").read_text()
        return stat.rpartition(")")[2].split()[0] != "Z"
    except FileNotFoundError:
        return False


def ends(process):
    deadline = time.monotonic() + 10
    while is_running(process) and time.monotonic() < deadline:
        time.sleep(0.1)
    return not is_running(process)


@pytest.fixture
def run():
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    parent = subprocess.Popen(
        [sys.executable, "-c", PARENT, JOB],
        env=environment,
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGHUP, signal.SIG_DFL),
    )
    job = int(parent.stdout.readline())
    yield parent, job
    parent.kill()
    parent.wait()


def test_a_job_ends_when_its_run_is_killed(run):
    parent, job = run
    assert is_running(job)
    parent.kill()
    parent.wait()
    assert ends(job)


def test_a_hangup_interrupts_the_run_and_its_jobs(run):
    parent, job = run
    parent.send_signal(signal.SIGHUP)
    assert parent.wait(timeout=10) == 3
    assert ends(job)
