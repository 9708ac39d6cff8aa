"""The wheel: what is in it, and the README's example in an environment that has nothing else."""

import json
import os
import re
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

import evopem

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "workflow" / "scripts" / "evopem"
TEMPLATES = ROOT / "workflow" / "templates"
SCHEMAS = ROOT / "workflow" / "schemas"
COMPILING = "evopem: compiling the numerical kernels (20 to 40 s, once after an installation)\n"

# The example's `input` and `output`: a record of the model whose orders the example gives.
RECORD = """
from evopem.synthesis.armax import armax
recording, _ = armax(seed=3, samples=2000)
input, output = recording.input, recording.output
"""
RESULTS = """
import json, sys
import numpy as np
response = model.frequency_response([1.0, 2.0, 5.0])[:, 0, 0]
scipy_model = model.to_scipy()
z = np.exp(2j * np.pi * np.array([1.0, 2.0, 5.0]) / model.sampling_rate)
from_scipy = np.polyval(scipy_model.num, z) / np.polyval(scipy_model.den, z)
extras = {"pandas", "matplotlib", "jinja2", "snakemake", "h5py"}
print(json.dumps({
    "frequencies": [mode.frequency_hz for mode in found.model.modes()],
    "response_error": float(np.max(np.abs(from_scipy / response - 1.0))),
    "imported": sorted(extras & set(sys.modules)),
}))
"""


def readme_example():
    """The lines of the README's last Python block, which needs no extra."""
    *_, block = re.findall(r"```python\n(.*?)```", (ROOT / "README.md").read_text(), re.DOTALL)
    return block.splitlines(keepends=True)


def pip(python, *arguments):
    """Run pip; a test that needs a package index is skipped where none answers."""
    run = subprocess.run(
        [python, "-m", "pip", "--disable-pip-version-check", *arguments],
        capture_output=True,
        text=True,
        check=False,
    )
    if "No matching distribution found" in run.stderr and "CI" not in os.environ:
        pytest.skip("no package index answers")
    assert run.returncode == 0, run.stderr
    return run.stdout


def run_python(python, code, folder):
    """Standard output and standard error of a script."""
    # Neither this checkout nor its compiled code.
    hidden = {"PYTHONPATH", "NUMBA_CACHE_DIR", "PYTHONDONTWRITEBYTECODE"}
    environment = {key: value for key, value in os.environ.items() if key not in hidden}
    run = subprocess.run(
        [python, "-c", code],
        cwd=folder,
        env=environment,
        capture_output=True,
        text=True,
        check=False,
    )
    assert run.returncode == 0, run.stderr
    return run.stdout, run.stderr


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    source = folder / "source"
    source.mkdir()
    for name in ("pyproject.toml", "setup.py", "README.md", "LICENSE"):
        shutil.copy(ROOT / name, source)
    ignored = shutil.ignore_patterns("__pycache__", "*.egg-info")
    shutil.copytree(ROOT / "workflow", source / "workflow", ignore=ignored)
    pip(sys.executable, "wheel", "--no-deps", "--wheel-dir", str(folder), str(source))
    (built,) = folder.glob("*.whl")
    return built


@pytest.fixture(scope="module")
def python(wheel, tmp_path_factory):
    """The interpreter of a clean environment with the wheel and what it depends on."""
    environment = tmp_path_factory.mktemp("environment") / "venv"
    subprocess.run([sys.executable, "-m", "venv", environment], check=True)
    interpreter = environment / "bin" / "python"
    pip(interpreter, "install", str(wheel))
    return interpreter


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
    assert packed == modules | templates | schemas | {"evopem/py.typed"}


def test_the_example_of_the_readme_runs_without_any_extra(python, identified, tmp_path):
    (tmp_path / "results" / "arm").mkdir(parents=True)
    shutil.copy(identified.files.model, tmp_path / "results" / "arm" / "model.json")
    lines = readme_example()
    without_control = "".join(line for line in lines if "to_control" not in line)
    assert len(without_control.splitlines()) == len(lines) - 1

    printed, messages = run_python(python, RECORD + without_control + RESULTS, tmp_path)
    results = json.loads(printed)
    assert results["frequencies"] == pytest.approx([5.36, 16.65, 37.0], rel=0.02)
    assert results["response_error"] < 1e-9
    assert results["imported"] == []
    # The first fit says once that it compiles, and nothing warns.
    assert messages == COMPILING

    # The compiled code is kept: the second run prints the same, in silence.
    again, messages = run_python(python, RECORD + without_control + RESULTS, tmp_path)
    assert (json.loads(again), messages) == (results, "")


def test_the_command_names_the_extra_that_it_needs(python, tmp_path):
    command = python.parent / "evopem"
    version = subprocess.run([command, "--version"], capture_output=True, text=True, check=True)
    assert version.stdout == f"evopem {evopem.__version__}\n"
    (tmp_path / "data.csv").write_text("u,y\n" + "1,2\n2,1\n" * 100)
    arguments = ("data.csv", "--input", "u", "--output", "y", "--rate", "100")
    run = subprocess.run(
        [command, *arguments], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert (run.returncode, run.stdout) == (1, "")
    assert run.stderr.endswith('are not installed; run pip install "evopem[report]".\n')
    # Looking into recordings needs no extra.
    written = subprocess.run([command, "init", "."], cwd=tmp_path, capture_output=True, check=True)
    assert b"Wrote config.yaml" in written.stdout


def test_the_extra_control_completes_the_example(python, wheel, identified, tmp_path):
    (tmp_path / "results" / "arm").mkdir(parents=True)
    shutil.copy(identified.files.model, tmp_path / "results" / "arm" / "model.json")
    pip(python, "install", f"{wheel}[control]")
    code = "import evopem, control\n" + "".join(readme_example()[-5:])
    code += "\nprint(type(model.to_control()) is control.TransferFunction)"
    assert run_python(python, code, tmp_path) == ("True\n", "")


def test_the_wheel_writes_reports(wheel, identified, tmp_path):
    """The templates are found beside the installed package."""
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "installed")
    shutil.copytree(identified.files.folder, tmp_path / "results" / "bench")
    code = (
        "import sys; sys.path.insert(0, 'installed')\n"
        "import evopem\n"
        "from evopem.pipeline.identification import run_stage\n"
        "from evopem.report.templates import template_folder\n"
        "for name in ('summarize', 'draw_figures', 'write_report'):\n"
        "    run_stage(name, 'results/bench', log=None)\n"
        "print(template_folder(), evopem.__file__)\n"
    )
    printed, _ = run_python(sys.executable, code, tmp_path)
    folder = tmp_path / "installed" / "evopem"
    assert printed.split()[-2:] == [str(folder / "templates"), str(folder / "__init__.py")]
    assert "<svg" in (tmp_path / "results" / "bench" / "report.html").read_text()
