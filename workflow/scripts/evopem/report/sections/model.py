"""The model: its equation and coefficients, its constraints, and what the transforms do to it."""

from __future__ import annotations

from typing import Any

from evopem.figures.view import PolynomialView
from evopem.report import equations
from evopem.report.fit_table import (
    constraint_rows,
    fit_sentences,
    input_constraint_rows,
    input_fit_sentences,
)
from evopem.report.section import Material, Section
from evopem.report.sentences.about_recording import transform_effects


def _content(material: Material) -> dict[str, Any]:
    view = material.view
    if not isinstance(view, PolynomialView):
        fit = view.results.model.fit
        return {
            "equation": None,
            "constraints": input_constraint_rows(fit),
            "fit_sentences": input_fit_sentences(fit),
        }
    record = view.results.model
    model = record.model
    return {
        "equation": equations.equation(model),
        "orders_note": equations.orders_note(model),
        "polynomials": equations.polynomials(model),
        "difference_equation": equations.difference_equation(model),
        "coefficients": equations.coefficient_table(model),
        "copies": [
            ("text", "Plain text", equations.text(model)),
            ("matlab", "MATLAB", equations.matlab(model)),
            ("python", "Python", equations.python(model)),
            ("json", "JSON", equations.as_json(model)),
        ],
        "constraints": constraint_rows(record.fit),
        "fit_sentences": fit_sentences(record.fit),
        "output_transformed": record.transforms.changes_output,
        "effects": transform_effects(record.transforms),
    }


SECTION = Section("model", lambda _: "Model", _content)
