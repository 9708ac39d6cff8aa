"""A comparison of models in plain text: errors, and modes side by side."""

from __future__ import annotations

from collections.abc import Sequence

from evopem.report.numbers import MISSING, fixed, percent, with_error
from evopem.results.comparison import Comparison, MatchedMode
from evopem.validation.checks import failed_checks

SAME = "All models were validated on the same samples."
DIFFERENT = (
    "The models were validated on different samples: their errors are no ranking of the models."
)


def comparison_text(comparison: Comparison) -> str:
    """Errors of the models, and their modes, one line for each."""
    errors = [("", "model", "simulation", "one step", "failed checks")]
    for label, results in zip(comparison.labels, comparison.results, strict=True):
        validation = results.validation
        errors.append(
            (
                label,
                str(results.model.orders),
                percent(validation.simulation_error_percent),
                percent(validation.prediction_error_percent),
                str(len(failed_checks(results.checks))),
            )
        )
    modes = [
        ("mode", *comparison.labels, "spread"),
        *(
            (str(place), *cells(each), spread(each))
            for place, each in enumerate(comparison.modes, start=1)
        ),
    ]
    lines = [*_aligned(errors), "", validated_on(comparison)]
    if comparison.modes:
        lines += [
            "",
            "Natural frequencies in Hz; in brackets: not to be trusted.",
            *_aligned(modes),
        ]
    return "\n".join(lines)


def validated_on(comparison: Comparison) -> str:
    """Whether the errors of the models can be compared."""
    return SAME if comparison.has_same_validation else DIFFERENT


def cells(matched: MatchedMode) -> list[str]:
    """The frequency of a mode in each model, in brackets where it is not to be trusted."""
    shown = []
    for mode, trusted in zip(matched.modes, matched.trusted, strict=True):
        if mode is None:
            shown.append(MISSING)
            continue
        text = with_error(mode.frequency_hz, mode.frequency_se_hz)
        shown.append(text if trusted else f"({text})")
    return shown


def spread(matched: MatchedMode) -> str:
    """Largest less smallest frequency in percent, a dash for one model."""
    value = matched.spread_percent
    return MISSING if value != value else f"{fixed(value, 2)}\u202f%"


def _aligned(rows: Sequence[Sequence[str]]) -> list[str]:
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    return [
        "  ".join(f"{cell:<{width}}" for cell, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]
