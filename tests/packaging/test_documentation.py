"""Every command and every piece of Python and YAML in the documentation runs, or says why not."""

import re
import shlex
import subprocess
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import yaml
from identified import finished_copy

from evopem.config.defaults import complete
from evopem.terminal.command import main

ROOT = Path(__file__).parents[2]
SCRIPTS = ROOT / "workflow" / "scripts"
PAGES = [
    *("README.md", "CONTRIBUTING.md", "config/README.md", "examples/motor_bench/README.md"),
    "benchmarks/fletcher_powell/README.md",
    *(path.relative_to(ROOT).as_posix() for path in sorted((ROOT / "docs").rglob("*.md"))),
]

# What stands before the blocks of a page: variables and files that its text takes for granted.
RECORD = """
import numpy as np
from scipy.signal import lfilter
u, e = np.random.default_rng(1).standard_normal((2, 600))
y = lfilter([0.0, 0.3, 0.2], [1.0, -1.3, 0.55], u) + 0.1 * e
"""
BEFORE = {
    "README.md": RECORD + "import pandas\nframe = pandas.DataFrame({'u': u, 'y': y})[:120]\n",
    "docs/coming_from.md": RECORD,
    "docs/structures.md": RECORD
    + """
inputs = np.random.default_rng(2).standard_normal((400, 2))
output = lfilter([0.0, 1.0, 0.5], [1.0, -1.5, 0.8], inputs[:, 0])
output += lfilter([0.0, 0.0, 0.0, 1.0, 0.4], [1.0, -0.7], inputs[:, 1]) + 0.1 * e[:400]
force, errors = np.random.default_rng(1).standard_normal((2, 400, 2))
acceleration = lfilter([0.0, 1.0], [1.0, -1.5, 0.7], force, axis=0) @ [[1.0, 0.3], [0.2, 1.0]]
acceleration += 0.1 * errors
""",
}
# Fewer orders and samples than a page shows.
SHORTER = {
    "orders=(8, (1, 3))": "orders=(2, (1, 3))",
    'structure="oe")': 'structure="oe", orders={"plant": [2, 2]})',
    'structure="arx", name': 'structure="arx", orders={"plant": [2, 2]}, name',
    '100.0, structure="arx")': '100.0, structure="arx", orders={"plant": [2, 2]})',
    "identify(None, y, 100.0)": 'identify(None, y, 100.0, structure="ss", orders=2)',
    "range(1, 13)": "range(1, 4)",
    "range(2, 17, 2)": "range(2, 7, 2)",
    "(2, 600)": "(2, 200)",
    "arange(600)": "arange(200)",
}
# A small analysis, where a page says that settings.yaml holds one.
SETTINGS = """
defaults:
  recipe: chapter
  split: {discard: 0}
  spectrum: {nfft: 512}
  transforms: {box_cox: none, difference: 0}
  delay: {orders: [4, 4], nk: [1, 1]}
  orders: {plant: [4, 4], nc: [2, 2], nb: [4, 4]}
  search: {mu: 3, lambda: 6, nu: 2, evaluations: 50}
"""
# Blocks by their beginnings. Another test runs them:
ELSEWHERE = {
    "make report": "tests/packaging/user_commands.sh",
    "pip install 'PATH[report]'\nevopem data.csv": "tests/packaging/user_commands.sh",
    "snakemake --snakefile PATH/Snakefile": "tests/packaging/user_commands.sh",
    "pip install PATH": "tests/packaging/user_commands.sh",
    "cd bench\nsnakemake": "tests/workflow/test_tutorial.py",
    "import evopem\n\nsettings = ": "tests/packaging/test_wheel.py",
    'import evopem\n\nmodel = evopem.load("results/motor_bench': "tests/packaging/test_wheel.py",
    "snakemake --workflow-profile PATH/profiles/slurm": "tests/workflow/test_slurm.py",
    "PATH/profiles/slurm/array_job.sh": "tests/workflow/test_slurm.py",
    'configfile: "config/config.yaml"\n\nmodule': "tests/workflow/test_module.py",
    "module identification:": "tests/workflow/test_module.py",
    "pip install -r benchmarks/fletcher_powell": "tests/fletcher_powell/test_comparison_run.py",
    "PYTHONPATH=workflow/scripts python -c": "tests/pipeline/test_identification.py",
    "cd results/DATASET && sha256sum": "tests/files/test_checksums.py",
}
# Nothing runs them:
NOT_RUN = {
    "make quick       # between edits": "it is what runs this test, or a part of it",
}


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    page: str
    line: int
    language: str
    text: str

    @property
    def place(self):
        return f"{self.page}:{self.line}"

    def found_in(self, beginnings):
        return next((each for each in beginnings if self.text.startswith(each)), None)


def blocks(page, *languages):
    text = (ROOT / page).read_text(encoding="utf-8")
    found = re.finditer(r"^```(\w+)[^\n]*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return [
        Block(page, text[: each.start()].count("\n") + 1, each[1], each[2])
        for each in found
        if each[1] in languages
    ]


def left(page):
    """The blocks of a page that no other test runs."""
    return [
        block
        for block in blocks(page, "python", "console", "bash")
        if block.found_in([*ELSEWHERE, *NOT_RUN]) is None
    ]


@pytest.fixture
def folder(tmp_path, undrawn, monkeypatch):
    """A working folder with what the pages take for granted, for reports without drawings."""
    work = tmp_path / "work"
    work.mkdir()
    (work / "settings.yaml").write_text(SETTINGS)
    monkeypatch.setenv("PYTHONPATH", str(SCRIPTS))
    monkeypatch.setenv("MPLBACKEND", "agg")
    monkeypatch.chdir(work)
    return work


def give(folder, page, identified):
    """Lay out the files of a page."""
    bench = ROOT / "examples" / "motor_bench"
    if page == "docs/tutorial.md":
        settings = SETTINGS.rstrip() + "\n  resample: 500\n"
        (folder / "settings.yaml").write_text(settings)
        for file in bench.glob("*.csv"):
            (folder / file.name).symlink_to(file)
    if page in ("docs/terminal.md", "docs/programs.md"):
        u, e = np.random.default_rng(1).standard_normal((2, 1200))
        (folder / "measurements").mkdir()
        table = np.column_stack([u, 0.5 * np.roll(u, 1) + 0.1 * e])
        for file in (folder / "data.csv", folder / "measurements" / "data.csv"):
            np.savetxt(file, table, delimiter=",", header="u,y", comments="")
    if page in ("docs/formats.md", "docs/terminal.md"):
        for name in ("results/a", "results/b", "monday/results/a", "tuesday/results/a"):
            finished_copy(folder / name, identified)


@pytest.mark.parametrize("page", [page for page in PAGES if left(page)])
def test_the_commands_of_a_page_run(page, folder, identified, capsys):
    give(folder, page, identified)
    names = {"__name__": "page"}
    exec(BEFORE.get(page, ""), names)
    for block in left(page):
        if block.language == "python":
            text = block.text
            for written, shorter in SHORTER.items():
                text = text.replace(written, shorter)
            exec(compile(text, block.place, "exec"), names)
            continue
        # The whole recipe is tried in tests/automatic; here it takes the small analysis.
        text = block.text.replace("PATH/", f"{ROOT}/")
        if "evopem data.csv" in text and "--config" not in text:
            text = text.rstrip() + " --config settings.yaml\n"
        for line in text.splitlines():
            if line.startswith("evopem "):  # in this process, which has loaded what it needs
                assert main(shlex.split(line)[1:]) == 0, f"{block.place}: {capsys.readouterr().err}"
                continue
            run = subprocess.run(["bash", "-c", line], capture_output=True, text=True, check=False)
            assert run.returncode == 0, f"{block.place}: {run.stderr}"


@pytest.mark.parametrize("page", PAGES)
def test_the_configurations_of_a_page_are_accepted(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for block in blocks(page, "yaml"):
        content = yaml.safe_load(block.text)
        if not isinstance(content, dict) or "…" in block.text or "datasets" not in content:
            continue
        if isinstance(content["datasets"], dict):
            for pattern in re.findall(r"file: (\S*)\*(\S*?)[,\s}]", block.text):
                file = Path("1".join(pattern))  # a pattern needs a file that it matches
                file.parent.mkdir(parents=True, exist_ok=True)
                file.touch()
            complete(content, block.place)


def test_every_exception_is_still_there():
    everything = [block for page in PAGES for block in blocks(page, "python", "console", "bash")]
    used = {block.found_in([*ELSEWHERE, *NOT_RUN]) for block in everything}
    assert used - {None} == {*ELSEWHERE, *NOT_RUN}
    assert [file for file in ELSEWHERE.values() if not (ROOT / file).is_file()] == []


@pytest.mark.parametrize("page", PAGES)
def test_tables_have_a_blank_line_before_them(page):
    """Without one the site shows their source."""
    text = re.sub(r"^```.*?^```", "", (ROOT / page).read_text("utf-8"), flags=re.M | re.S)
    tables = [part for part in text.split("\n\n") if re.search(r"^\|[ :]*--", part, re.M)]
    assert [part for part in tables if not re.match(r"\s*\|.*\n\|[ :]*--", part)] == []
