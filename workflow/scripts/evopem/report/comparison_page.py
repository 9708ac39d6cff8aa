"""The page that lays several models side by side."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from evopem.figures.comparison import (
    compared_responses_table,
    compared_simulations_table,
    draw_compared_modes,
    draw_compared_responses,
    draw_compared_simulations,
    simulated_column,
)
from evopem.figures.frequency_domain import plant_or_noise_filter
from evopem.figures.panels import (
    FREQUENCY,
    VALIDATION_TIME,
    Curve,
    Panel,
    Role,
    as_json_form,
    gain_unit,
    output_label,
)
from evopem.figures.style import svg_text, with_unit
from evopem.report.comparison_text import spread, validated_on
from evopem.report.downloads import csv_download
from evopem.report.inline_svg import inline_svg
from evopem.report.page import Section
from evopem.report.sentences.about_verdict import verdict
from evopem.report.templates import environment
from evopem.results.comparison import Comparison

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

# The roles of the colours of `evopem.figures.style.FAMILY`.
ROLES: tuple[Role, ...] = ("model", "error", "truth", "fourth", "fifth", "muted")


def build_comparison(
    comparison: Comparison, template_directory: Path, pages: Mapping[str, str] | None = None
) -> str:
    """Build the page of a comparison.

    Parameters
    ----------
    comparison : Comparison
    template_directory : Path
        Folder of ``comparison.html.j2`` and what it includes.
    pages : mapping of str to str, optional
        Addresses of the reports, by the labels of the models.

    Returns
    -------
    str
        One HTML page that loads no other file.
    """
    sections = [_responses(comparison), _modes(comparison)]
    if comparison.has_same_validation:
        sections.insert(0, _simulations(comparison))
    return (
        environment(template_directory)
        .get_template("comparison.html.j2")
        .render(
            rows=list(zip(comparison.labels, comparison.results, strict=True)),
            verdicts={
                label: verdict(results).sentence
                for label, results in zip(comparison.labels, comparison.results, strict=True)
            },
            remark=validated_on(comparison),
            sections=sections,
            modes=[(each, spread(each)) for each in comparison.modes],
            checks=_checks(comparison),
            pages=pages or {},
        )
    )


def _checks(comparison: Comparison) -> dict[str, list[str]]:
    """The outcome of every check for each model, in words; empty where it has none."""
    words = {True: "passed", False: "failed", None: "not judged"}
    outcomes = [{check.name: check.passed for check in each.checks} for each in comparison.results]
    names = dict.fromkeys(name for outcome in outcomes for name in outcome)
    return {
        name: [words[outcome[name]] if name in outcome else "" for outcome in outcomes]
        for name in names
    }


def _responses(comparison: Comparison) -> Section:
    def curves(column: str, **options: bool | str | tuple[str, ...]) -> tuple[Curve, ...]:
        return tuple(
            Curve(label, column, role, where=("model", str(number)), **options)  # type: ignore[arg-type]
            for number, (label, role) in enumerate(
                zip(comparison.labels, ROLES, strict=False), start=1
            )
        )

    units = {gain_unit(results) for results in comparison.results}
    unit = units.pop() if len(units) == 1 else ""
    gains = [
        gain
        for results in comparison.results
        for gain in plant_or_noise_filter(results.frequency_response)[0]["gain"]
        if gain > 0
    ]
    panels = [
        Panel(
            *("", "frequency_hz", FREQUENCY, with_unit("Gain", unit)),
            curves("gain", band=("gain_lower", "gain_upper")),
            logarithmic=True,
            limits=(min(gains) / 4, max(gains) * 4) if gains else (),
            height=280,
            linked="frequency",
        ),
        Panel(
            *("", "frequency_hz", FREQUENCY, "Phase (°)", curves("phase_deg", kind="points")),
            wrapped=True,
            limits=(-190, 190),
            height=170,
            linked="frequency",
        ),
    ]
    return _section(
        comparison,
        *("responses", "Frequency responses", "Gain with 95 % bands, and phase."),
        draw_compared_responses(comparison),
        compared_responses_table(comparison),
        panels,
    )


def _simulations(comparison: Comparison) -> Section:
    curves = [
        Curve("measured", "output", "ink"),
        *(
            Curve(label, simulated_column(number), role, dashed=True)
            for number, (label, role) in enumerate(
                zip(comparison.labels, ROLES, strict=False), start=1
            )
        ),
    ]
    panel = Panel(
        *("", "time_s", VALIDATION_TIME, output_label(comparison.results[0]), tuple(curves)),
        height=280,
    )
    return _section(
        comparison,
        *("simulations", "Measured and simulated"),
        "Validation samples; the drawing has the first of them.",
        draw_compared_simulations(comparison),
        compared_simulations_table(comparison),
        [panel],
    )


def _modes(comparison: Comparison) -> Section:
    caption = "Modes with 95 % intervals; those with open marks are not to be trusted."
    return _section(
        comparison,
        *("mode_map", "Modes", caption),
        draw_compared_modes(comparison),
        comparison.mode_table,
        [],
    )


def _section(
    comparison: Comparison,
    name: str,
    title: str,
    caption: str,
    figure: Figure,
    table: pd.DataFrame,
    panels: Sequence[Panel],
) -> Section:
    return Section(
        id=name,
        title=title,
        paragraphs=[],
        caption=caption,
        data=["CSV of each data set"],
        download=csv_download(table, "-".join(comparison.labels)[:80], name),
        svg=inline_svg(svg_text(figure), name, caption),
        panels=json.dumps(as_json_form(panels), ensure_ascii=False) if panels else "",
        for_experts=False,
    )
