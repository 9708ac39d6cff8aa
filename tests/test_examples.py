"""Public functions have examples, and the examples of the docstrings run."""

import doctest
import inspect
from importlib import import_module
from pathlib import Path

import pytest

import evopem
from evopem.models import orders, polynomial

SCRIPTS = Path(__file__).parents[1] / "workflow" / "scripts"
MODULES = [
    ".".join(file.relative_to(SCRIPTS).with_suffix("").parts).removesuffix(".__init__")
    for file in sorted(SCRIPTS.rglob("*.py"))
    if ">>> " in file.read_text(encoding="utf-8")
]
METHODS = (
    "simulate",
    "predict",
    "residuals",
    "frequency_response",
    "noise_response",
    "modes",
    "to_scipy",
)
FUNCTIONS = [
    evopem.estimate,
    evopem.export_c,
    evopem.export_fmu,
    evopem.load,
    evopem.identify,
    orders.Orders,
    polynomial.PolynomialModel,
]


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda each: each.__qualname__)
def test_a_public_function_has_an_example(function):
    sections = inspect.getdoc(function).partition("\nExamples\n--------\n")
    assert ">>> " in sections[2]
    # An example that is skipped proves nothing.
    assert "+SKIP" not in sections[2]


@pytest.mark.parametrize("method", METHODS)
def test_the_example_of_a_model_shows_its_methods(method):
    assert f"model.{method}(" in inspect.getdoc(polynomial.PolynomialModel)


@pytest.mark.parametrize("name", MODULES)
def test_the_examples_of_a_module_run(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    ran = doctest.testmod(import_module(name), optionflags=flags)
    assert ran.attempted > 0
    assert ran.failed == 0
