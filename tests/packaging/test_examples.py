"""Public functions have examples, which `make test` runs as doctests."""

import inspect

import pytest

import evopem
from evopem.models import orders, polynomial

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
