"""The tutorial: its configuration is the example's, and its numbers come out of a run."""

import re
import shutil

import pytest
import yaml

from evopem.estimation.model_record import load_model
from evopem.files.json_form import load
from evopem.validation.validation import Validation

from .conftest import ROOT, Folder

TUTORIAL = (ROOT / "docs" / "tutorial.md").read_text(encoding="utf-8")
EXAMPLE = ROOT / "examples" / "motor_bench"


def test_the_configuration_is_that_of_the_example():
    blocks = [
        yaml.safe_load(block) for block in re.findall(r"```yaml\n(.*?)```", TUTORIAL, re.S)[1:]
    ]
    assert blocks == [yaml.safe_load((EXAMPLE / "config.yaml").read_text())]


def test_the_numbers_come_out_of_a_run(tmp_path):
    folder = Folder(tmp_path / "bench")
    shutil.copytree(EXAMPLE, folder.path)
    printed = folder.finish("--config", "one_job_per=recording", "report=none")
    files = folder.files_of("motor_bench")
    modes = load_model(files.model).modes()
    nearest = min(modes, key=lambda mode: abs(mode.frequency_hz - 76.4))
    shown = re.search(r"1      (\S+) ± \S+   (\S+) ± ", TUTORIAL)
    assert nearest.frequency_hz == pytest.approx(float(shown[1]), abs=0.1)
    assert 100.0 * nearest.damping_ratio == pytest.approx(float(shown[2]), abs=0.1)
    error = float(re.search(r"simulation (\S+) %", TUTORIAL)[1])
    simulation = load(Validation, files.validation).simulation_error_percent
    assert simulation == pytest.approx(error, abs=0.5)
    block = TUTORIAL.partition("ends with\n\n```text\n")[2].partition("  report  ")[0]
    assert words(block) in words(printed)


def words(text):
    """Text without its numbers, whose last digits may differ between processors."""
    return " ".join(re.sub(r"[\d.,]+", "#", text).split())
