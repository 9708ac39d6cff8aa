"""Public functions have examples, which `make test` runs as doctests."""

import inspect

import pytest

import evopem
from evopem.automatic import identify
from evopem.files import json_form
from evopem.models import polynomial, structures
from evopem.synthesis import armax, flexible_arm, synthesize

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
    identify.identify,
    structures.Orders,
    structures.orders_of,
    polynomial.PolynomialModel,
    *(getattr(polynomial.PolynomialModel, name) for name in METHODS),
    json_form.to_json,
    json_form.from_json,
    json_form.load,
    synthesize,
    armax.armax,
    flexible_arm.flexible_arm,
]


@pytest.mark.parametrize("function", FUNCTIONS, ids=lambda each: each.__qualname__)
def test_a_public_function_has_an_example(function):
    sections = inspect.getdoc(function).partition("\nExamples\n--------\n")
    assert ">>> " in sections[2]
    # An example that is skipped proves nothing.
    assert "+SKIP" not in sections[2]
