"""The model as an equation: HTML to read; plain text, MATLAB, Python and JSON to copy."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from markupsafe import Markup

from evopem.report.numbers import number


def _signed(terms: Iterable[tuple[float, Markup]]) -> Markup:
    """Terms joined by their signs; each may wrap to a new line as a whole."""
    parts: list[Markup] = []
    for coefficient, factor in terms:
        sign = "−" if coefficient < 0 else "+"
        size = number(abs(coefficient), 5)
        if not parts:
            lead = "−" if coefficient < 0 else ""
            parts.append(Markup('<span class="term">{}{} {}</span>').format(lead, size, factor))
        else:
            parts.append(Markup('<span class="term">{} {} {}</span>').format(sign, size, factor))
    return Markup(" ").join(parts) if parts else Markup("0")


def _power(lag: int) -> Markup:
    return Markup("") if lag == 0 else Markup("<i>q</i><sup>−{}</sup>").format(lag)


def _at(symbol: str, lag: int) -> Markup:
    delayed = f"t − {lag}" if lag else "t"
    shown = delayed.replace("t", "<i>t</i>")
    return Markup(f"<i>{symbol}</i>({shown})")


def polynomials(model: Mapping[str, Any]) -> list[tuple[str, Markup]]:
    """A, B and C in the backshift operator, each with its letter."""
    nk = int(model["orders"]["nk"])
    rows = []
    for letter, first in (("a", 0), ("b", nk), ("c", 0)):
        coefficients = model[letter]
        terms = [(float(x), _power(first + lag)) for lag, x in enumerate(coefficients)]
        if letter != "b":
            rest = _signed_rest(terms[1:])
            rows.append((letter.upper(), Markup('<span class="term">1</span> ') + rest))
        else:
            rows.append((letter.upper(), _signed(terms)))
    return rows


def _signed_rest(terms: Sequence[tuple[float, Markup]]) -> Markup:
    return Markup(" ").join(
        Markup('<span class="term">{} {} {}</span>').format(
            "−" if coefficient < 0 else "+", number(abs(coefficient), 5), factor
        )
        for coefficient, factor in terms
    )


def difference_equation(model: Mapping[str, Any]) -> Markup:
    """``y(t) = −a1 y(t−1) … + b0 u(t−nk) … + e(t) + c1 e(t−1) …``."""
    nk = int(model["orders"]["nk"])
    terms = [(-float(x), _at("y", lag)) for lag, x in enumerate(model["a"]) if lag]
    terms += [(float(x), _at("u", nk + lag)) for lag, x in enumerate(model["b"])]
    noise = [(float(x), _at("e", lag)) for lag, x in enumerate(model["c"]) if lag]
    return (
        _signed(terms)
        + Markup(' <span class="term">+ {}</span> ').format(_at("e", 0))
        + _signed_rest(noise)
    )


def text(model: Mapping[str, Any]) -> str:
    """The equation and its polynomials in plain characters, ten significant digits."""
    nk = int(model["orders"]["nk"])
    lines = ["A(q) y(t) = B(q) u(t) + C(q) e(t)"]
    for letter, first in (("a", 0), ("b", nk), ("c", 0)):
        terms: list[str] = []
        for lag, coefficient in enumerate(model[letter], start=first):
            size = f"{abs(coefficient):.10g}" + (f" q^-{lag}" if lag else "")
            if not terms:
                terms.append(f"-{size}" if coefficient < 0 else size)
            else:
                terms.append(f"{'-' if coefficient < 0 else '+'} {size}")
        lines.append(f"{letter.upper()}(q) = {' '.join(terms) or '0'}")
    lines.append(f"variance of e = {model['noise_variance']:.10g}")
    lines.append(f"sampling rate = {model['sampling_rate']:.10g} Hz")
    return "\n".join(lines)


def as_json(model: Mapping[str, Any]) -> str:
    """Orders, coefficients, noise variance and sampling rate as a JSON object."""
    keys = ("orders", "a", "b", "c", "noise_variance", "sampling_rate")
    entries = [f"  {json.dumps(key)}: {json.dumps(model[key])}" for key in keys]
    return "{\n" + ",\n".join(entries) + "\n}"


def matlab(model: Mapping[str, Any]) -> str:
    """MATLAB statement that makes the model an ``idpoly``."""
    leading = [0.0] * int(model["orders"]["nk"])
    a, b, c = (
        " ".join(f"{x:.17g}" for x in coefficients)
        for coefficients in (model["a"], [*leading, *model["b"]], model["c"])
    )
    return (
        f"model = idpoly([{a}], ...\n    [{b}], ...\n    [{c}], ...\n"
        f"    1, 1, {model['noise_variance']:.17g}, {1 / model['sampling_rate']:.17g});"
    )


def python(model: Mapping[str, Any]) -> str:
    """Python statements that make the transfer function G with python-control."""
    leading = [0.0] * int(model["orders"]["nk"])
    numerator = [*leading, *model["b"]]
    length = max(len(numerator), len(model["a"]))
    b, a = (
        ", ".join(f"{x:.17g}" for x in [*coefficients, *[0.0] * (length - len(coefficients))])
        for coefficients in (numerator, model["a"])
    )
    return (
        "import control\n\n"
        f"G = control.tf(\n    [{b}],\n    [{a}],\n    {1 / model['sampling_rate']:.17g},\n)"
    )


def coefficient_table(model: Mapping[str, Any]) -> list[tuple[str, int, float, float | None]]:
    """Every estimated coefficient: letter, lag, value, standard error."""
    errors = list(model.get("parameter_standard_errors") or [])
    nk = int(model["orders"]["nk"])
    named = [("a", lag, float(x)) for lag, x in enumerate(model["a"]) if lag]
    named += [("b", nk + lag, float(x)) for lag, x in enumerate(model["b"])]
    named += [("c", lag, float(x)) for lag, x in enumerate(model["c"]) if lag]
    if len(errors) != len(named):
        errors = [None] * len(named)
    return [(*name, error) for name, error in zip(named, errors, strict=True)]
