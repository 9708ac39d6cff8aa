"""The model as an equation: HTML to read; plain text, MATLAB, Python and JSON to copy."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import repeat

import numpy as np
from markupsafe import Markup
from numpy.typing import NDArray

from evopem.config.structures import STRUCTURES
from evopem.models.polynomial import PolynomialModel
from evopem.report.numbers import enumeration, number

Array = NDArray[np.float64]


def equation(model: PolynomialModel) -> Markup:
    """The structure as an equation, such as ``A(q) y(t) = B(q) u(t) + C(q) e(t)``."""
    return Markup(re.sub(r"([A-Za-z])\(([qt])\)", r"<i>\1</i>(<i>\2</i>)", _plain_equation(model)))


def _plain_equation(model: PolynomialModel) -> str:
    names = STRUCTURES[model.orders.structure]

    def ratio(above: str, below: str) -> str:
        top = f"{above}(q)" if f"n{above.lower()}" in names else ""
        if f"n{below.lower()}" not in names:
            return f"{top} " if top else ""
        return f"{top or '1'}/{below}(q) "

    left = ("A(q) " if "na" in names else "") + "y(t)"
    terms = [f"{ratio('B', 'F')}u(t)"] if "nb" in names else []
    terms.append(f"{ratio('C', 'D')}e(t)")
    if model.level:
        terms.append("level")
    return f"{left} = {' + '.join(terms)}"


def polynomials(model: PolynomialModel) -> list[tuple[str, Markup]]:
    """The polynomials of the structure in the backshift operator, each with its letter."""
    rows = []
    for letter, coefficients, first in _polynomials(model):
        terms = [(value, _power(lag)) for lag, value in enumerate(coefficients, start=first)]
        if letter == "B":
            rows.append((letter, _signed(terms)))
        else:
            rest = _signed_rest(terms[1:])
            rows.append((letter, Markup('<span class="term">1</span> ') + rest))
    return rows


def orders_note(model: PolynomialModel) -> Markup:
    """What the orders are, by their symbols."""
    o = model.orders
    degrees = [name for name in ("na", "nc", "nd", "nf") if name in STRUCTURES[o.structure]]
    listed = enumeration([f"{_order(name)} = {getattr(o.single, name)}" for name in degrees])
    verb = "are degrees" if len(degrees) > 1 else "is a degree"
    parts = [f"{listed} {verb}"] if degrees else []
    if model.has_input:
        parts.append(
            f"{_order('nb')} = {o.single.nb} is the <em>number</em> of <i>B</i> coefficients,"
            f" the first at lag {_order('nk')} = {o.single.nk}"
        )
    return Markup("; ".join(parts) + ".")


def _order(name: str) -> str:
    return f"<i>n<sub>{name[1]}</sub></i>"


def difference_equation(model: PolynomialModel) -> Markup:
    """``y(t) = −a1 y(t−1) … + b0 u(t−nk) … + e(t) + c1 e(t−1) …``, from its right side on.

    With F or D, the response w of the plant and the noise v have equations of their own.
    """
    own_plant, own_noise = len(model.f) > 1, len(model.d) > 1
    output = [(-value, _at("y", lag)) for lag, value in enumerate(model.a) if lag]
    from_input = [(value, _at("u", lag)) for lag, value in enumerate(model.b, start=model.delay)]
    past_noise = [(value, _at("e", lag)) for lag, value in enumerate(model.c) if lag]
    now = Markup(' <span class="term">+ {}</span> ').format(_at("e", 0))
    shown = _joined([*output, *([] if own_plant else from_input)])
    if own_plant:
        shown += Markup(' <span class="term">+ {}</span> ').format(_at("w", 0))
    shown += Markup(' <span class="term">+ {}</span> ').format(_at("v", 0)) if own_noise else now
    if not own_noise:
        shown += _signed_rest(past_noise)
    if model.level:
        shown += Markup(" ") + _signed_rest([(model.level, Markup(""))])
    if own_plant:
        past = [(-value, _at("w", lag)) for lag, value in enumerate(model.f) if lag]
        shown += Markup("<br>{} = ").format(_at("w", 0)) + _joined([*past, *from_input])
    if own_noise:
        past = [(-value, _at("v", lag)) for lag, value in enumerate(model.d) if lag]
        shown += Markup("<br>{} = ").format(_at("v", 0)) + _joined(past) + now
        shown += _signed_rest(past_noise)
    return shown


def _joined(terms: Sequence[tuple[float, Markup]]) -> Markup:
    return _signed(terms) if terms else Markup("")


def text(model: PolynomialModel) -> str:
    """The equation and its polynomials in plain characters, ten significant digits."""
    lines = [_plain_equation(model)]
    for letter, coefficients, first in _polynomials(model):
        terms: list[str] = []
        for lag, coefficient in enumerate(coefficients, start=first):
            size = f"{abs(coefficient):.10g}" + (f" q^-{lag}" if lag else "")
            if not terms:
                terms.append(f"-{size}" if coefficient < 0 else size)
            else:
                terms.append(f"{'-' if coefficient < 0 else '+'} {size}")
        lines.append(f"{letter}(q) = {' '.join(terms) or '0'}")
    if model.level:
        lines.append(f"level = {model.level:.10g}")
    lines.append(f"variance of e = {model.noise_variance:.10g}")
    lines.append(f"sampling rate = {model.sampling_rate:.10g} Hz")
    return "\n".join(lines)


def as_json(model: PolynomialModel) -> str:
    """Orders, coefficients, noise variance and sampling rate as a JSON object."""
    entries = {
        "orders": asdict(model.orders),
        **{letter.lower(): list(coefficients) for letter, coefficients, _ in _polynomials(model)},
        **({"level": model.level} if model.level else {}),
        "noise_variance": model.noise_variance,
        "sampling_rate": model.sampling_rate,
    }
    lines = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in entries.items()]
    return "{\n" + ",\n".join(lines) + "\n}"


def matlab(model: PolynomialModel) -> str:
    """MATLAB statement that makes the model an ``idpoly``."""
    a, b, c = map(_matlab_vector, (model.a, model.delayed_b, model.c))
    d, f = ("1" if len(each) == 1 else _matlab_vector(each) for each in (model.d, model.f))
    if not model.has_input:
        b = f = "[]"
    statement = (
        f"model = idpoly({a}, ...\n    {b}, ...\n    {c}, ...\n"
        f"    {d}, {f}, {model.noise_variance:.17g}, {1 / model.sampling_rate:.17g});"
    )
    if model.level:
        statement += (
            "\n% idpoly has no constant: subtract this level of the output before it is used."
            f"\nlevel = {model.output_level:.17g};"
        )
    return statement


def _matlab_vector(coefficients: Array) -> str:
    return f"[{' '.join(f'{value:.17g}' for value in coefficients)}]"


def python(model: PolynomialModel) -> str:
    """Python statements that make G with python-control, or H of a model without input."""
    name, above, below = "G", model.delayed_b, model.plant_denominator
    if not model.has_input:
        name, above, below = "H", model.c, model.noise_denominator
    length = max(len(above), len(below))
    numerator, denominator = (
        ", ".join(
            f"{value:.17g}" for value in [*coefficients, *repeat(0.0, length - len(coefficients))]
        )
        for coefficients in (above, below)
    )
    return (
        "import control\n\n"
        f"{name} = control.tf(\n    [{numerator}],\n    [{denominator}],\n"
        f"    {1 / model.sampling_rate:.17g},\n)"
    )


def coefficient_table(model: PolynomialModel) -> list[tuple[str, int, float, float | None]]:
    """Every estimated coefficient: letter, lag, value, standard error (None where unknown)."""
    named = [
        (letter, lag, float(value))
        for letter, coefficients, first in _polynomials(model)
        for lag, value in enumerate(coefficients, start=first)
        if lag > 0 or letter == "B"
    ]
    known = model.parameter_standard_errors()
    errors = repeat(None, len(named)) if known is None else map(float, known)
    return [(*name, error) for name, error in zip(named, errors, strict=True)]


def _polynomials(model: PolynomialModel) -> tuple[tuple[str, Sequence[float], int], ...]:
    """Letter, coefficients and first lag of each polynomial of the structure."""
    names = STRUCTURES[model.orders.structure]
    return tuple(
        (letter.upper(), getattr(model, letter).tolist(), model.delay if letter == "b" else 0)
        for letter in "abcdf"
        if f"n{letter}" in names
    )


def _signed(terms: Iterable[tuple[float, Markup]]) -> Markup:
    """Terms joined by their signs; a line breaks between terms alone."""
    (first, factor), *rest = terms
    lead = "−" if first < 0 else ""
    shown = Markup('<span class="term">{}{} {}</span>').format(lead, number(abs(first), 5), factor)
    return shown + " " + _signed_rest(rest) if rest else shown


def _signed_rest(terms: Iterable[tuple[float, Markup]]) -> Markup:
    return Markup(" ").join(
        Markup('<span class="term">{} {} {}</span>').format(
            "−" if coefficient < 0 else "+", number(abs(coefficient), 5), factor
        )
        for coefficient, factor in terms
    )


def _power(lag: int) -> Markup:
    return Markup("") if lag == 0 else Markup("<i>q</i><sup>−{}</sup>").format(lag)


def _at(symbol: str, lag: int) -> Markup:
    delay = Markup(" − {}").format(lag) if lag else Markup("")
    return Markup("<i>{}</i>(<i>t</i>{})").format(symbol, delay)
