"""The shortest test that notices a broken package: every module loads, and the workflow plans."""

import importlib
import pkgutil
import subprocess
import sys
from pathlib import Path

import evopem

ROOT = Path(__file__).resolve().parents[1]
# Fonts and colours of the figures: loading them takes most of the time of all modules.
NOT_NEEDED = ("evopem.figures.style",)


def test_every_module_loads():
    for module in pkgutil.walk_packages(evopem.__path__, "evopem."):
        if module.name not in NOT_NEEDED:
            importlib.import_module(module.name)


def test_the_default_configuration_plans(tmp_path):
    command = [sys.executable, "-m", "snakemake", "--dry-run", "--quiet", "all"]
    run = subprocess.run(
        [
            *(*command, "--snakefile", str(ROOT / "Snakefile"), "--directory", str(tmp_path)),
            *("--configfile", str(ROOT / "config.yaml"), "--profile", "none"),
        ],
        capture_output=True,
        text=True,
        cwd=ROOT,
    )
    assert run.returncode == 0, run.stderr
