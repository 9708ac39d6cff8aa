"""How large the package and its documentation may be.

The budget is what a reader can hold.
"""

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "workflow" / "scripts" / "evopem"
FILES = sorted([*PACKAGE.rglob("*.py"), *PACKAGE.rglob("*.pyi")])

# Each of them may take 600 lines of its own.
CAPABILITIES: tuple[str, ...] = (
    "export to C and FMU",
    "best linear approximation",
    "regularised impulse response",
    "limits of a linear model",
    "continuous time",
    "several set-ups",
    "frequency responses as data",
    "MDF and WAV files",
    "verdict for programs",
    "functional-series models",
    "merged fleets and interactive figures",
    "damage index",
    "pooled models",
    "dependence on amplitude",
    "figures and reports of estimates",
    "search of long recordings",
)

BUDGET = {
    "lines": 40_000 + 600 * len(CAPABILITIES),
    "files": 250,
    "files above 400 lines": 0,
    "folders above 20 files": 0,
    "lines with dict[str, Any]": 29,
    "words of guides": 20_000,
    "words beside evidence": 6_000,
}


def words(files):
    return sum(len(file.read_text(encoding="utf-8").split()) for file in files)


def words_beside_tables(files):
    lines = (line for file in files for line in file.read_text(encoding="utf-8").splitlines())
    return sum(len(line.split()) for line in lines if not line.startswith("|"))


def lines(file):
    return file.read_text(encoding="utf-8").count("\n")


def untyped(file):
    """Lines with a mapping of anything, which stands at the border alone: YAML, templates."""
    return sum("[str, Any]" in line for line in file.read_text(encoding="utf-8").splitlines())


def counted():
    guides = [*ROOT.glob("docs/*.md"), ROOT / "README.md"]
    folders = {file.parent for file in FILES}
    return {
        "lines": sum(map(lines, FILES)),
        "files": len(FILES),
        "files above 400 lines": sum(lines(file) > 400 for file in FILES),
        "folders above 20 files": sum(len(list(each.glob("*.py"))) > 20 for each in folders),
        "lines with dict[str, Any]": sum(map(untyped, FILES)),
        "words of guides": words(file for file in guides if file.name != "design_notes.md"),
        "words beside evidence": words_beside_tables(ROOT.glob("docs/evidence/*.md")),
    }


@pytest.mark.parametrize("count", BUDGET)
def test_a_count_is_within_the_budget(count):
    found = counted()[count]
    assert found <= BUDGET[count]


EMPTY_NAMES = {"another", "each", "found", "growth", "one", "other", "own", "told"}
"""They would fit anything: a name says what it holds."""


def test_no_name_fits_anything():
    names = {
        f"{file.relative_to(PACKAGE)}, line {getattr(node, 'lineno', 1)}: {name}"
        for file in FILES
        for node in ast.walk(ast.parse(file.read_text(encoding="utf-8")))
        for name in (getattr(node, part, None) for part in ("id", "arg", "attr", "name"))
        if isinstance(name, str) and name in EMPTY_NAMES
    }
    assert sorted(names) == []
