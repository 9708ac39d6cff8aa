"""Imports between the parts of the package run one way."""

import ast
import subprocess
import sys
from graphlib import TopologicalSorter
from pathlib import Path

import pytest

SCRIPTS = Path(__file__).parents[2] / "workflow" / "scripts"
PACKAGE = SCRIPTS / "evopem"
# Each part may import those before it.
PARTS = (
    *(
        "arrays",
        "errors",
        "version",
        "compilation",
        "files",
        "config",
        "signals",
        "models",
        "synthesis",
        "estimation",
        "exports",
    ),
    *(
        "validation",
        "automatic",
        "results",
        "figures",
        "report",
        "pipeline",
        "notebook",
        "terminal",
    ),
)


def imported_names(file):
    """The names that a module imports anywhere, its functions and type checks included."""
    for node in ast.walk(ast.parse(file.read_text(encoding="utf-8"))):
        names = []
        if isinstance(node, ast.ImportFrom):
            names = [f"{node.module}.{alias.name}" for alias in node.names]
        elif isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        yield from (name for name in names if name.startswith("evopem."))


def test_every_part_of_the_package_has_its_place():
    modules = [path for path in PACKAGE.iterdir() if path.is_dir() or path.suffix == ".py"]
    found = {path.stem for path in modules if not path.name.startswith("_")}
    assert found == set(PARTS)


@pytest.mark.parametrize("part", PARTS)
def test_a_part_imports_only_those_before_it(part):
    path = PACKAGE / part
    files = list(path.rglob("*.py")) if path.is_dir() else [PACKAGE / f"{part}.py"]
    allowed = set(PARTS[: PARTS.index(part) + 1]) | {"__version__"}
    upward = {
        (file.relative_to(PACKAGE).as_posix(), imported)
        for file in files
        for imported in {name.split(".")[1] for name in imported_names(file)}
        if imported not in allowed
    }
    assert upward == set()


def test_no_module_is_in_a_circle_of_imports():
    names = {
        ".".join(file.relative_to(SCRIPTS).with_suffix("").parts).removesuffix(".__init__"): file
        for file in PACKAGE.rglob("*.py")
    }
    needed = {
        module: {
            source
            for name in imported_names(file)
            for source in [name if name in names else name.rpartition(".")[0]]
        }
        for module, file in names.items()
    }
    assert len(list(TopologicalSorter(needed).static_order())) >= len(names)


def printed_by(*lines):
    """What a process of its own prints, with the package of this checkout."""
    code = "\n".join(["import sys", f"sys.path.insert(0, {str(SCRIPTS)!r})", *lines])
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return run.stdout.strip()


def test_what_the_snakefile_imports_needs_neither_numpy_nor_pandas():
    rules = (SCRIPTS.parent / "rules" / "common.smk").read_text(encoding="utf-8")
    imported = [line for line in rules.splitlines() if line.startswith("from evopem.")]
    assert len(imported) > 5
    assert printed_by(*imported, "print({'numpy', 'pandas'} & set(sys.modules))") == "set()"


def test_a_job_loads_the_slow_parts_of_scipy_only_where_it_needs_them():
    """They take as long to load as all else together, for each job of a run."""
    modules = sorted((PACKAGE / "pipeline").glob("*.py"))
    lines = [f"import evopem.pipeline.{path.stem}" for path in modules if path.stem[0] != "_"]
    slow = "{'scipy.signal', 'scipy.stats', 'scipy.optimize', 'matplotlib.pyplot'}"
    assert len(lines) > 5
    assert printed_by(*lines, f"print({slow} & set(sys.modules))") == "set()"


def test_a_polynomial_estimate_loads_nothing_of_state_space():
    """Nor SciPy's special functions, or its results: every process would wait for them."""
    lines = [
        "import numpy, evopem",
        "u, y = numpy.random.default_rng(1).standard_normal((2, 300))",
        "settings = evopem.SearchSettings(objective='quadratic', evaluations=50)",
        "evopem.estimate(u, y, (2, 2, 2, 1), settings=settings)",
    ]
    slow = "{'scipy.special', 'scipy.signal', 'evopem.estimation.state_space', 'pandas'}"
    assert printed_by(*lines, f"print({slow} & set(sys.modules))") == "set()"
