"""The model: its equation and coefficients, its constraints, and what the transforms do to it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from evopem.config.constraints import Constraints, FixedPole, Prior
from evopem.estimation.model_record import FitRecord
from evopem.report import equations
from evopem.report.numbers import number, percent, plural
from evopem.report.section import Material, Section
from evopem.report.sentences.about_recording import transform_effects
from evopem.signals.prepared_data import Transforms


@dataclass(frozen=True)
class ConstraintRow:
    """A constraint as the report shows it: its key, its value with unit, and its effect."""

    key: str
    value: str
    effect: str


def constraint_rows(fit: FitRecord | None) -> list[ConstraintRow]:
    """List the constraints that were given for a model."""
    if fit is None or fit.constraints is None:
        return []
    return [
        ConstraintRow(key, value, _effect(key, fit.active))
        for key, value in _values(fit.constraints)
    ]


def fit_sentences(fit: FitRecord | None) -> list[str]:
    """The focus, and what all constraints together cost in fit."""
    if fit is None:
        return []
    sentences = []
    focus = fit.focus
    if focus != "prediction":
        ahead = f"of predictions {plural(focus, 'sample')} ahead" if isinstance(focus, int) else ""
        sentences.append(
            "The order search compared models fitted for one-step prediction. The model of the"
            f" selected orders was then fitted for small errors {ahead or 'of simulation'}:"
            f" their objective is {percent(fit.objective, 4)} on the estimation samples."
        )
    if fit.constraints is not None:
        sentences.append(
            f"{_cost(fit)}"
            " Standard errors are zero across active constraints and count a prior as an"
            " observation."
        )
    return sentences


def _cost(fit: FitRecord) -> str:
    return (
        "The order search did not know the constraints; the model of the selected orders meets"
        f" them. Its objective is {percent(fit.objective, 5)}; without them it is"
        f" {percent(fit.objective_without, 5)}."
    )


def _effect(key: str, active: tuple[str, ...]) -> str:
    if key.startswith("priors"):
        return "weighted"
    if {key, key.partition("[")[0], key.partition(".")[0]} & set(active):
        return "active"
    return "not active"


def _values(constraints: Constraints) -> Iterator[tuple[str, str]]:
    """The constraints that were given, with their units."""
    c = constraints
    if c.stability == "free":
        yield "stability", "free"
    if c.max_pole_radius is not None:
        yield "max_pole_radius", number(c.max_pole_radius)
    if c.min_damping_ratio is not None:
        yield "min_damping_ratio", number(c.min_damping_ratio)
    if c.frequency_band is not None:
        yield "frequency_band", _band(c.frequency_band)
    if c.forbidden_bands:
        yield "forbidden_bands", "; ".join(map(_band, c.forbidden_bands))
    if c.real_poles != "any":
        yield "real_poles", c.real_poles
    for key, gain in _of_inputs("static_gain", c.static_gain):
        yield key, f"{number(gain)} (output/input)"
    for key, bounds in _of_inputs("static_gain_bounds", c.static_gain_bounds):
        lower, upper = ("none" if each is None else number(each) for each in bounds)
        yield key, f"{lower} to {upper} (output/input)"
    for name, value in c.fixed_coefficients.items():
        yield f"fixed_coefficients.{name}", number(value)
    if c.fixed_poles:
        yield "fixed_poles", "; ".join(map(_pole, c.fixed_poles))
    for index, prior in enumerate(c.priors):
        yield f"priors[{index}]", _prior(prior)


def _of_inputs(key: str, given: Any) -> Iterator[tuple[str, Any]]:
    """A constraint of one input by its key, and of several by that and their names."""
    if isinstance(given, dict):
        yield from ((f"{key}.{name}", each) for name, each in given.items())
    elif given is not None:
        yield key, given


def _band(band: tuple[float, float]) -> str:
    return f"{number(band[0])} to {number(band[1])} Hz"


def _pole(pole: FixedPole) -> str:
    if pole.real is not None:
        return f"z = {number(pole.real)}"
    return f"{number(pole.frequency_hz)} Hz, damping ratio {number(pole.damping_ratio)}"


def _prior(prior: Prior) -> str:
    unit = " Hz" if prior.quantity == "frequency" else ""
    mode = "" if prior.mode_hz is None else f" of the mode near {number(prior.mode_hz)} Hz"
    known = f"{number(prior.mean)} ± {number(prior.standard_deviation)}{unit}"
    return f"{prior.quantity}{mode}: {known}"


def _content(material: Material) -> dict[str, Any]:
    record = material.view.results.model
    content = {
        "equation": equations.state_space_equation(record.has_input, record.has_noise_model),
        "polynomials": [],
        "constraints": constraint_rows(record.fit),
        "fit_sentences": fit_sentences(record.fit),
        "effects": transform_effects(record.transforms)
        if isinstance(record.transforms, Transforms)
        else [],
    }
    if record.orders is None:
        return content
    model = record.polynomials
    return content | {
        "equation": equations.equation(model),
        "orders_note": equations.orders_note(model),
        "polynomials": equations.polynomials(model),
        "coefficients": equations.coefficient_table(model),
        "copies": [
            ("text", "Plain text", equations.text(model)),
            ("matlab", "MATLAB", equations.matlab(model)),
            ("python", "Python", equations.python(model)),
            ("json", "JSON", equations.as_json(model)),
        ],
    }


SECTION = Section("model", lambda _: "Model", _content)
