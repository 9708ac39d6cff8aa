"""The report of one data set as an HTML page."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from markupsafe import Markup

from evopem.figures.registry import REPORT_FIGURES, ReportFigure
from evopem.report import chapter, equations, provenance
from evopem.report.downloads import Download, csv_download
from evopem.report.fit_table import constraint_rows, fit_sentences
from evopem.report.inline_svg import inline_svg
from evopem.report.mode_table import mode_rows
from evopem.report.sentences.about_model import frequency_response, modes, poles
from evopem.report.sentences.about_orders import delay, phases, stabilization
from evopem.report.sentences.about_recording import recording, transform_effects
from evopem.report.sentences.about_search import search
from evopem.report.sentences.about_spectrum import spectrum
from evopem.report.sentences.about_validation import (
    horizons,
    output_transformed,
    residuals,
    simulation,
)
from evopem.report.templates import environment
from evopem.results.dataset import DatasetResults

# Heading and sentences of each figure's section, in the order of the chapter.
SECTIONS: dict[str, tuple[str, Callable[[DatasetResults], list[str]]]] = {
    "record": ("Recording", recording),
    "spectrum": ("Spectrum of the output", spectrum),
    "delay": ("Delay", delay),
    "phases": ("Orders, in phases", phases),
    "poles_zeros": ("Poles and zeros", poles),
    "frequency_response": ("Frequency response", frequency_response),
    "residuals": ("Residuals", residuals),
    "simulation": ("Simulation", simulation),
    "horizons": ("Prediction over longer horizons", horizons),
    "stabilization": ("Stabilization over the orders", stabilization),
    "convergence": ("Search", search),
}


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
    """

    id: str
    title: str
    paragraphs: list[str]
    caption: str
    data: list[str]
    download: Download
    svg: Markup | None


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
        config_text=config_text,
        chapter_orders=chapter.ORDERS if stand_in else None,
        chapter_comparison=chapter.compare_with_chapter(results) if stand_in else [],
        modes=rows,
        mode_remarks=modes(results, rows),
        has_truth=bool(true_modes),
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
        output_transformed=output_transformed(results.model.transforms),
        effects=transform_effects(results.model.transforms),
        sections=[
            _section(figure, results, figures)
            for figure in REPORT_FIGURES
            if _applies(figure.name, results)
        ],
        candidates=results.candidates.to_dict("records"),
        provenance=provenance.terms(results, commit),
        stages=provenance.stages(results, wall_clock),
        command=provenance.command(commit),
    )


def _applies(name: str, results: DatasetResults) -> bool:
    """Whether a figure belongs to the structure: there may be no delay and no joint order."""
    needed = {"delay": "delay", "stabilization": "joint"}.get(name)
    return needed is None or needed in results.phases


def _section(figure: ReportFigure, results: DatasetResults, figures: Mapping[str, str]) -> Section:
    title, sentences = SECTIONS[figure.name]
    svg = figures.get(figure.name)
    return Section(
        id=figure.name,
        title=title,
        paragraphs=sentences(results),
        caption=figure.caption,
        data=figure.data_files,
        download=csv_download(figure.table(results), results.name, figure.name),
        svg=None if svg is None else inline_svg(svg, figure.name, figure.caption),
    )
