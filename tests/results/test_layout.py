"""The layout of the results: each file once, and nowhere else."""

import ast
from collections import Counter
from pathlib import Path, PurePosixPath

import pytest

from evopem.config.defaults import complete
from evopem.config.structures import PHASES
from evopem.errors import InputError
from evopem.results.layout import FIGURES, OVERVIEW, DatasetFiles

ROOT = Path(__file__).parents[2]
FILES = DatasetFiles.of_dataset("arm")


def listed(files):
    """Every path that a layout names by a property."""
    properties = [
        name
        for name, each in vars(DatasetFiles).items()
        if isinstance(each, property) or type(each).__name__ == "_File"
    ]
    for name in properties:
        value = getattr(files, name)
        if name not in ("name", "batch_results"):  # these are made of the others
            yield from [value] if isinstance(value, str) else value


def test_each_file_is_named_once():
    paths = Counter(
        [
            *listed(FILES),
            *(FILES.part(phase, part) for phase in PHASES for part in (1, 2)),
            *(FILES.log(phase) for phase in PHASES),
            *(FILES.benchmark(phase) for phase in PHASES),
        ]
    )
    assert [path for path, count in paths.items() if count > 1] == []
    # On a file system that does not distinguish letter case neither.
    assert len({path.lower() for path in paths}) == len(paths) > 40


def test_all_files_lie_in_the_folder_of_the_data_set():
    assert all(path.startswith("results/arm/") for path in listed(FILES))
    assert FILES.name == "arm"
    assert set(FILES.batch_results) <= set(listed(FILES))
    assert len(FILES.figures) == len(FIGURES)


@pytest.mark.parametrize(
    "log", ["results/arm/logs/model.log", "/x/results/arm/logs/phases/nc/part-1.log"]
)
def test_a_log_file_tells_the_data_set(log):
    files = DatasetFiles.of_log(log)
    assert files.name == "arm"
    assert log.startswith(files.folder)
    assert files.model == f"{files.folder}/model.json"
    assert DatasetFiles.of_log(files.log("phases/nc")) == files


def test_a_wildcard_stands_for_the_name():
    files = DatasetFiles.of_dataset("{dataset}")
    assert files.model.format(dataset="arm") == FILES.model


@pytest.mark.parametrize("path", [*OVERVIEW, "results/logs", "results/benchmarks"])
def test_what_lies_beside_the_data_sets_is_no_name_for_one(path):
    name = PurePosixPath(path).name
    with pytest.raises(InputError, match=f"{name} is the name of something else"):
        complete({"datasets": {name: {"synthesis": "armax"}}})


def strings(file):
    """The texts in a module, without its docstrings."""
    tree = ast.parse(file.read_text(encoding="utf-8"))
    docstrings = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
        if is_text and id(node) not in docstrings:
            yield node.value


def test_no_other_module_spells_a_path():
    names = {PurePosixPath(path).name for path in listed(FILES)}
    spelled = {
        (file.relative_to(ROOT).as_posix(), text)
        for file in (ROOT / "workflow" / "scripts").rglob("*.py")
        if file.name != "layout.py"
        for text in strings(file)
        if "/" in text and PurePosixPath(text).name in names
    }
    assert spelled == set()


def test_no_rule_spells_a_path_of_a_data_set():
    for file in (ROOT / "workflow" / "rules").glob("*.smk"):
        assert "{dataset}/" not in file.read_text(encoding="utf-8"), file
