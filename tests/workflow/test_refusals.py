"""What stops a whole run: one sentence on the terminal, no traceback, nothing written."""

import os
import re
import subprocess
from pathlib import Path

import pytest
import yaml

from evopem.config.defaults import complete
from evopem.config.strict_yaml import check_yaml_files
from evopem.errors import InputError

CONFIG = "datasets: {a: {synthesis: armax, samples: 700}}\n"


def refusal(folder, config=CONFIG, prefix=(), **environment):
    (folder.path / "config.yaml").write_text(config)
    if prefix:
        run = subprocess.run(
            [*prefix, *folder.command("--cores", "1")],
            cwd=folder.path,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            check=False,
            timeout=120,
        )
    else:
        run = folder.run("--cores", "1", **environment)
    assert run.returncode != 0
    assert "Traceback" not in run.stdout
    assert 'File "' not in run.stdout
    lines = [line for line in run.stdout.splitlines() if re.fullmatch(r".+: .+; .+\.", line)]
    assert len(lines) == 1, run.stdout
    return lines[0]


HOSTILE = [
    ("datasets: {a: {file: 2024-13-45}}\n", "config.yaml, line 1: YAML reads 2024-13-45"),
    ("datasets: &a {b: *a}\n", "leads back"),
    ("datasets: {a: {file: x, sampling_rate: 0100}}\n", "YAML reads 0100 as 64"),
    (f"datasets: {'[' * 3000}\n", "nested too deeply"),
    (f"datasets: {{a: {{file: x, sampling_rate: 1{'0' * 400}}}}}\n", "401 digits"),
    ('datasets: {a: {file: x, input_unit: "\\ud800"}}\n', "U+D800"),
    ("datasets: {a: {file: !!int x}}\n", "the tag !!int"),
    ("datasets: {a: {file: results/a/simulation.csv}}\n", "is a result of this workflow"),
    ("datasets: {fleet.csv: {synthesis: armax}}\n", "the name of something else"),
]


@pytest.mark.parametrize(("config", "said"), HOSTILE)
def test_a_hostile_configuration_is_refused_in_a_sentence(tmp_path, monkeypatch, config, said):
    monkeypatch.chdir(tmp_path)
    path = Path("config.yaml")
    path.write_text(config)

    def read():
        check_yaml_files([path])
        complete(yaml.safe_load(config))

    with pytest.raises(InputError) as refused:
        read()
    assert said in str(refused.value)
    assert re.fullmatch(r"config\.yaml.*: .+; .+\.", str(refused.value))


# One that YAML itself hides, one that exhausts a reader, and one that the completion refuses.
@pytest.mark.parametrize(("config", "said"), [HOSTILE[0], HOSTILE[3], HOSTILE[7]])
def test_a_run_says_that_sentence_and_writes_nothing(folder, config, said):
    assert said in refusal(folder, config)
    assert not folder.results.exists()


def test_results_that_are_a_file(folder):
    folder.results.write_text("mine")
    assert refusal(folder).startswith("results: is no folder")
    assert folder.results.read_text() == "mine"


def test_an_environment_in_which_no_search_can_run(folder):
    assert refusal(folder, NUMBA_DISABLE_JIT="1").startswith("NUMBA_DISABLE_JIT: ")
    limited = ("bash", "-c", 'ulimit -v 700000; exec "$@"', "bash")
    assert refusal(folder, prefix=limited).startswith("ulimit -v: ")
    assert not folder.results.exists()


def test_a_pipe_as_the_configuration(folder):
    os.mkfifo(folder.path / "config.yaml")
    assert "config.yaml: is not a regular file; " in folder.run("--dry-run").stdout
