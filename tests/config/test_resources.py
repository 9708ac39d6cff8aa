"""Memory and time that jobs ask for, against numbers computed by hand."""

from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from evopem.config import configuration
from evopem.config.defaults import complete


def dataset(text):
    return complete(yaml.safe_load(f"datasets: {{a: {{{text}}}}}")).datasets["a"]


@pytest.fixture
def simulated():
    """5000 samples and the built-in grids, whose largest model has 14 + 16 + 16 parameters."""
    return dataset("recipe: chapter, synthesis: armax")


@pytest.fixture
def recorded(tmp_path, monkeypatch):
    """10 MB to estimate from and 6 MB to validate on."""
    monkeypatch.chdir(tmp_path)
    for name, size in (("a.csv", 10_000_000), ("b.csv", 6_000_000)):
        with Path(name).open("wb") as stream:
            stream.truncate(size)
    return dataset("recipe: chapter, file: a.csv, validation_file: b.csv")


def test_a_job_that_reads_asks_for_the_size_of_its_recordings(recorded, simulated):
    assert configuration.recording_bytes(recorded) == 16_000_000
    # 800 MB and 40 bytes for each of the file; 5 minutes and a quarter of one for each MB.
    assert configuration.reading_memory(recorded, attempt=1) == 800 + 640
    assert configuration.reading_time(recorded, attempt=1) == 5 + 4
    # Two signals of 5000 floats.
    assert configuration.recording_bytes(simulated) == 80_000
    assert configuration.reading_memory(simulated, attempt=1) == 803
    assert configuration.reading_time(simulated, attempt=1) == 5


def test_every_further_attempt_asks_for_more(recorded, simulated):
    assert configuration.reading_memory(recorded, attempt=3) == 3 * 1440
    assert configuration.reading_time(recorded, attempt=3) == 3 * 9
    assert configuration.estimation_memory(simulated, threads=1, attempt=2) == 1336
    assert configuration.estimation_time(simulated, "delay", "auto", threads=1, attempt=2) == 37


def test_a_job_that_estimates_asks_for_its_processes(recorded, simulated):
    # 250 MB and 80 bytes for each of 5000 * 46 entries: 268.4 MB a process.
    assert configuration.estimation_memory(simulated, threads=1, attempt=1) == 400 + 268
    assert configuration.estimation_memory(simulated, threads=4, attempt=1) == 400 + 5 * 268.4
    # At most 2 million samples of 8 bytes: 400 MB and 400 bytes for each, not 80 * 46.
    assert configuration.max_samples(recorded) == 2_000_000
    assert configuration.estimation_memory(recorded, threads=1, attempt=1) == 400 + 1200


@pytest.mark.parametrize(
    ("outputs", "megabytes"), [("2", 400 + 400 + 800), ("[2, 3]", 1200 + 3200), ("y_*", 4400)]
)
def test_the_automatic_recipe_asks_by_the_size_of_recordings_and_compares_outputs_on_all_samples(
    recorded, outputs, megabytes
):
    found = dataset(f"file: a.csv, validation_file: b.csv, input: [1, 4], output: {outputs}")
    assert configuration.estimation_memory(found, threads=1, attempt=1) == megabytes
    assert configuration.estimation_time(found, None, "auto", threads=1, attempt=1) == 60 + 960
    assert configuration.recording_seconds(found) == 3.5 + 200


@pytest.mark.parametrize(
    ("phase", "per_job", "threads", "minutes"),
    [
        # 2 s and 2 ns for each of 20 000 evaluations of 5000 * 46 entries: 11.2 s a candidate.
        # Three times that for 16, 9, 15 and 15 candidates, after ten minutes.
        ("delay", "auto", 1, 10 + 8.96),
        ("plant", "auto", 1, 10 + 5.04),
        ("nc", "auto", 1, 10 + 8.4),
        (None, "auto", 1, 10 + 30.8),
        (None, "auto", 4, 10 + 7.7),
        # 16 candidates in three jobs: six in the largest. Nine in two: five.
        ("delay", 6, 1, 10 + 3.36),
        ("plant", 6, 1, 10 + 2.8),
    ],
)
def test_a_job_that_estimates_asks_for_the_time_of_its_candidates(
    simulated, phase, per_job, threads, minutes
):
    asked = configuration.estimation_time(simulated, phase, per_job, threads, attempt=1)
    assert asked == int(minutes)


@pytest.mark.parametrize("name", ["missing.csv", "x" * 5000 + ".csv", "nul\0byte.csv"])
def test_a_file_that_does_not_exist_counts_nothing(name):
    settings = complete({"datasets": {"a": {"file": "x.csv"}}}).datasets["a"]
    settings = replace(settings, source=replace(settings.source, files=(name,)))
    assert configuration.recording_bytes(settings) == 0
    assert configuration.reading_memory(settings, attempt=1) == 800
