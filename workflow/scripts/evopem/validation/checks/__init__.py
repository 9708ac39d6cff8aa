"""Checks of a model: each is passed, failed or not judged, with a statement that says why.

A check passes only on numbers that show it. Where a number could not be computed (NaN) or does not
exist, ``passed`` is None and the statement says which one.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

from evopem.validation.checks.check import SIGNIFICANCE, Check, failed_checks, p_text
from evopem.validation.checks.excitation import (
    EXCITATION_ADEQUATE,
    INDEPENDENT_OF_STATE,
    INPUT_COMPARABLE,
    RESPONSE_SIGNIFICANT,
    comparable_split,
    excitation,
    independent_of_state,
    response_to_input,
)
from evopem.validation.checks.recording import saturation
from evopem.validation.checks.residuals import (
    INDEPENDENT_OF_INPUT,
    WHITE,
    input_independence,
    outliers,
    whiteness,
)
from evopem.validation.checks.roots import (
    DISTINCT,
    cancellation,
    invertibility,
    stability,
    stability_bound,
)
from evopem.validation.checks.search import STRUCTURES_PHASE, repeatability, search_ranges
from evopem.validation.checks.spectral_peaks import spectral_peaks

if TYPE_CHECKING:
    from evopem.estimation.candidate import PhaseSelection
    from evopem.estimation.model_record import ModelRecord
    from evopem.signals.recording_info import RecordingInfo
    from evopem.signals.spectral.summary import SpectrumSummary
    from evopem.validation.validation import Validation

# Checks that a model without input does not have.
OF_THE_INPUT = (
    INDEPENDENT_OF_INPUT,
    EXCITATION_ADEQUATE,
    RESPONSE_SIGNIFICANT,
    INPUT_COMPARABLE,
    INDEPENDENT_OF_STATE,
    DISTINCT,
)

# The automatic recipe has tried what the advice of these would be.
REMEDIED = (WHITE, INDEPENDENT_OF_INPUT, DISTINCT)
ELSEWHERE = "Look for nonlinearity, disturbances or feedback in the record."
LEFT_TO_DO = {
    DISTINCT: "The pair hardly affects the frequency response. Do not trust a mode of it."
}

__all__ = ["SIGNIFICANCE", "Check", "checks", "failed_checks", "p_text"]


def checks(
    model: ModelRecord,
    validation: Validation,
    spectrum: SpectrumSummary,
    phases: Mapping[str, PhaseSelection],
    recording: RecordingInfo,
) -> list[Check]:
    """Check a model against its validation, its order search and its recording.

    Parameters
    ----------
    model : ModelRecord
    validation : Validation
    spectrum : SpectrumSummary
        Peaks and resolution of the output's spectrum.
    phases : mapping of str to PhaseSelection
        The order search, by the names of its phases.
    recording : RecordingInfo

    Returns
    -------
    list of Check
        In the order of the report; without an input, those that do not concern it.
    """
    judged = [
        stability(model),
        invertibility(model),
        whiteness(model, validation),
        input_independence(validation),
        spectral_peaks(model, validation.peaks, spectrum),
        cancellation(model),
        search_ranges(phases),
        stability_bound(model),
        repeatability(model.search.diagnostics),
        excitation(model, validation),
        response_to_input(validation),
        independent_of_state(
            validation.simulation_error_percent, validation.fitted_state_error_percent
        ),
        comparable_split(validation),
        outliers(model, validation),
        saturation(recording),
    ]
    if STRUCTURES_PHASE in phases:
        judged = [_after_remedies(check) for check in judged]
    if model.has_input:
        return judged
    return [check for check in judged if check.name not in OF_THE_INPUT]


def _after_remedies(check: Check) -> Check:
    """A failed check whose remedies the workflow has tried."""
    if check.passed is not False or check.name not in REMEDIED:
        return check
    return replace(
        check,
        advice="What was tried against it, and what that brought, is under “Decisions” and in"
        f" decisions.json. {LEFT_TO_DO.get(check.name, ELSEWHERE)}",
    )
