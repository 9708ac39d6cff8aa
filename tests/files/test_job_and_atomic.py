"""What a job says, and how its files come to be."""

import subprocess
import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from evopem.errors import InputError
from evopem.files.atomic import atomic_write, write_json, write_table
from evopem.files.job import job

SCRIPTS = Path(__file__).parents[2] / "workflow" / "scripts"


def test_a_users_mistake_is_one_sentence_in_the_log_and_on_the_console(tmp_path, capsys):
    log = tmp_path / "logs" / "job.log"
    with pytest.raises(SystemExit) as stop, job(log):
        raise InputError("x.csv", "it is empty", "record something")
    assert stop.value.code == 1
    assert capsys.readouterr().err == "x.csv: it is empty; record something.\n"
    assert log.read_text().splitlines()[0].endswith("x.csv: it is empty; record something.")
    assert "Traceback" not in log.read_text()


def test_memory_that_runs_out_is_one_sentence(tmp_path, capsys):
    with pytest.raises(SystemExit) as stop, job(tmp_path / "logs" / "fit.log"):
        np.empty(2**60, dtype=np.uint8)
    assert stop.value.code == 1
    said = capsys.readouterr().err
    assert said.startswith(f"{tmp_path}/logs/fit: this job needs more memory than it may have;")
    assert said.count("\n") == 1


def test_any_other_error_keeps_its_traceback_in_the_log(tmp_path):
    log = tmp_path / "job.log"
    with pytest.raises(ZeroDivisionError), job(log):
        1 / 0  # noqa: B018
    assert "Traceback" in log.read_text()


def test_progress_and_warnings_go_to_the_log(tmp_path):
    code = (
        "import sys, warnings; from evopem.files.job import job\n"
        "with job(sys.argv[1]) as log:\n"
        "    log.info('half done')\n"
        "    warnings.warn('take care')\n"
    )
    log = tmp_path / "job.log"
    run = subprocess.run(
        [sys.executable, "-c", code, log],
        env={"PYTHONPATH": str(SCRIPTS)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert run.stdout + run.stderr == ""
    assert "half done" in log.read_text()
    assert "take care" in log.read_text()


def test_a_file_whose_writing_fails_stays_as_it_was(tmp_path):
    path = tmp_path / "result.txt"
    path.write_text("old")
    with pytest.raises(UnicodeEncodeError), atomic_write(path) as temporary:
        temporary.write_text("half of it \udc00", encoding="utf-8")
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_json_refuses_what_is_not_json(tmp_path):
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_json(tmp_path / "x.json", {"value": float("nan")})
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("as_frame", [True, False])
def test_tables_keep_every_bit(tmp_path, as_frame):
    generator = np.random.default_rng(1)
    table = {
        "count": np.arange(50),
        "value": generator.normal(size=50) * 10.0 ** generator.integers(-300, 300, 50),
        "name": [f'a "b", {i}' for i in range(50)],
        "chosen": generator.random(50) < 0.5,
    }
    table["value"][7] = np.nan
    path = tmp_path / "table.csv"
    write_table(path, pd.DataFrame(table) if as_frame else table)
    read = pd.read_csv(path)
    pd.testing.assert_frame_equal(read, pd.DataFrame(table), check_exact=True)
    assert path.read_text().splitlines()[8].split(",")[1] == ""
