"""A polynomial model as an equation: HTML to read; plain text, MATLAB, Python and JSON to copy."""

from __future__ import annotations

import json
import re
from collections.abc import Iterable
from dataclasses import asdict
from itertools import repeat
from typing import Any

import numpy as np
from markupsafe import Markup

from evopem.config.structures import STRUCTURES
from evopem.models.polynomial import PolynomialModel
from evopem.report.numbers import enumeration, number


def equation(model: PolynomialModel) -> Markup:
    """The structure as an equation, such as ``A(q) y(t) = B(q) u(t) + C(q) e(t)``."""
    return Markup(
        re.sub(
            r"([A-Za-z])(\d*)\(([qt])\)",
            lambda found: f"<i>{found[1]}</i>{_below(found[2])}(<i>{found[3]}</i>)",
            _plain_equation(model),
        )
    )


def state_space_equation(has_input: bool, has_noise_model: bool) -> Markup:
    """The innovations form, one line for its states and one for the outputs."""
    of_inputs = ("<i>B</i> <i>u</i>(<i>t</i>) + ", "<i>D</i> <i>u</i>(<i>t</i>) + ")
    state, output = of_inputs if has_input else ("", "")
    noise = "<i>K</i> <i>e</i>(<i>t</i>)" if has_noise_model else ""
    driven = f" + {state}{noise}".removesuffix(" + ")
    return Markup(
        f"<i>x</i>(<i>t</i> + 1) = <i>A</i> <i>x</i>(<i>t</i>){driven}"
        f"<br><i>y</i>(<i>t</i>) = <i>C</i> <i>x</i>(<i>t</i>) + {output}<i>e</i>(<i>t</i>)"
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


def polynomials(model: PolynomialModel) -> list[tuple[str, Markup]]:
    """The polynomials of the structure in the backshift operator, each with its name."""
    return [
        (name, _signed([(value, lag) for lag, value in enumerate(coefficients, start=first)]))
        for name, coefficients, first in _polynomials(model)
    ]


def _signed(terms: Iterable[tuple[float, int]]) -> Markup:
    """Coefficients and lags joined by their signs; a line breaks between terms alone."""
    shown: list[Markup] = []
    for coefficient, lag in terms:
        lead = "−" if coefficient < 0 else "+" if shown else ""
        power = Markup(" <i>q</i><sup>−{}</sup>").format(lag) if lag else ""
        space = " " if shown else ""
        size = f"{lead}{space}{number(abs(coefficient), 5)}"
        shown.append(Markup('<span class="term">{}{}</span>').format(size, power))
    return Markup(" ").join(shown)


def orders_note(model: PolynomialModel) -> Markup:
    """What the orders are, by their symbols."""
    orders = model.orders
    names = STRUCTURES[model.orders.structure]

    def of_inputs(name: str) -> list[str]:
        given = zip(_indices(model), getattr(orders, name), strict=True)
        return [f"{symbol(f'{name}{index}')} = {value}" for index, value in given]

    degrees = [
        f"{symbol(name)} = {getattr(orders, name)}" for name in ("na", "nc", "nd") if name in names
    ]
    degrees += of_inputs("nf") if "nf" in names else []
    verb = "are degrees" if len(degrees) > 1 else "is a degree"
    parts = [f"{enumeration(degrees)} {verb}"] if degrees else []
    parts += [
        f"{count} is the <em>number</em> of {symbol(f'B{index}')} coefficients,"
        f" the first at lag {lag}"
        for index, count, lag in zip(_indices(model), of_inputs("nb"), of_inputs("nk"), strict=True)
    ]
    return Markup("; ".join(parts) + ".")


def text(model: PolynomialModel) -> str:
    """The equation and its polynomials in plain characters, ten significant digits."""
    lines = [_plain_equation(model)]
    for name, coefficients, first in _polynomials(model):
        terms: list[str] = []
        for lag, coefficient in enumerate(coefficients, start=first):
            size = f"{abs(coefficient):.10g}" + (f" q^-{lag}" if lag else "")
            if not terms:
                terms.append(f"-{size}" if coefficient < 0 else size)
            else:
                terms.append(f"{'-' if coefficient < 0 else '+'} {size}")
        lines.append(f"{name}(q) = {' '.join(terms) or '0'}")
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
    numbers = np.ravel(value).tolist()
    listed = " ".join(f"{each:.17g}" for each in numbers)
    return listed if len(numbers) == 1 else f"[{listed}]"


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


def _listed(coefficients: np.ndarray) -> str:
    return f"[{', '.join(f'{value:.17g}' for value in coefficients)}]"


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
    return [(*each, error) for each, error in zip(named, errors, strict=True)]
