"""The page that lays several models side by side."""

from __future__ import annotations

import json
from collections.abc import Mapping
from pathlib import Path

from evopem.figures.chart import Chart
from evopem.figures.comparison import compared_modes, compared_responses, compared_simulations
from evopem.figures.draw import draw
from evopem.figures.style import svg_text
from evopem.report.comparison_text import spread, validated_on
from evopem.report.downloads import csv_download
from evopem.report.inline_svg import inline_svg
from evopem.report.section import DrawnFigure
from evopem.report.sentences.about_verdict import verdict
from evopem.report.templates import environment
from evopem.results.comparison import Comparison
from evopem.validation.checks import failed_checks


def build_comparison(
    comparison: Comparison, template_directory: Path, pages: Mapping[str, str] | None = None
) -> str:
    """One HTML page that loads no other file; `pages` are addresses of reports by label."""
    return (
        environment(template_directory)
        .get_template("comparison.html.j2")
        .render(
            rows=list(zip(comparison.labels, comparison.results, strict=True)),
            verdicts={
                label: verdict(results).sentence
                for label, results in zip(comparison.labels, comparison.results, strict=True)
            },
            failed=[len(failed_checks(each.checks)) for each in comparison.results],
            remark=validated_on(comparison),
            sections=_sections(comparison),
            modes=[(each, spread(each)) for each in comparison.modes],
            checks=_checks(comparison),
            pages=pages or {},
        )
    )


def _checks(comparison: Comparison) -> dict[str, list[str]]:
    """The outcome of every check for each model, in words; empty where it has none."""
    outcomes = [{check.name: check.word for check in each.checks} for each in comparison.results]
    names = dict.fromkeys(name for outcome in outcomes for name in outcome)
    return {name: [outcome.get(name, "").lower() for outcome in outcomes] for name in names}


def _sections(comparison: Comparison) -> list[DrawnFigure]:
    charts = [
        (
            "responses",
            "Frequency responses",
            "Gain with 95 % bands, and phase.",
            compared_responses,
        ),
        (
            *("mode_map", "Modes"),
            "Modes with 95 % intervals; those with open marks are not to be trusted.",
            compared_modes,
        ),
    ]
    if comparison.has_same_validation:
        caption = "Validation samples; the drawing has the first of them."
        charts.insert(0, ("simulations", "Measured and simulated", caption, compared_simulations))
    return [
        _section(comparison, name, title, caption, chart(comparison))
        for name, title, caption, chart in charts
    ]


def _section(
    comparison: Comparison, name: str, title: str, caption: str, chart: Chart
) -> DrawnFigure:
    panels = chart.page_form()
    return DrawnFigure(
        id=name,
        title=title,
        paragraphs=[],
        caption=caption,
        data=["CSV of each data set"],
        download=csv_download(chart.table, "-".join(comparison.labels)[:80], name),
        svg=inline_svg(svg_text(draw(chart)), name, caption),
        panels=json.dumps(panels, ensure_ascii=False) if panels else "",
        columns=chart.columns,
        for_experts=False,
    )
