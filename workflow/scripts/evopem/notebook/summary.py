"""The few lines that a notebook shows of an identification."""

from __future__ import annotations

from html import escape

from evopem.report.numbers import count, number, percent, with_error
from evopem.report.sentences.about_verdict import verdict
from evopem.results.dataset import DatasetResults


def html_summary(results: DatasetResults) -> str:
    """Verdict, modes, errors and failed checks as HTML without styles that leave it.

    Parameters
    ----------
    results : DatasetResults
    """
    validation, model = results.validation, results.model
    errors = [f"one step ahead {percent(validation.prediction_error_percent)}"]
    if model.model.has_input:
        errors.insert(0, f"simulation {percent(validation.simulation_error_percent)}")
    failed = [check for check in results.checks if check.passed is False]
    parts = [
        f"<p><strong>{escape(results.name)}</strong>: {escape(verdict(results).sentence)}</p>",
        _modes(results),
        f"<p>{escape(str(model.orders))}, from {count(model.transforms.estimation_samples)} samples"
        f" at {number(model.sampling_rate)} Hz. Errors on {count(validation.samples)} validation"
        f" samples: {', '.join(errors)}.</p>",
    ]
    if failed:
        items = "".join(
            f"<li>{escape(check.name)}: {escape(check.statement)}</li>" for check in failed
        )
        heading = f"{len(failed)} failed check{'s' if len(failed) > 1 else ''}"
        parts.append(f"<details><summary>{heading}</summary><ul>{items}</ul></details>")
    return "<div>" + "\n".join(parts) + "</div>"


def _modes(results: DatasetResults) -> str:
    modes = results.model.modes
    if not modes:
        return "<p>The model has no oscillating mode.</p>"
    trusted = {each.mode.pole for each in results.trusted_modes}
    rows = "".join(
        f"<tr><th>{position}</th>"
        f"<td>{with_error(mode.frequency_hz, mode.frequency_se_hz)}</td>"
        f"<td>{with_error(100.0 * mode.damping_ratio, 100.0 * mode.damping_se)}</td>"
        f"<td>{'trusted' if mode.pole in trusted else 'not trusted'}</td></tr>"
        for position, mode in enumerate(modes, start=1)
    )
    head = "<th>mode</th><th>frequency (Hz)</th><th>damping (%)</th><th></th>"
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
