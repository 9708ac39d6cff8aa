"""The results of a data set in plain text: verdict, modes, errors, failed checks, report."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

from evopem.models.modes import Mode
from evopem.report.numbers import count, percent, with_error
from evopem.report.sentences.about_verdict import verdict
from evopem.results.dataset import DatasetResults
from evopem.validation.checks import Check, failed_checks

_WIDTH = 96


def results_text(results: DatasetResults, page: str = "") -> str:
    """The lines about one data set."""
    validation, transforms = results.validation, results.model.transforms
    judged = validation.modes.modes
    lines = [
        *textwrap.wrap(f"{results.name}: {verdict(results).sentence}", _WIDTH),
        "",
        *_modes_of(
            [each.mode for each in judged],
            [each.trusted for each in judged],
        ),
        "",
        f"  model   {results.model.text}, from {count(transforms.estimation_samples)} samples at "
        f"{results.model.sampling_rate:g} Hz",
        f"  errors  one step ahead {percent(validation.prediction_error_percent)}, simulation "
        f"{percent(validation.simulation_error_percent)} on {count(validation.samples)} "
        f"validation samples{', mean over the outputs' if len(validation.outputs) > 1 else ''}",
        *_failed(results.checks),
        *([f"  report  {page}"] if page else []),
    ]
    return "\n".join(lines)


def _modes_of(modes: Sequence[Mode], trusted: Sequence[bool]) -> list[str]:
    if not modes:
        return ["  The model has no oscillating mode."]
    rows = [("mode", "frequency (Hz)", "damping (%)", "")]
    rows += [
        (
            str(position),
            with_error(mode.frequency_hz, mode.frequency_se_hz),
            with_error(100.0 * mode.damping_ratio, 100.0 * mode.damping_se),
            "" if trust else "not to be trusted: see the report",
        )
        for position, (mode, trust) in enumerate(zip(modes, trusted, strict=True), start=1)
    ]
    widths = [max(len(row[column]) for row in rows) for column in range(4)]
    return [
        "  "
        + "   ".join(f"{text:<{width}}" for text, width in zip(row, widths, strict=True)).rstrip()
        for row in rows
    ]


def _failed(checks: Sequence[Check]) -> list[str]:
    """Each failed check with the first sentence of what was found."""
    lines = []
    for check in failed_checks(checks):
        found = re.split(r"(?<=\.) |; ", check.statement, maxsplit=1)[0].rstrip(".")
        lines += _wrapped(f"{check.name}: {found}.", "  failed  ")
    return lines


def _wrapped(text: str, head: str) -> list[str]:
    return textwrap.wrap(text, _WIDTH, initial_indent=head, subsequent_indent=" " * 10)
