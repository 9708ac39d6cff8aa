"""For each mode of a model: does the input reach it, does the noise need it, do other orders agree?

A pole of A is shared by G = B/(A F) and H = C/(A D), one of F belongs to G alone.  A pole can
describe a resonance that the input drives, one that disturbances alone drive, or nothing: a pole
that a zero of B and one of C both cancel.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from evopem.models.modes import Mode
from evopem.models.polynomial import PolynomialModel
from evopem.models.polynomials import roots
from evopem.signals.spectral.frequency_response import FrequencyResponse
from evopem.validation.held_out_tests import (
    HeldOutTest,
    contribution_test,
    free_responses,
    improvement_test,
)

Array = NDArray[np.float64]

# Level of each test.
SIGNIFICANCE = 0.01
# A mode of another order is the same one within these relative differences, or within two standard
# errors of the mode.
SAME_FREQUENCY = 0.02
SAME_DAMPING = 0.3
# Share of the other models in which a stable mode is found again.
STABLE_SHARE = 0.75
# Of a part that the model does not have.
NO_TEST = HeldOutTest(math.nan, math.nan, math.nan, 0)


@dataclass(frozen=True)
class ModeEvidence:
    """What the data say about one mode.

    Attributes
    ----------
    mode : Mode
    residue : complex
        Residue r of the mode in G: its share of the impulse response is ``2 Re(r p^k)``, p the
        pole, k samples after the delay.
    residue_se : float
        Standard error of ``|r|`` to first order; infinite where it is not identifiable, NaN where
        the covariance is not known.
    input_test : HeldOutTest
        Of the mode's response to the input, on held-out samples, beside the other terms of the
        partial fractions of G.
    reached : bool or None
        Whether the input reaches the mode, by ``input_test``; None where it is not possible.
        False for a model without input.
    coherence, coherence_limit : float
        Squared coherence of input and output at the mode's frequency, and the value that it
        exceeds by chance with probability 1 % where there is none.  NaN when not known.
    noise_test : HeldOutTest
        Of the one-step prediction with the pole in the noise model against that without it.
    needed_by_noise : bool or None
        Whether the noise model needs the mode, by ``noise_test``.  False for a pole of F.
    recurrence : float
        Share of the models of other orders that have this mode; NaN where there is none.
    stable : bool or None
        Whether that share is at least :data:`STABLE_SHARE`.
    """

    mode: Mode
    residue: complex
    residue_se: float
    input_test: HeldOutTest
    reached: bool | None
    coherence: float
    coherence_limit: float
    noise_test: HeldOutTest
    needed_by_noise: bool | None
    recurrence: float
    stable: bool | None

    @property
    def has_input(self) -> bool:
        """Whether the model of the mode has an input."""
        return self.input_test.samples > 0

    @property
    def origin(self) -> str:
        """What drives the mode: ``input``, ``noise``, ``neither`` or ``not judged``."""
        return origin_of(self.reached, self.needed_by_noise)


def origin_of(reached: bool | None, needed_by_noise: bool | None) -> str:
    """What drives a mode: ``input``, ``noise``, ``neither`` or ``not judged``."""
    if reached:
        return "input"
    if needed_by_noise:
        return "noise"
    if reached is None or needed_by_noise is None:
        return "not judged"
    return "neither"


def mode_evidence(
    model: PolynomialModel,
    input: ArrayLike,  # noqa: A002
    output: ArrayLike,
    first: int = 0,
    states: tuple[ArrayLike | None, ArrayLike | None] = (None, None),
    response: FrequencyResponse | None = None,
    others: Sequence[PolynomialModel] = (),
) -> list[ModeEvidence]:
    """Evidence for each mode of a model, by frequency.

    Parameters
    ----------
    model : PolynomialModel
        Stable and invertible.
    input, output : (N,) array_like
        Signals that end with the held-out samples; they may begin with the estimation samples.
    first : int
        First held-out sample.
    states : (plant state, noise state), optional
        As for :meth:`PolynomialModel.residuals`.
    response : FrequencyResponse, optional
        Multitaper estimate from the same recording, for the coherence.
    others : sequence of PolynomialModel
        Models of other orders of the same recording.  Those that have fewer poles than all modes
        need do not count: that they lack a mode says nothing about it.
    """
    u, y = np.asarray(input, dtype=float), np.asarray(output, dtype=float)
    residuals = model.residuals(u, y, *states)
    free = free_responses(model.plant_denominator, len(y) - first)
    modes = model.modes()
    able = [each for each in others if len(each.plant_denominator) > 2 * len(modes)]
    responses = [modal_response(model, mode.pole, u) for mode in modes]
    rest = model.simulate(u) - np.sum(responses, axis=0)
    shared = roots(model.a[1:])
    found = []
    for index, mode in enumerate(modes):
        # The other terms are regressors, not taken as right: of two close poles that cancel each
        # other's response, neither may pass because the other one is there.
        other_terms = [*responses[:index], *responses[index + 1 :], rest]
        nuisance = np.column_stack([*(term[first:] for term in other_terms), free])
        of_input, of_noise = NO_TEST, NO_TEST
        if model.has_input:
            of_input = contribution_test(y[first:], responses[index][first:], nuisance)
        in_noise = bool(np.any(shared == mode.pole))
        if in_noise:
            of_noise = _noise_test(model, mode.pole, residuals, first)
        residue, residue_se = 0j, math.nan
        if model.has_input:
            residue, residue_se = modal_residue(model, mode.pole)
        coherence, limit = _coherence(response, mode.frequency_hz)
        recurrence = mode_recurrence(mode, able)
        found.append(
            ModeEvidence(
                mode=mode,
                residue=residue,
                residue_se=residue_se,
                input_test=of_input,
                reached=of_input.significant(SIGNIFICANCE) if model.has_input else False,
                coherence=coherence,
                coherence_limit=limit,
                noise_test=of_noise,
                needed_by_noise=of_noise.significant(SIGNIFICANCE) if in_noise else False,
                recurrence=recurrence,
                stable=None if math.isnan(recurrence) else recurrence >= STABLE_SHARE,
            )
        )
    return found


def modal_residue(model: PolynomialModel, pole: complex) -> tuple[complex, float]:
    """Residue of a pole of G, delay aside, and the standard error of its modulus.

    With w = q^-1, w_0 = 1/p and P = A F: ``r = -B(w_0) / (w_0 P'(w_0))``, differentiated with
    respect to the coefficients of B and, directly and through w_0, to those of P.

    Parameters
    ----------
    model : PolynomialModel
        With an input.
    pole : complex
        A simple root of A F.
    """
    polynomial = np.polynomial.polynomial
    denominator_of_g = model.plant_denominator
    degree, nb = len(denominator_of_g) - 1, len(model.b)
    w = 1.0 / pole
    slope = polynomial.polyval(w, polynomial.polyder(denominator_of_g))
    bend = polynomial.polyder(denominator_of_g, 2)
    curvature = polynomial.polyval(w, bend) if degree > 1 else 0.0
    numerator = polynomial.polyval(w, model.b)
    numerator_slope = polynomial.polyval(w, polynomial.polyder(model.b)) if nb > 1 else 0.0
    gradient = np.zeros(model.orders.parameters, dtype=complex)
    with np.errstate(divide="ignore", invalid="ignore"):
        denominator = w * slope
        residue = -numerator / denominator
        lags = np.arange(1, degree + 1)
        w_by_p = -(w**lags) / slope
        denominator_by_p = lags * w**lags + (slope + w * curvature) * w_by_p
        by_p = -(numerator_slope * w_by_p + residue * denominator_by_p) / denominator
        # A coefficient of A at lag i moves those of A F by F, delayed by i; likewise one of F.
        for letter, other in (("a", model.f), ("f", model.a)):
            part = model.part(letter)
            gradient[part] = [
                by_p[lag : lag + len(other)] @ other for lag in range(part.stop - part.start)
            ]
        gradient[model.part("b")] = -(w ** np.arange(nb)) / denominator
        gradient = (np.conj(residue) * gradient).real / abs(residue)
    if model.covariance is None:
        return complex(residue), math.nan
    return complex(residue), float(model.covariance.standard_errors(gradient[None, :])[0])


def modal_response(model: PolynomialModel, pole: complex, input: ArrayLike) -> Array:  # noqa: A002
    """What a pair of complex poles contributes to the simulated output, (N,).

    Its term in the partial fractions of G, from rest, delayed by nk.

    Parameters
    ----------
    model : PolynomialModel
    pole : complex
        A simple root of A F.
    input : (N,) array_like
    """
    from scipy.signal import lfilter

    if not model.has_input:
        return np.zeros(len(np.asarray(input)))
    residue, _ = modal_residue(model, pole)
    # r / (1 - p w) + its conjugate.
    numerator = 2.0 * np.array([residue.real, -(residue * np.conj(pole)).real])
    denominator = _factor(pole)
    delayed = np.concatenate([np.zeros(model.delay), numerator])
    response: Array = lfilter(delayed, denominator, np.asarray(input, dtype=float))
    return response


def mode_recurrence(mode: Mode, others: Sequence[PolynomialModel]) -> float:
    """Share of other models that have a mode of about this frequency and damping; NaN for none.

    Models with fewer poles than a pair are not counted.
    """
    able = [model for model in others if len(model.plant_denominator) > 2]
    if not able:
        return math.nan
    frequency = _reach(SAME_FREQUENCY * mode.frequency_hz, mode.frequency_se_hz)
    damping = _reach(SAME_DAMPING * abs(mode.damping_ratio), mode.damping_se)
    return float(
        np.mean(
            [
                any(
                    abs(other.frequency_hz - mode.frequency_hz) <= frequency
                    and abs(other.damping_ratio - mode.damping_ratio) <= damping
                    for other in model.modes()
                )
                for model in able
            ]
        )
    )


def _reach(relative: float, standard_error: float) -> float:
    """The larger of a tolerance and two standard errors, where these are finite."""
    return max(relative, 2.0 * standard_error) if math.isfinite(standard_error) else relative


def _noise_test(model: PolynomialModel, pole: complex, residuals: Array, first: int) -> HeldOutTest:
    """Compare one-step errors with those of a noise model without a pair of poles.

    The pair is removed from H = C/(A D) together with the zeros of C nearest to it, a pair where C
    has two roots.  A pole that these cancel makes no difference.
    """
    from scipy.signal import lfilter

    zeros = roots(model.c[1:])
    start = max(model.orders.first_residual, first)
    cancelling = np.ones(1)
    if len(zeros) >= 2:
        nearest = complex(zeros[np.argmin(np.abs(zeros - pole))])
        if nearest.imag == 0.0:
            real = np.sort(zeros[zeros.imag == 0.0].real)
            by_distance = real[np.argsort(np.abs(real - pole), kind="stable")]
            # A real zero without a partner is the last one left beside complex pairs.
            cancelling = np.real(np.poly(by_distance[:2]))
        else:
            cancelling = _factor(nearest)
    # e = (A D/C)(y - G u), and without the pair (A / A_p) (C_p / C) D (y - G u).
    without = lfilter(cancelling, _factor(pole), residuals[model.orders.first_residual :])
    offset = start - model.orders.first_residual
    return improvement_test(without[offset:], residuals[start:])


def _factor(root: complex) -> Array:
    """``(1 - p w)(1 - p* w)``."""
    return np.array([1.0, -2.0 * root.real, abs(root) ** 2])


def _coherence(response: FrequencyResponse | None, frequency: float) -> tuple[float, float]:
    """Coherence nearest to a frequency, and its 99 % point where there is none."""
    if response is None:
        return math.nan, math.nan
    index = int(np.argmin(np.abs(response.frequencies - frequency)))
    limit = float(response.coherence_limit(SIGNIFICANCE)[index])
    return math.nan if math.isnan(limit) else float(response.coherence[index, 0]), limit
