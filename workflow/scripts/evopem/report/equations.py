"""The model as an equation: HTML to read; plain text, MATLAB, Python and JSON to copy."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from itertools import repeat

from markupsafe import Markup

from evopem.models.polynomial import PolynomialModel
from evopem.report.numbers import number


def polynomials(model: PolynomialModel) -> list[tuple[str, Markup]]:
    """A, B and C in the backshift operator, each with its letter."""
    rows = []
    for letter, coefficients, first in _polynomials(model):
        terms = [(value, _power(lag)) for lag, value in enumerate(coefficients, start=first)]
        if letter == "B":
            rows.append((letter, _signed(terms)))
        else:
            rest = _signed_rest(terms[1:])
            rows.append((letter, Markup('<span class="term">1</span> ') + rest))
    return rows


def difference_equation(model: PolynomialModel) -> Markup:
    """``y(t) = −a1 y(t−1) … + b0 u(t−nk) … + e(t) + c1 e(t−1) …``."""
    terms = [(-value, _at("y", lag)) for lag, value in enumerate(model.a) if lag]
    terms += [(value, _at("u", lag)) for lag, value in enumerate(model.b, start=model.nk)]
    noise = [(value, _at("e", lag)) for lag, value in enumerate(model.c) if lag]
    return (
        _signed(terms)
        + Markup(' <span class="term">+ {}</span> ').format(_at("e", 0))
        + _signed_rest(noise)
    )


def text(model: PolynomialModel) -> str:
    """The equation and its polynomials in plain characters, ten significant digits."""
    lines = ["A(q) y(t) = B(q) u(t) + C(q) e(t)"]
    for letter, coefficients, first in _polynomials(model):
        terms: list[str] = []
        for lag, coefficient in enumerate(coefficients, start=first):
            size = f"{abs(coefficient):.10g}" + (f" q^-{lag}" if lag else "")
            if not terms:
                terms.append(f"-{size}" if coefficient < 0 else size)
            else:
                terms.append(f"{'-' if coefficient < 0 else '+'} {size}")
        lines.append(f"{letter}(q) = {' '.join(terms) or '0'}")
    lines.append(f"variance of e = {model.noise_variance:.10g}")
    lines.append(f"sampling rate = {model.sampling_rate:.10g} Hz")
    return "\n".join(lines)


def as_json(model: PolynomialModel) -> str:
    """PolynomialOrders, coefficients, noise variance and sampling rate as a JSON object."""
    entries = {
        "orders": asdict(model.orders),
        "a": model.a.tolist(),
        "b": model.b.tolist(),
        "c": model.c.tolist(),
        "noise_variance": model.noise_variance,
        "sampling_rate": model.sampling_rate,
    }
    lines = [f"  {json.dumps(key)}: {json.dumps(value)}" for key, value in entries.items()]
    return "{\n" + ",\n".join(lines) + "\n}"


def matlab(model: PolynomialModel) -> str:
    """MATLAB statement that makes the model an ``idpoly``."""
    a, b, c = (
        " ".join(f"{value:.17g}" for value in coefficients)
        for coefficients in (model.a, model.delayed_b, model.c)
    )
    return (
        f"model = idpoly([{a}], ...\n    [{b}], ...\n    [{c}], ...\n"
        f"    1, 1, {model.noise_variance:.17g}, {1 / model.sampling_rate:.17g});"
    )


def python(model: PolynomialModel) -> str:
    """Python statements that make the transfer function G with python-control."""
    length = max(len(model.delayed_b), len(model.a))
    b, a = (
        ", ".join(
            f"{value:.17g}" for value in [*coefficients, *repeat(0.0, length - len(coefficients))]
        )
        for coefficients in (model.delayed_b, model.a)
    )
    return (
        "import control\n\n"
        f"G = control.tf(\n    [{b}],\n    [{a}],\n    {1 / model.sampling_rate:.17g},\n)"
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
    """Letter, coefficients and first lag of each polynomial."""
    return (
        ("A", model.a.tolist(), 0),
        ("B", model.b.tolist(), model.nk),
        ("C", model.c.tolist(), 0),
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
