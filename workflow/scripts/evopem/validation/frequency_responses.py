"""What is known of a model of frequency responses: errors, modes to trust, and its checks."""

import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy.special import chdtrc, gammaincc

from evopem.estimation.frequency_fit import ResponseFit, natural
from evopem.estimation.search.frequency_problem import FrequencyProblem, response_axis
from evopem.models.mode_matching import stabilization
from evopem.models.modes import Mode, assurance
from evopem.validation.checks.check import Check, p_text
from evopem.validation.held_out_tests import NO_TEST, SIGNIFICANCE
from evopem.validation.mode_evidence import ModeEvidence, ModeTable
from evopem.validation.model_class import NOT_TESTED, ModelClass
from evopem.validation.validation import Validation

# A mode is trusted whose frequency is known to this share of it, and its damping to that.
FREQUENCY_KNOWN, DAMPING_KNOWN = 0.1, 0.5
# Standard deviations of the correlation of neighbouring lines that chance hardly reaches (0.5 %).
CORRELATED = 2.58
SIZE, PATTERN = "Size of the errors", "Errors without a pattern"
AGREEMENT = "Agreement of searches"
# The uses that checks speak against: see `evopem.report.verdict`.
SPEAK_AGAINST = {
    SIZE: ("response", "intervals"),
    PATTERN: ("response", "intervals"),
    AGREEMENT: ("response", "modes"),
}


def validate_responses(fit: ResponseFit, modes: Sequence[Mode], most: int) -> Validation:
    """The validation of a fit; NaN and empty where it would need samples in time.

    Its simulation errors are those of the responses, in percent of them.  ``modes``: those of its
    model; ``most``: the most that were to be tried.
    """
    order = fit.model.order
    evidence = tuple(
        ModeEvidence(
            mode=mode,
            order=order,
            orders=(order,),
            recurrence=math.nan,
            input_test=NO_TEST,
            reached=True,
            needed_by_noise=None,
            doubts=tuple(_doubts(mode, fit)),
        )
        for mode in modes
    )
    poles = stabilization(fit.diagram)
    alike = tuple(tuple(assurance(a.shape, b.shape) for b in modes) for a in modes)
    nan = math.nan
    return Validation(
        samples=0,
        unscored_samples=0,
        prediction_error_percent=nan,
        simulation_error_percent=fit.error_percent,
        fitted_state_error_percent=nan,
        outputs=(),
        inputs=(),
        pairs=(),
        horizons=(),
        stretches=(),
        residual_samples=0,
        lags=0,
        correlation_lags=0,
        input_test=NO_TEST,
        model_class=ModelClass(NOT_TESTED, NOT_TESTED, NOT_TESTED),
        resolution_hz=nan,
        modes=ModeTable(order, tuple(2 * n for n in fit.criteria), evidence, tuple(poles), alike),
        checks=_checks(fit, most),
    )


def _doubts(mode: Mode, fit: ResponseFit) -> Iterator[str]:
    """Why the responses do not determine a mode."""
    frequencies = fit.responses.frequencies
    if not frequencies[0] <= mode.frequency_hz <= frequencies[-1]:
        yield "lies outside the measured frequencies"
    for name, error, most in (
        ("frequency", mode.frequency_se_hz, FREQUENCY_KNOWN * mode.frequency_hz),
        ("damping", mode.damping_se, DAMPING_KNOWN * mode.damping_ratio),
    ):
        if not error < most:
            yield f"has a {name} that the responses do not determine"
    if not _by_chance(mode, fit) < SIGNIFICANCE:
        yield "may describe measurement errors: a mode fitted to these alone could explain as much"


def _by_chance(mode: Mode, fit: ResponseFit) -> float:
    """Probability that a resonance fitted to errors alone, at the best line, explains as much. As
    what the mode adds to all others, whose residues are fitted again without it: poles that were
    would take its place.  Errors have the size and the correlation of lines that are left."""
    size, responses = float(np.sum(np.abs(fit.errors) ** 2)), fit.responses
    away = np.abs([section.pole - mode.pole for section in natural(fit)])
    oscillating = np.flatnonzero(fit.point[fit.sections :] < 0.0)
    kept = np.delete(fit.point.reshape(2, -1), oscillating[np.argmin(away)], axis=1)
    p = response_axis(responses.frequencies, responses.sampling_rate, fit.scale)
    values, weights = responses.values.reshape(len(p), -1), fit.weights.reshape(len(p), -1)
    problem = FrequencyProblem(p, values, weights, fit.sections - 1)
    squares = float(np.sum(problem.solved(kept.ravel())[0] ** 2))
    errors = max(size / (2 * fit.errors.size - fit.parameters), 1.0)
    along = max(_correlation(fit), 0.0)
    explained = (squares / fit.variance_factor - size) / errors * (1.0 - along) / (1.0 + along)
    return len(p) * float(chdtrc(2 * sum(fit.D.shape), max(explained, 0.0)))


def _correlation(fit: ResponseFit) -> float:
    """Of errors at neighbouring frequencies."""
    errors = fit.errors
    squares = max(float(np.sum(np.abs(errors) ** 2)), np.finfo(float).tiny)
    return float(np.sum((errors[:-1].conj() * errors[1:]).real)) / squares


def _checks(fit: ResponseFit, most: int) -> tuple[Check, ...]:
    """The checks that apply to errors at frequencies, whose size is judged where it is stated."""
    errors, searched = fit.errors, fit.search.diagnostics
    squares, freedom = float(np.sum(np.abs(errors) ** 2)), 2 * errors.size - fit.parameters
    p = float(gammaincc(freedom / 2.0, squares / 2.0))
    correlation = _correlation(fit)
    agreeing, lines = searched.n_confirming + 1, np.sqrt(2.0 * errors.size)
    more = "More modes, a nonlinear structure, or one that changed are likely."
    windows = "Windows of analysers correlate lines as well, and make standard errors too small."
    size = f"Squared errors are {squares / freedom:.3g} times their variances ({p_text(p)})."
    pattern = f"Errors at neighbouring frequencies have the correlation {correlation:.2g}."
    agreed = f"{agreeing} of {searched.n_restarts} random starts ended at the lowest optimum found."
    tried = f"{fit.sections} of {min(fit.criteria)} to {max(fit.criteria)} have the smallest BIC."
    again, wider = "Give another search.seed and compare.", "Give a wider range of orders.nx."
    judged: tuple[tuple[str, bool, str, str, Any], ...] = (
        (SIZE, p >= SIGNIFICANCE, size, more, "defect"),
        (PATTERN, correlation * lines < CORRELATED, pattern, f"{more} {windows}", "defect"),
        (AGREEMENT, agreeing > 1, agreed, again, "caution"),
        ("Number of modes in its range", fit.sections < most, tried, wider, "note"),
    )
    judged = judged[: 3 + (len(fit.criteria) > 1)]  # a number that was given has no range
    return tuple(
        Check(name, bool(good), said, "" if good else advice, grade)
        for name, good, said, advice, grade in judged[1 - fit.responses.are_absolute :]
    )
