"""Checks of the roots of the polynomials."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from evopem.config.structures import STRUCTURES, plant_order
from evopem.models.polynomials import root_gradient, roots
from evopem.models.uncertain_roots import CHI_SQUARE_95
from evopem.validation.checks.check import Check

if TYPE_CHECKING:
    from evopem.estimation.model_record import ModelRecord
    from evopem.models.parameter_covariance import ParameterCovariance
    from evopem.models.polynomial import PolynomialModel

Roots = NDArray[np.complex128]

# A pole and a zero farther apart than this do not cancel, however uncertain they are.
MAX_CANCELLATION_DISTANCE = 0.1
# Without a covariance, only a pair closer than this is called a cancellation.
COINCIDENT_DISTANCE = 0.01


DISTINCT = "Poles and zeros distinct"
INSIDE_BOUND = "Roots inside the stability bound"


def stability(model: ModelRecord) -> Check:
    """All poles of the plant, roots of A and F, inside the unit circle, unless allowed outside."""
    check = _inside_unit_circle(
        "Stable",
        _letters(model, "af"),
        model.poles,
        "Do not simulate with this model. Estimate again with a smaller “search.max_root_radius”.",
    )
    if check.passed is not False or not model.may_be_unstable:
        return check
    return Check(
        check.name,
        None,
        f"{check.statement} The constraints require or allow such a pole.",
        "Errors of the initial state and of the input do not decay in a simulation.",
    )


def invertibility(model: ModelRecord) -> Check:
    """All roots of C and D inside the unit circle."""
    own_poles = roots(model.polynomials.D[1:])
    return _inside_unit_circle(
        "Invertible",
        _letters(model, "cd"),
        np.concatenate([model.noise_zeros, own_poles]),
        "The one-step predictor diverges. Estimate again with a smaller “search.max_root_radius”"
        " or smaller orders of the noise model.",
    )


def _letters(model: ModelRecord, letters: str) -> str:
    """Those of some polynomials that the structure has: "A", or "A and F"."""
    names = STRUCTURES[model.structure]
    own = [letter.upper() for letter in letters if f"n{letter}" in names]
    return " and ".join([", ".join(own[:-1]), own[-1]] if len(own) > 1 else own)


def _inside_unit_circle(name: str, polynomial: str, found: Roots, advice: str) -> Check:
    if found.size == 0:
        none = f"{polynomial} = 1 has no roots." if polynomial else "The model has no such roots."
        return Check(name, True, none)
    largest = float(np.max(np.abs(found)))
    if not np.isfinite(largest):
        return Check(name, None, f"The roots of {polynomial} are not finite.", advice)
    passed = largest < 1.0
    where = "inside" if passed else "not inside"
    return Check(
        name,
        passed,
        f"The largest radius of the roots of {polynomial} is {largest:.5f}, {where} the unit"
        " circle.",
        "" if passed else advice,
    )


def stability_bound(model: ModelRecord) -> Check:
    """No root of A, C, D or F at the largest radius that the search allows."""
    name = INSIDE_BOUND
    bound = f"the stability bound (radius {model.search.settings.max_root_radius:g})"
    letters = _letters(model, "acdf").replace(" and ", " or ")
    if not letters:
        return Check(name, True, f"The model has no roots that could lie at {bound}.")
    if not model.search.at_stability_bound:
        return Check(name, True, f"No root of {letters} lies at {bound}.")
    if model.may_be_unstable:
        return Check(
            name,
            None,
            f"A root of {letters} lies at or beyond {bound}, and the constraints fix or allow such"
            " roots.",
        )
    return Check(
        name,
        False,
        f"A root of {letters} lies at {bound}: the bound and not the data determines its radius.",
        "A root of C at the bound indicates overdifferencing: lower “transforms.difference”."
        " A pole there indicates drift or very low damping: remove the drift, or raise"
        " “search.max_root_radius” towards 1. With a short record, lower the orders.",
    )


def cancellation(model: ModelRecord) -> Check:
    """No pole and zero of B/(A F) that their joint 95 % uncertainty cannot distinguish."""
    name = DISTINCT
    poles, zeros = model.poles, np.concatenate([np.empty(0), *model.zeros])
    if poles.size == 0 or zeros.size == 0:
        return Check(name, True, "The model has no pair of a pole and a zero.")
    own = model.polynomials
    distance, pole, zero = min(
        (abs(pole - zero), complex(pole), complex(zero))
        for pole in poles
        for zero in zeros
        if pole.imag >= 0 and zero.imag >= 0
    )
    nearest = f"The nearest pair, pole {_root_text(pole)} and zero {_root_text(zero)}, is"
    order = plant_order(model.structure)
    advice = (
        f"The pair hardly affects the frequency response: lower {order} and nb by one (a real pair)"
        " or two (a complex pair) and compare the BIC."
    )
    covariance = model.polynomials.covariance
    if covariance is None:
        if distance < COINCIDENT_DISTANCE:
            return Check(name, False, f"{nearest} only {distance:.2g} apart.", advice, "caution")
        return Check(
            name,
            None,
            f"{nearest} {distance:.2g} apart. Without a parameter covariance, this distance cannot"
            " be compared with its uncertainty.",
            "The parameters of a model of too high order are not all determined: lower the orders,"
            " or use a longer record.",
        )
    indistinct = [
        f"{_root_text(pole)} and {_root_text(zero)}"
        for pole, zero in cancelling_pairs(own, covariance)
    ]
    if indistinct:
        return Check(
            name,
            False,
            "A pole and a zero do not differ significantly at the 95 % level:"
            f" {'; '.join(indistinct)}.",
            advice,
            "caution",
        )
    return Check(
        name,
        True,
        f"{nearest} {distance:.2g} apart. No pair closer than {MAX_CANCELLATION_DISTANCE:g} is"
        " within its joint 95 % uncertainty.",
    )


def cancelling_pairs(
    model: PolynomialModel, covariance: ParameterCovariance
) -> list[tuple[complex, complex]]:
    """Pairs of a pole of A or F and a zero that do not differ significantly.

    Parameters
    ----------
    model : PolynomialModel
    covariance : ParameterCovariance
        Of its coefficients.
    """
    return [
        (complex(pole), complex(zero))
        for letter in "af"
        for pole in roots(getattr(model, letter)[1:])
        for zero in model.zeros()
        if pole.imag >= 0
        and zero.imag >= 0
        and abs(pole - zero) < MAX_CANCELLATION_DISTANCE
        and indistinguishable(
            complex(pole),
            complex(zero),
            getattr(model, letter),
            model.b,
            _with_numerator(model, letter, covariance),
        )
    ]


def _with_numerator(
    model: PolynomialModel, letter: str, covariance: ParameterCovariance
) -> ParameterCovariance:
    """Covariance of the coefficients of A or F and of those of B."""
    index = np.arange(model.orders.parameters)
    return covariance.part(np.concatenate([index[model.part(letter)], index[model.part("b")]]))


def indistinguishable(
    pole: complex,
    zero: complex,
    a: NDArray[np.float64],
    b: NDArray[np.float64],
    covariance: ParameterCovariance,
) -> bool:
    """Whether the 95 % confidence region of pole minus zero contains 0.

    Parameters
    ----------
    pole, zero : complex
        Both real, or both with positive imaginary parts.
    a : (na + 1,) array
        Denominator, leading 1 included.
    b : (nb,) array
        Numerator.
    covariance : ParameterCovariance
        Of ``[a_1.., b_0..]``.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        gradient = np.concatenate([root_gradient(a, pole)[1:], -root_gradient(b, zero)])
    if not np.all(np.isfinite(gradient)):
        return True  # a repeated root has no derivative: its position is not determined
    difference = pole - zero
    if pole.imag == 0 and zero.imag == 0:
        jacobian = gradient.real[np.newaxis]
        offset = np.array([difference.real])
    else:
        jacobian = np.vstack([gradient.real, gradient.imag])
        offset = np.array([difference.real, difference.imag])
    spread = covariance.of(jacobian)
    if not np.all(np.isfinite(spread)):
        return True  # the data do not determine their distance
    statistic = float(offset @ np.linalg.pinv(spread, hermitian=True) @ offset)
    return statistic < CHI_SQUARE_95[offset.size]


def _root_text(root: complex) -> str:
    """A root to four decimals, with a true minus sign."""
    if abs(root.imag) < 5e-5:
        return f"{root.real:.4f}".replace("-", "−")
    return f"{root.real:.4f} ± {abs(root.imag):.4f}i".replace("-", "−")
