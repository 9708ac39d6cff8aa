"""The wheel: what is in it, and the README's example without the packages of any extra.

user_commands.sh installs it in an environment that has nothing else.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "workflow" / "scripts" / "evopem"
TEMPLATES = ROOT / "workflow" / "templates"
SCHEMAS = ROOT / "workflow" / "schemas"
# The example's `input` and `output`: a record of the model whose orders the example gives.
RECORD = """
from evopem.synthesis import armax
recording, _ = armax(seed=3, samples=2000)
input, output = recording.input, recording.output
"""
RESULTS = """
import json
import numpy as np
response = model.frequency_response([1.0, 2.0, 5.0])[:, 0, 0]
scipy_model = model.to_scipy()
z = np.exp(2j * np.pi * np.array([1.0, 2.0, 5.0]) / model.sampling_rate)
from_scipy = np.polyval(scipy_model.num, z) / np.polyval(scipy_model.den, z)
print(json.dumps({
    "frequencies": [mode.frequency_hz for mode in found.model.modes()],
    "response_error": float(np.max(np.abs(from_scipy / response - 1.0))),
}))
"""
# What the extras of pyproject.toml bring cannot be imported.
NO_EXTRAS = """
import sys
extras = ["pandas", "matplotlib", "jinja2", "snakemake", "h5py", "control"]
sys.modules.update(dict.fromkeys(extras))
"""


def readme_example():
    """The lines of the README's last Python block, which needs no extra."""
    *_, block = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    return block.splitlines(keepends=True)


def run_python(code, folder, package=PACKAGE.parent):
    """Standard output of a script that has the package on its path."""
    run = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(package)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
    shutil.copytree(ROOT / "workflow", source / "workflow", ignore=ignored)
    arguments = ("--no-deps", "--wheel-dir", folder, source)
    run = subprocess.run(
        [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    if "No matching distribution found" in run.stderr and "CI" not in os.environ:
        pytest.skip("no package index answers")
    assert run.returncode == 0, run.stderr
    (built,) = folder.glob("*.whl")
    return built


def test_every_module_template_and_schema_is_in_the_wheel(wheel):
    with zipfile.ZipFile(wheel) as archive:
        packed = {name for name in archive.namelist() if ".dist-info/" not in name}
    modules = {f"evopem/{path.relative_to(PACKAGE)}" for path in PACKAGE.rglob("*.py")}
    templates = {
        f"evopem/templates/{path.relative_to(TEMPLATES).as_posix()}"
        for path in TEMPLATES.rglob("*")
        if path.is_file()
    }
    schemas = {f"evopem/schemas/{path.name}" for path in SCHEMAS.iterdir()}
    assert packed == modules | templates | schemas | {"evopem/py.typed", "evopem/__init__.pyi"}


def test_the_example_of_the_readme_runs_without_any_extra(identified, tmp_path):
    (tmp_path / "results" / "arm").mkdir(parents=True)
    shutil.copy(identified.files.model, tmp_path / "results" / "arm" / "model.json")
    lines = readme_example()
    without_control = "".join(line for line in lines if "to_control" not in line)
    assert len(without_control.splitlines()) == len(lines) - 1

    results = json.loads(run_python(NO_EXTRAS + RECORD + without_control + RESULTS, tmp_path))
    assert results["frequencies"] == pytest.approx([5.36, 16.65, 37.0], rel=0.02)
    assert results["response_error"] < 1e-9

    code = "import evopem, control\n" + "".join(lines[-5:])
    code += "\nprint(type(model.to_control()) is control.TransferFunction)"
    assert run_python(code, tmp_path) == "True\n"


def test_the_wheel_writes_reports(wheel, identified, tmp_path):
    """The templates are found beside the installed package."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    shutil.copytree(identified.files.folder, tmp_path / "results" / "bench")
    code = (
        "import evopem\n"
        "from evopem.pipeline import report\n"
        "from evopem.pipeline.identification import run_stage\n"
        "from evopem.report.templates import template_folder\n"
        "from evopem.results.layout import FIGURES\n"
        "report.svg_texts = lambda _: dict.fromkeys(FIGURES, '<svg/>')\n"  # drawn elsewhere
        "run_stage('report', 'results/bench', log=None)\n"
        "print(template_folder(), evopem.__file__)\n"
    )
    printed = run_python(code, tmp_path, tmp_path / "installed")
    folder = tmp_path / "installed" / "evopem"
    assert printed.split()[-2:] == [str(folder / "templates"), str(folder / "__init__.py")]
    assert "</html>" in (tmp_path / "results" / "bench" / "report.html").read_text()
