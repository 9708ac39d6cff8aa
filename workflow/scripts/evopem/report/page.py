"""The report of one data set as an HTML page."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from evopem.figures.panels import as_json_form
from evopem.figures.registry import REPORT_FIGURES, ReportFigure
from evopem.report import chapter, equations, provenance
from evopem.report.downloads import Download, csv_download
from evopem.report.fit_table import constraint_rows, fit_sentences
from evopem.report.inline_svg import inline_svg
from evopem.report.mode_table import mode_rows
from evopem.report.sentences.about_decisions import (
    about_decisions,
    decision_rows,
    purpose_rows,
    structure_table,
)
from evopem.report.sentences.about_model import (
    frequency_response,
    mode_lines,
    modes,
    poles,
)
from evopem.report.sentences.about_orders import delay, phases, stabilization
from evopem.report.sentences.about_recording import recording, transform_effects
from evopem.report.sentences.about_search import search
from evopem.report.sentences.about_spectrum import spectrum
from evopem.report.sentences.about_validation import horizons, residuals, simulation
from evopem.report.sentences.about_verdict import verdict
from evopem.report.templates import environment
from evopem.results.dataset import DatasetResults


def nothing(_: DatasetResults) -> list[str]:
    """No sentences, where the figure and its caption say all."""
    return []


# Heading and sentences of each figure.
SECTIONS: dict[str, tuple[str, Callable[[DatasetResults], list[str]]]] = {
    "measured_and_simulated": ("Measured and simulated", nothing),
    "gain": ("Gain over the data", nothing),
    "poles_zeros": ("Poles and zeros", poles),
    "stabilization": ("Stabilization over the orders", stabilization),
    "frequency_response": ("Frequency response", frequency_response),
    "step_and_impulse": ("Step and impulse", nothing),
    "nyquist": ("Nyquist diagram", nothing),
    "simulation": ("Simulation", simulation),
    "simulation_as_recorded": ("In recorded units", nothing),
    "horizons": ("Prediction over longer horizons", horizons),
    "residuals": ("Correlation of the residuals", residuals),
    "residual_spectrum": ("Spectrum of the residuals", nothing),
    "record": ("Signals", recording),
    "spectrum": ("Spectrum of the output", spectrum),
    "delay": ("Delay", delay),
    "phases": ("Orders, in phases", phases),
    "convergence": ("Search of the selected model", search),
}
# Headings that are others for a model without input.
WITHOUT_INPUT = {
    "measured_and_simulated": "Measured and predicted",
    "gain": "Gain of the noise filter",
    "step_and_impulse": "Impulse response",
    "simulation": "Prediction",
    "residuals": "Autocorrelation of the residuals",
    "response": "Noise filter",
    "errors": "Prediction",
}
# Headings that are others for the automatic recipe.
AUTOMATIC = {"selection": "Choice of structure and orders", "phases": "Structures and orders"}
# The parts of the page after the verdict.
CONTENTS = (
    ("model", "Model"),
    ("modes", "Modes"),
    ("response", "Response to the input"),
    ("errors", "Prediction and simulation"),
    ("residual_tests", "Residuals"),
    ("recording", "Recording"),
    ("selection", "Choice of the orders"),
    ("chapter", "Comparison with the chapter"),
    ("provenance", "Provenance"),
)
# Figures whose sentences are for experts and wait to be opened.
FOR_EXPERTS = frozenset(SECTIONS) - {"stabilization"}


@dataclass(frozen=True)
class Section:
    """A section of the page with its figure.

    Attributes
    ----------
    id, title : str
    paragraphs : list of str
    caption : str
    data : list of str
        Files that hold the data of the figure.
    download : Download
        The data of the figure as CSV.
    svg : Markup, optional
        None where the figure was not drawn.
    panels : str
        What the page draws for a reader to zoom, as JSON; empty where it does not.
    for_experts : bool
        Whether the paragraphs wait to be opened.
    """

    id: str
    title: str
    paragraphs: list[str]
    caption: str
    data: list[str]
    download: Download
    svg: Markup | None
    panels: str
    for_experts: bool


def build_report(
    results: DatasetResults,
    figures: Mapping[str, str],
    wall_clock: Mapping[str, float],
    config_text: str,
    template_directory: Path,
    commit: str = "unknown",
) -> str:
    """Build the report of one data set.

    Parameters
    ----------
    results : DatasetResults
    figures : mapping of str to str
        SVG texts by the names of the figures.
    wall_clock : mapping of str to float
        Seconds by stage, as :func:`.wall_clock.read_wall_clock` returns them.
    config_text : str
        The complete configuration of the data set.
    template_directory : Path
        Folder of ``report.html.j2`` and what it includes.
    commit : str
        Commit of the workflow that writes the report.

    Returns
    -------
    str
        One HTML page that loads no other file.
    """
    page = environment(template_directory).get_template("report.html.j2")
    model, checks = results.model.model, results.checks
    stand_in = chapter.stands_in_for_the_chapter(results.settings)
    true_modes = results.truth.modes if results.truth else ()
    rows = mode_rows(results.model.modes, true_modes, chapter.MODES if stand_in else ())
    return page.render(
        results=results,
        contents=_contents(results, stand_in),
        config_text=config_text,
        chapter_orders=chapter.ORDERS if stand_in else None,
        chapter_comparison=chapter.compare_with_chapter(results) if stand_in else [],
        modes=rows,
        mode_remarks=modes(results, rows),
        has_truth=bool(true_modes),
        has_input=model.has_input,
        equation=equations.equation(model),
        orders_note=equations.orders_note(model),
        polynomials=equations.polynomials(model),
        difference_equation=equations.difference_equation(model),
        coefficients=equations.coefficient_table(model),
        copies=[
            ("text", "Plain text", equations.text(model)),
            ("matlab", "MATLAB", equations.matlab(model)),
            ("python", "Python", equations.python(model)),
            ("json", "JSON", equations.as_json(model)),
        ],
        constraints=constraint_rows(results.model.fit),
        fit_sentences=fit_sentences(results.model.fit),
        checks=checks,
        passed=[check for check in checks if check.passed is True],
        failed=[check for check in checks if check.passed is False],
        not_judged=[check for check in checks if check.passed is None],
        verdict=verdict(results),
        evidence=mode_lines(results),
        output_transformed=results.model.transforms.changes_output,
        effects=transform_effects(results.model.transforms),
        sections={
            figure.name: _section(figure, results, figures)
            for figure in REPORT_FIGURES
            if figure.applies(results)
        },
        candidates=results.candidates.to_dict("records"),
        decisions=decision_rows(results),
        trials=results.decisions.trials if results.decisions else (),
        decision_remarks=about_decisions(results),
        purposes=purpose_rows(results),
        structures=structure_table(results),
        provenance=provenance.terms(results, commit),
        stages=provenance.stages(results, wall_clock),
        command=provenance.command(commit),
    )


def _contents(results: DatasetResults, stand_in: bool) -> dict[str, str]:
    """Headings of the parts of the page, by their ids."""
    return {
        part: _heading(part, title, results)
        for part, title in CONTENTS
        if stand_in or part != "chapter"
    }


def _heading(name: str, title: str, results: DatasetResults) -> str:
    if results.decisions is not None:
        title = AUTOMATIC.get(name, title)
    return title if results.model.model.has_input else WITHOUT_INPUT.get(name, title)


def _section(figure: ReportFigure, results: DatasetResults, figures: Mapping[str, str]) -> Section:
    title, sentences = SECTIONS[figure.name]
    caption = figure.caption_of(results)
    svg, panels = figures.get(figure.name), figure.panels(results)
    return Section(
        id=figure.name,
        title=_heading(figure.name, title, results),
        paragraphs=sentences(results),
        caption=caption,
        data=figure.data_files,
        download=csv_download(figure.table(results), results.name, figure.name),
        svg=None if svg is None else inline_svg(svg, figure.name, caption),
        panels=json.dumps(as_json_form(panels), ensure_ascii=False) if panels and svg else "",
        for_experts=figure.name in FOR_EXPERTS,
    )
