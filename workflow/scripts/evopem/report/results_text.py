"""The results of a data set in plain text: verdict, modes, errors, failed checks, report."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Sequence

from evopem.models.modes import Mode
from evopem.report.numbers import count, is_number, percent, plural, with_error
from evopem.report.sentences.about_verdict import verdict
from evopem.results.dataset import DatasetResults
from evopem.results.fleet import DatasetSummary
from evopem.validation.checks import Check, failed_checks

_WIDTH = 96


def results_text(results: DatasetResults, page: str = "") -> str:
    """The lines about one data set."""
    validation, transforms = results.validation, results.model.transforms
    lines = [
        *textwrap.wrap(f"{results.name}: {verdict(results).sentence}", _WIDTH),
        "",
        *_mode_table(results),
        "",
        f"  model   {results.model.orders}, from {count(transforms.estimation_samples)} samples at "
        f"{results.model.sampling_rate:g} Hz",
        f"  errors  one step ahead {percent(validation.prediction_error_percent)}, simulation "
        f"{percent(validation.simulation_error_percent)} on {count(validation.samples)} "
        "validation samples",
        *_failed(results.checks),
        *([f"  report  {page}"] if page else []),
    ]
    return "\n".join(lines)


def state_space_text(summary: DatasetSummary, name: str, page: str = "") -> str:
    """The lines about one data set with several channels."""
    failed = len(summary.failed)
    errors = [f"one step ahead {percent(summary.prediction_error_percent)}"]
    if is_number(summary.simulation_error_percent):
        errors.append(f"simulation {percent(summary.simulation_error_percent)}")
    lines = [
        f"{name}: {plural(failed, 'failed check') if failed else 'no failed check'}",
        "",
        *_modes_of(summary.modes, summary.trusted),
        "",
        f"  model   {summary.model}, from {count(summary.estimation_samples)} samples at "
        f"{summary.sampling_rate:g} Hz",
        *_wrapped(
            f"{', '.join(errors)} on {count(summary.validation_samples)} validation samples, mean"
            " over the outputs",
            "  errors  ",
        ),
        *_failed(summary.checks),
        *([f"  report  {page}"] if page else []),
    ]
    return "\n".join(lines)


def _mode_table(results: DatasetResults) -> list[str]:
    trusted = {each.mode.pole for each in results.trusted_modes}
    modes = results.model.modes
    return _modes_of(modes, [mode.pole in trusted for mode in modes])


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
