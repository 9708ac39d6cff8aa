"""Checks of the roots of the polynomials."""

import numpy as np

from evopem.arrays import Array, Complex
from evopem.config.structures import STRUCTURES, plant_order
from evopem.estimation.criteria import lies_at_bound
from evopem.estimation.model_record import ModelRecord
from evopem.models.parameter_covariance import ParameterCovariance
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomial_roots import CHI_SQUARE_95, root_gradient, roots
from evopem.validation.checks.check import Evidence, Found, check, root_text

# A pole and a zero farther apart than this do not cancel, however uncertain they are.
MAX_CANCELLATION_DISTANCE = 0.1
# Without a covariance, only a pair closer than this is called a cancellation.
COINCIDENT_DISTANCE = 0.01

DISTINCT = "Poles and zeros distinct"
INSIDE_BOUND = "Roots inside the stability bound"

UNSTABLE = "Errors of the initial state and of the input do not decay in a simulation."


@check(
    "Stable",
    "Do not simulate with this model. Estimate again with a smaller “search.max_root_radius”.",
)
def stability(evidence: Evidence) -> Found:
    """All poles of the plant inside the unit circle, unless constraints allow them outside."""
    model = evidence.model
    what = f"roots of {_letters(model, 'af')}" if model.orders else "eigenvalues of A"
    passed, statement = _inside_unit_circle(what, model.poles)
    if passed is False and model.may_be_unstable:
        return None, f"{statement} The constraints require or allow such a pole.", UNSTABLE
    return passed, statement


@check(
    "Invertible",
    "The one-step predictor diverges. Estimate again with a smaller “search.max_root_radius” or"
    " smaller orders of the noise model.",
)
def invertibility(evidence: Evidence) -> Found | None:
    """All roots of C and D, or eigenvalues of the predictor, inside the unit circle."""
    model = evidence.model
    if model.orders is None:
        if not model.has_noise_model:
            return None
        return _inside_unit_circle("eigenvalues of A − K C", model.noise_zeros)
    all_roots = np.concatenate([model.noise_zeros, roots(model.polynomials.D[1:])])
    return _inside_unit_circle(f"roots of {_letters(model, 'cd')}", all_roots)


def _letters(model: ModelRecord, letters: str) -> str:
    """Those of some polynomials that the structure has: "A", or "A and F"."""
    names = STRUCTURES[model.structure]
    upper = [letter.upper() for letter in letters if f"n{letter}" in names]
    return " and ".join([", ".join(upper[:-1]), upper[-1]] if len(upper) > 1 else upper)


def _inside_unit_circle(what: str, all_roots: Complex) -> tuple[bool | None, str]:
    if all_roots.size == 0:
        return True, "The model has no root that would have to lie inside the unit circle."
    largest = float(np.max(np.abs(all_roots)))
    if not np.isfinite(largest):
        return None, f"The {what} are not finite."
    where = "inside" if largest < 1.0 else "not inside"
    statement = f"The largest radius of the {what} is {largest:.7f}, {where} the unit circle."
    return largest < 1.0, statement


@check(
    INSIDE_BOUND,
    "A root of C at the bound of differenced signals indicates overdifferencing: lower"
    " “transforms.difference”. A pole there indicates drift or very low damping: remove the drift,"
    " or raise “search.max_root_radius” towards 1. With a short record, lower the orders.",
)
def stability_bound(evidence: Evidence) -> Found:
    """No root of A, C, D or F, and no eigenvalue, at the largest radius that the search allows."""
    model = evidence.model
    bound = f"the stability bound (radius {model.search.settings.max_root_radius:.10g})"
    of_noise = model.search.at_stability_bound and is_of_noise(model)
    which = "cd" if of_noise else "acdf"
    letters = _letters(model, which).replace(" and ", " or ") if model.orders else ""
    if model.orders and not letters:
        return True, f"The model has no roots that could lie at {bound}."
    what = f"root of {letters}" if letters else "eigenvalue of A or of A − K C"
    if not model.search.at_stability_bound:
        return True, f"No {what} lies at {bound}."
    a = f"{'A' if letters else 'An'} {what} lies at"
    if model.may_be_unstable:
        return (None, f"{a} or beyond {bound}, and the constraints fix or allow such roots.", "")
    alone = " No pole of the response to the input does." * of_noise
    return False, f"{a} {bound}: the bound and not the data determines its radius.{alone}"


def is_of_noise(model: ModelRecord) -> bool:
    """Whether the response to an input has no pole at the stability bound."""
    radius = float(np.max(np.abs(model.poles), initial=0.0))
    at_bound = lies_at_bound(radius, model.search.settings.max_root_radius)
    return model.has_input and model.has_noise_model and not at_bound


LOWER_THE_ORDERS = (
    "The parameters of a model of too high order are not all determined: lower the orders, or use a"
    " longer record."
)


@check(DISTINCT, grade="caution")
def cancellation(evidence: Evidence) -> Found | None:
    """No pole and zero of B_i/(A F_i) that their joint 95 % uncertainty cannot distinguish."""
    record = evidence.model
    if record.orders is None or not record.has_input:
        return None
    model = record.polynomials
    pairs = [
        (abs(pole - zero), complex(pole), complex(zero))
        for place in range(model.inputs)
        for pole in np.concatenate([roots(model.A[1:]), roots(model.F[place][1:])])
        for zero in model.zeros(place)
        if pole.imag >= 0 and zero.imag >= 0
    ]
    if not pairs:
        return True, "The model has no pair of a pole and a zero."
    distance, *pair = min(pairs)
    pole, zero = map(root_text, pair)
    nearest = f"The nearest pair, pole {pole} and zero {zero}, is"
    advice = (
        f"The pair hardly affects the frequency response: lower {plant_order(record.structure)} and"
        " nb by one (a real pair) or two (a complex pair) and compare the BIC."
    )
    if model.covariance is None:
        if distance < COINCIDENT_DISTANCE:
            return False, f"{nearest} only {distance:.2g} apart.", advice
        unknown = "Without a parameter covariance, this distance cannot be compared with its"
        return None, f"{nearest} {distance:.2g} apart. {unknown} uncertainty.", LOWER_THE_ORDERS
    indistinct = [
        " and ".join(map(root_text, c)) for c in cancelling_pairs(model, model.covariance)
    ]
    if indistinct:
        problem = "A pole and a zero do not differ significantly at the 95 % level"
        return False, f"{problem}: {'; '.join(indistinct)}.", advice
    return (
        True,
        f"{nearest} {distance:.2g} apart. No pair closer than {MAX_CANCELLATION_DISTANCE:g} is"
        " within its joint 95 % uncertainty.",
    )


def cancelling_pairs(
    model: PolynomialModel, covariance: ParameterCovariance
) -> list[tuple[complex, complex]]:
    """Pairs of a pole and a zero that do not differ significantly.

    A pole of F_i with a zero of its own B_i; one of A only where each B_i has such a zero.
    """
    pairs = []
    for place in range(model.inputs):
        for pole in roots(model.F[place][1:]):
            pairs += _zeros_beside(model, covariance, "f", place, pole)
    for pole in roots(model.A[1:]):
        of_inputs = [
            _zeros_beside(model, covariance, "a", place, pole) for place in range(model.inputs)
        ]
        pairs += of_inputs[0] if all(of_inputs) and of_inputs else []
    return pairs


def _zeros_beside(
    model: PolynomialModel, covariance: ParameterCovariance, letter: str, place: int, pole: complex
) -> list[tuple[complex, complex]]:
    """A pole of A or F_i with each zero of B_i that it may coincide with."""
    index = np.arange(model.orders.parameters)
    denominator = model.A if letter == "a" else model.F[place]
    at = [index[model.orders.part(letter, place)], index[model.orders.part("b", place)]]
    joint = covariance.part(np.concatenate(at))
    return [
        (complex(pole), complex(zero))
        for zero in model.zeros(place)
        if pole.imag >= 0
        and zero.imag >= 0
        and abs(pole - zero) < MAX_CANCELLATION_DISTANCE
        and indistinguishable(complex(pole), complex(zero), denominator, model.B[place], joint)
    ]


def indistinguishable(
    pole: complex, zero: complex, a: Array, b: Array, covariance: ParameterCovariance
) -> bool:
    """Whether the 95 % confidence region of pole minus zero contains 0.

    Both real, or both with positive imaginary parts.  ``covariance``: of ``[a_1.., b_0..]``.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        gradient = np.concatenate([root_gradient(a, pole)[1:], -root_gradient(b, zero)])
    if not np.all(np.isfinite(gradient)):
        return True  # a repeated root has no derivative: its position is not determined
    parts = slice(1 if pole.imag == 0 and zero.imag == 0 else 2)
    jacobian, offset = (np.array([x.real, x.imag])[parts] for x in (gradient, pole - zero))
    spread = covariance.of(jacobian)
    if not np.all(np.isfinite(spread)):
        return True  # the data do not determine their distance
    statistic = float(offset @ np.linalg.pinv(spread, hermitian=True) @ offset)
    return statistic < CHI_SQUARE_95[offset.size]
