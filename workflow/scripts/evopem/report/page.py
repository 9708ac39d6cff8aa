"""Building the pages: contents and readings set into the templates."""

from __future__ import annotations

import hashlib
from base64 import b64encode
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from evopem.figures.registry import FIGURES
from evopem.report import equations, numbers, provenance, report_text
from evopem.report.contents import Contents, read_contents
from evopem.report.downloads import csv_download
from evopem.report.inline_svg import inline_svg
from evopem.report.mode_table import CHAPTER, CHAPTER_ORDERS, mode_rows
from evopem.results.dataset import read_results
from evopem.results.fleet import Summary

if TYPE_CHECKING:
    from jinja2 import Environment

    from evopem.results.dataset import Results

# Figure, heading, paragraphs: the story in the chapter's order.
STORY = (
    ("record", "The record", report_text.record),
    ("spectrum", "Spectrum of the output", report_text.spectrum),
    ("delay", "Delay", report_text.delay),
    ("phases", "Orders, in three phases", report_text.phases),
    ("poles_zeros", "Poles and zeros", report_text.poles),
    ("frequency_response", "Frequency response", report_text.frequency_response),
    ("residuals", "Residuals", report_text.residuals),
    ("simulation", "Simulation", report_text.simulation),
    ("stabilization", "Stabilization over the orders", report_text.stabilization_reading),
    ("convergence", "The search", report_text.search),
)


def build_report(
    paths: Mapping[str, Path],
    template_directory: Path,
    dataset: str | None = None,
    commit: str = "unknown",
) -> str:
    """Build the report on one data set.

    Parameters
    ----------
    paths : mapping of str to Path
        Result files by their names relative to the data set's directory, such as ``model.json``,
        ``phases/delay.json`` or ``figures/record.svg``.
    template_directory : Path
        Where ``report.html.j2`` and its parts are.
    dataset : str, optional
        The data set's name; by default its key in ``config.yaml``.
    commit : str
        Commit of the workflow that writes the report.

    Returns
    -------
    str
        One HTML page that needs no other file.

    Raises
    ------
    InputError
        When a required file is missing or damaged.
    """
    contents = read_contents(paths, dataset)
    page = environment(template_directory).get_template("report.html.j2")
    return page.render(_report_values(contents, read_results(paths), commit))


def build_index(
    summaries: Mapping[str, Summary], template_directory: Path, page: str = "report.html"
) -> str:
    """Build the table over several data sets, the worst first.

    Parameters
    ----------
    summaries : mapping of str to mapping
        Summary of each data set, as `evopem.results.fleet.read_summaries` gives it, by its name.
    template_directory : Path
        Where ``index.html.j2`` is.
    page : str
        File that each row links to, in the folder of its data set.

    Returns
    -------
    str
        One HTML page.
    """
    rows = [_index_row(name, summary, page) for name, summary in summaries.items()]
    rows.sort(key=lambda row: (row["rank"], row["severity"], row["name"]))
    return environment(template_directory).get_template("index.html.j2").render(rows=rows)


def _index_row(name: str, summary: Summary, page: str) -> dict[str, Any]:
    verdicts = summary.get("checks", {})
    error = summary.get("simulation_error_percent")
    failed = sum(passed is False for passed in verdicts.values())
    unjudged = sum(passed is None for passed in verdicts.values())
    problem = summary.get("problem")
    return {
        "name": name,
        "href": f"{quote(name, safe='')}/{'logs/' if problem else page}",
        "problem": problem,
        "orders": report_text.orders_text(summary["orders"]) if "orders" in summary else "",
        "prediction": summary.get("prediction_error_percent"),
        "simulation": error,
        "rank": (problem is None, -failed, -unjudged),
        "severity": -error if numbers.is_number(error) else -float("inf"),
        "passed": sum(passed is True for passed in verdicts.values()),
        "failed": failed,
        "open": unjudged,
        "concerns": [check for check, passed in verdicts.items() if passed is not True],
    }


def environment(template_directory: Path) -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(template_directory),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters.update(
        number=numbers.number,
        fixed=numbers.fixed,
        percent=numbers.percent,
        count=numbers.count,
        raw=numbers.raw,
    )
    environment.globals.update(
        with_error=numbers.with_error,
        root=numbers.root,
        is_number=numbers.is_number,
        orders_text=report_text.orders_text,
        hertz=report_text.hertz,
        script=_script(template_directory / "page.js"),
    )
    return environment


def _script(file: Path) -> dict[str, str]:
    """The page's only script, and the digest by which the page's policy allows it to run."""
    text = file.read_text(encoding="utf-8")
    digest = b64encode(hashlib.sha256(text.encode()).digest()).decode()
    return {"text": text, "digest": f"sha256-{digest}"}


def _report_values(contents: Contents, results: Results, commit: str) -> dict[str, Any]:
    """Everything the report's template shows."""
    model, truth = contents.model, contents.truth
    verdicts = contents.checks
    captions = {entry.name: entry for entry in FIGURES}
    sections = [
        {
            "id": name,
            "title": title,
            "paragraphs": read(contents),
            "caption": captions[name].caption,
            "data": captions[name].data,
            "download": csv_download(captions[name].table(results), contents.dataset, name),
            "svg": _figure(contents, name, captions[name].caption),
        }
        for name, title, read in STORY
    ]
    true_modes = list((truth or {}).get("modes") or [])
    rows = mode_rows(model.get("modes") or [], true_modes, CHAPTER if contents.is_stand_in else [])
    return {
        "contents": contents,
        "model": model,
        "validation": contents.validation,
        "truth": truth,
        "is_stand_in": contents.is_stand_in,
        "chapter_orders": CHAPTER_ORDERS,
        "modes": rows,
        "mode_remarks": report_text.modes(contents, rows),
        "has_truth": bool(true_modes),
        "polynomials": equations.polynomials(model),
        "difference_equation": equations.difference_equation(model),
        "coefficients": equations.coefficient_table(model),
        "copies": [
            ("text", "Plain text", equations.text(model)),
            ("matlab", "MATLAB", equations.matlab(model)),
            ("python", "Python", equations.python(model)),
            ("json", "JSON", equations.as_json(model)),
        ],
        "checks": verdicts,
        "passed": [check for check in verdicts if check.passed is True],
        "failed": [check for check in verdicts if check.passed is False],
        "unjudged": [check for check in verdicts if check.passed is None],
        "effects": report_text.transform_effects(contents.transforms),
        "sections": sections,
        "beside_chapter": report_text.beside_chapter(contents) if contents.is_stand_in else [],
        "candidates": contents.candidates.to_dict("records"),
        "provenance": provenance.terms(contents, commit),
        "stages": provenance.stages(contents),
        "command": provenance.command(commit),
    }


def _figure(contents: Contents, name: str, caption: str) -> Any:
    text = contents.figures.get(name)
    return None if text is None else inline_svg(text, name, caption)
