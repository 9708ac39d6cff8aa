"""The few lines that a notebook shows of an identification."""

from __future__ import annotations

from html import escape

from evopem.report.numbers import count, is_number, number, percent, with_error
from evopem.results.fleet import DatasetSummary


def html_summary(name: str, verdict: str, summary: DatasetSummary) -> str:
    """Verdict, modes, errors and failed checks as HTML without styles that leave it.

    Parameters
    ----------
    name : str
    verdict : str
        A sentence.
    summary : DatasetSummary
    """
    errors = [f"one step ahead {percent(summary.prediction_error_percent)}"]
    if is_number(summary.simulation_error_percent):
        errors.insert(0, f"simulation {percent(summary.simulation_error_percent)}")
    parts = [
        f"<p><strong>{escape(name)}</strong>: {escape(verdict)}</p>",
        _modes(summary),
        f"<p>{escape(summary.model)}, from {count(summary.estimation_samples)} samples"
        f" at {number(summary.sampling_rate)} Hz. Errors on {count(summary.validation_samples)}"
        f" validation samples: {', '.join(errors)}.</p>",
    ]
    failed = summary.failed
    if failed:
        items = "".join(
            f"<li>{escape(check.name)}: {escape(check.statement)}</li>" for check in failed
        )
        heading = f"{len(failed)} failed check{'s' if len(failed) > 1 else ''}"
        parts.append(f"<details><summary>{heading}</summary><ul>{items}</ul></details>")
    return "<div>" + "\n".join(parts) + "</div>"


def _modes(summary: DatasetSummary) -> str:
    if not summary.modes:
        return "<p>The model has no oscillating mode.</p>"
    rows = "".join(
        f"<tr><th>{position}</th>"
        f"<td>{with_error(mode.frequency_hz, mode.frequency_se_hz)}</td>"
        f"<td>{with_error(100.0 * mode.damping_ratio, 100.0 * mode.damping_se)}</td>"
        f"<td>{'trusted' if trusted else 'not trusted'}</td></tr>"
        for position, (mode, trusted) in enumerate(
            zip(summary.modes, summary.trusted, strict=True), start=1
        )
    )
    head = "<th>mode</th><th>frequency (Hz)</th><th>damping (%)</th><th></th>"
    return f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
