"""A polynomial model as an equation: HTML to read; plain text, MATLAB, Python and JSON to copy."""

import json
import re
from dataclasses import asdict
from itertools import repeat
from typing import Any

import numpy as np
from markupsafe import Markup

from evopem.config.structures import STRUCTURES
from evopem.models.polynomial import PolynomialModel
from evopem.report.numbers import enumeration

Term = tuple[str, float, int]  # sign, size and lag


def equation(model: PolynomialModel) -> Markup:
    """The structure as an equation, such as ``A(q) y(t) = B(q) u(t) + C(q) e(t)``."""
    return Markup(
        re.sub(
            r"([A-Za-z])(\d*)\(([qt])\)",
            lambda values: f"<i>{values[1]}</i>{_below(values[2])}(<i>{values[3]}</i>)",
            _plain_equation(model),
        )
    )


def symbol(name: str) -> Markup:
    """The symbol of a polynomial or an order, such as B2 or nb, with its index below the line."""
    return Markup(f"<i>{name[0]}</i>{_below(name[1:])}")


def _below(index: str) -> str:
    return f"<sub>{index}</sub>" if index else ""


def _plain_equation(model: PolynomialModel) -> str:
    names = STRUCTURES[model.orders.structure]

    def ratio(above: str, below: str) -> str:
        top = f"{above}(q)" if f"n{above[0].lower()}" in names else ""
        if f"n{below[0].lower()}" not in names:
            return f"{top} " if top else ""
        return f"{top or '1'}/{below}(q) "

    left = ("A(q) " if "na" in names else "") + "y(t)"
    terms = [f"{ratio(f'B{i}', f'F{i}')}u{i}(t)" for i in _indices(model)]
    terms.append(f"{ratio('C', 'D')}e(t)")
    if model.level:
        terms.append("level")
    return f"{left} = {' + '.join(terms)}"


def _indices(model: PolynomialModel) -> list[str]:
    """Indices of the inputs: none of a single one, else numbers from 1."""
    return [""] if model.inputs == 1 else [str(place + 1) for place in range(model.inputs)]


def _polynomials(model: PolynomialModel) -> list[tuple[str, list[float], int]]:
    """Name, coefficients and first lag of each polynomial of the structure."""
    indices = _indices(model)
    every: list[tuple[str, Any, int]] = [("A", model.A, 0)]
    every += [(f"B{i}", b, nk) for i, b, nk in zip(indices, model.B, model.nk, strict=True)]
    every += [("C", model.C, 0), ("D", model.D, 0)]
    every += [(f"F{i}", f, 0) for i, f in zip(indices, model.F, strict=True)]
    names = STRUCTURES[model.orders.structure]
    return [
        (name, coefficients.tolist(), first)
        for name, coefficients, first in every
        if f"n{name[0].lower()}" in names
    ]


def polynomials(model: PolynomialModel) -> list[tuple[str, list[Term]]]:
    """The polynomials of the structure in the backshift operator, each with its name."""

    def term(place: int, value: float, first: int) -> Term:
        return "-" if value < 0 else "+" if place else "", abs(value), first + place

    return [
        (name, [term(place, value, first) for place, value in enumerate(values)])
        for name, values, first in _polynomials(model)
    ]


def orders_note(model: PolynomialModel) -> Markup:
    """What the orders are, by their symbols."""
    degrees, counts = [], []
    for name, values, first in _polynomials(model):
        order = symbol(f"n{name.lower()}")
        if name[0] != "B":
            degrees.append(f"{order} = {len(values) - 1}")
            continue
        counts.append(
            f"{order} = {len(values)} is the <em>number</em> of {symbol(name)} coefficients,"
            f" the first at lag {symbol(f'nk{name[1:]}')} = {first}"
        )
    verb = "are degrees" if len(degrees) > 1 else "is a degree"
    parts = [*([f"{enumeration(degrees)} {verb}"] if degrees else []), *counts]
    return Markup("; ".join(parts) + ".")


def text(model: PolynomialModel) -> str:
    """The equation and its polynomials in plain characters, ten significant digits."""
    lines = [_plain_equation(model)]
    for name, terms in polynomials(model):
        shown = [
            f"{sign}{' ' if place else ''}{size:.10g}{f' q^-{lag}' if lag else ''}"
            for place, (sign, size, lag) in enumerate(terms)
        ]
        lines.append(f"{name}(q) = {' '.join(shown) or '0'}")
    if model.level:
        lines.append(f"level = {model.level:.10g}")
    lines.append(f"variance of e = {model.noise_variance:.10g}")
    lines.append(f"sampling rate = {model.sampling_rate:.10g} Hz")
    return "\n".join(lines)


def as_json(model: PolynomialModel) -> str:
    """Orders, coefficients, noise variance and sampling rate as a JSON object."""
    entries = {
        "orders": asdict(model.orders),
        **{name.lower(): coefficients for name, coefficients, _ in _polynomials(model)},
        **({"level": model.level} if model.level else {}),
        "noise_variance": model.noise_variance,
        "sampling_rate": model.sampling_rate,
    }
    lines = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in entries.items()]
    return "{\n" + ",\n".join(lines) + "\n}"


def matlab(model: PolynomialModel) -> str:
    """MATLAB statement that makes the model an ``idpoly``."""
    given = model.matlab_arguments()
    arguments = [_matlab(given[name]) for name in ("A", "B", "C", "D", "F", "NoiseVariance", "Ts")]
    listed = ", ...\n    ".join(arguments)
    statement = f"model = idpoly({listed});"
    if model.level:
        statement += (
            "\n% idpoly has no constant: subtract this level of the output before it is used."
            f"\nlevel = {model.output_level:.17g};"
        )
    return statement


def _matlab(value: Any) -> str:
    """A number, a row or a cell array of rows."""
    if isinstance(value, np.ndarray) and value.dtype == object:
        return f"{{{', '.join(map(_matlab, value.ravel()))}}}"
    values = np.ravel(value)
    listed = _listed(values, " ")
    return listed[1:-1] if values.size == 1 else listed


def python(model: PolynomialModel) -> str:
    """Python statements that make G with python-control, or H of a model without input."""
    name = "G" if model.has_input else "H"
    above, below = zip(*model.transfer_functions, strict=True)
    parts = [",\n      ".join(map(_listed, part)) for part in (above, below)]
    if len(above) > 1:
        parts = [f"[[{part}]]" for part in parts]
    numerator, denominator = parts
    return (
        "import control\n\n"
        f"{name} = control.tf(\n    {numerator},\n    {denominator},\n"
        f"    {1 / model.sampling_rate:.17g},\n)"
    )


def _listed(coefficients: np.ndarray, gap: str = ", ") -> str:
    return f"[{gap.join(f'{value:.17g}' for value in coefficients)}]"


def coefficient_table(model: PolynomialModel) -> list[tuple[Markup, int, float, float | None]]:
    """Every estimated coefficient: polynomial, lag, value, standard error (None where unknown)."""
    named = [
        (symbol(name), lag, float(value))
        for name, coefficients, first in _polynomials(model)
        for lag, value in enumerate(coefficients, start=first)
        if lag > 0 or name[0] == "B"
    ]
    known = model.parameter_standard_errors()
    errors = repeat(None, len(named)) if known is None else map(float, known)
    return [(*term, error) for term, error in zip(named, errors, strict=True)]
