"""Figures in a page: the drawing, the table as a CSV file in a link, and the panels to zoom."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING
from urllib.parse import quote
from xml.etree import ElementTree

import pandas as pd
from markupsafe import Markup

from evopem.figures import CHARTS, style
from evopem.figures.chart import Chart
from evopem.figures.draw import draw
from evopem.figures.style import svg_text, thin_table
from evopem.report.templates import Context
from evopem.results.dataset import DatasetResults
from evopem.results.layout import FIGURES

if TYPE_CHECKING:
    from jinja2.environment import TemplateModule

SVG = "http://www.w3.org/2000/svg"
XLINK = "http://www.w3.org/1999/xlink"
LEFT_OUT = {f"{{{SVG}}}{tag}" for tag in ("metadata", "style", "script")}
# Each colour becomes a variable, so that the page can have a light and a dark theme.
VARIABLES = {
    colour: f"--figure-{role}"
    for role, colour in {**style.COLOURS, "grid": style.GRID, "paper": style.PAPER}.items()
}
# Keep the report below 3 MB, however long the recording and however many its channels.
MOST_ROWS, MOST_CELLS = 5000, 40_000
# What an address cannot hold as it is; ends of lines are replaced all at once.
ESCAPED = re.compile(r"[^\w.,+()/~\n-]+", re.ASCII)


def drawn_figure(
    chart: Chart,
    words: tuple[str, str, str],
    dataset: str,
    data: Sequence[str],
    svg: str = "",
    most_cells: int = MOST_CELLS,
) -> Context:
    """A chart by its id, title and caption, as ``parts.html.j2`` draws it.

    Its table is a CSV file in a link. ``data``: files that hold the whole of it.
    """
    name, title, caption = words
    panels = chart.page_form()
    # For an attribute in single quotes, in which the double quotes of JSON stay short.
    quoted = escape(json.dumps(panels, ensure_ascii=False), quote=False).replace("'", "&#39;")
    return {
        "id": name,
        "title": title,
        "caption": caption,
        "data": data,
        "download": csv_download(chart.table, dataset, name, most_cells),
        "svg": inline_svg(svg or svg_text(draw(chart)), name, caption),
        # What the page draws for a reader to zoom; empty where it does not.
        "panels": Markup(quoted) if panels else "",
        "columns": chart.columns,
    }


def drawn_figures(
    results: DatasetResults, drawings: Mapping[str, str], captions: TemplateModule, part: str
) -> dict[str, Context]:
    """The figures of a part of the report by name; `drawings` are SVG texts by name."""
    pictures = {}
    for name, figure in FIGURES.items():
        if figure.part == part and not (chart := CHARTS[name](results)).nothing:
            title, _, caption = str(getattr(captions, name)(results)).strip().partition("\n")
            # Responses of many pairs need many points.
            share = 2.0 if part in {"summary", "response"} else 1.0 if results.is_single else 0.5
            words, most = (name, title, caption), int(share * MOST_CELLS)
            pictures[name] = drawn_figure(
                *(chart, words, results.name, figure.data, drawings[name], most)
            )
    return pictures


def inline_svg(text: str, name: str, label: str) -> Markup:
    """A figure as an ``svg`` element without fixed size, metadata, scripts and repeated words.

    `name` makes its ids unique in the page; `label` describes it for screen readers.
    """
    ElementTree.register_namespace("", SVG)
    root = ElementTree.fromstring(text)
    names = dict.fromkeys(re.findall(r"#([\w-]+)", text))
    ids = {target: f"{name}-{place}" for place, target in enumerate(names)}
    for parent in list(root.iter()):
        parent[:] = [child for child in parent if child.tag not in LEFT_OUT]
    styles: dict[str, str] = {}
    for element in root.iter():
        for full_name, value in list(element.attrib.items()):
            attribute = full_name.removeprefix(f"{{{XLINK}}}")
            del element.attrib[full_name]
            if attribute == "style":
                element.set("class", styles.setdefault(value, f"s{len(styles)}"))
            elif attribute == "d":
                element.set("d", short_path(value))
            elif attribute == "id":
                element.attrib |= {"id": ids[value]} if value in ids else {}
            elif attribute == "href" and value.startswith("#"):
                element.set("href", f"#{ids[value[1:]]}")
            elif not attribute.lower().startswith("on"):
                element.set(attribute, re.sub(r"(?<=url\(#)[\w-]+", lambda at: ids[at[0]], value))
    for attribute in ("width", "height", "version"):
        root.attrib.pop(attribute, None)
    rules = "".join(f"#{name}-svg .{key}{{{value}}}" for value, key in styles.items())
    for colour, variable in VARIABLES.items():
        rules = rules.replace(colour, f"var({variable})")
    style = ElementTree.Element(f"{{{SVG}}}style")
    style.text = re.sub(r"([:;,]) ", r"\1", rules)
    root.insert(0, style)
    root.attrib |= {"id": f"{name}-svg", "role": "img", "aria-label": label}
    return Markup(re.sub(r">\s+<(?!/?tspan)", "><", ElementTree.tostring(root, encoding="unicode")))


def short_path(path: str) -> str:
    """A path in tenths of its unit, its lines relative to the point before."""
    if set(re.findall("[A-Za-z]", path)) - set("MLz"):
        return re.sub(r"\s*([A-Za-z])\s*", r"\1", path)
    words, last, (left, top) = "", "", (0, 0)
    for command, *place in re.findall(r"([MLz])\s*(?:([^\sMLz]+)\s+([^\sMLz]+))?", path):
        words += command.replace("L", "l") if command != last else " "
        if command != "z":
            x, y = (round(10.0 * float(number)) for number in place)
            step = (x, y) if command == "M" else (x - left, y - top)
            words += f"{step[0] / 10:g} {step[1] / 10:g}"
            left, top = x, y
        last = command
    return words.replace(" -", "-")


def csv_download(
    table: pd.DataFrame, dataset: str, figure: str, most_cells: int = MOST_CELLS
) -> Context:
    """Put a figure's table into a link, thinned where it is longer than :data:`MOST_ROWS`.

    Returns the name of the file, its ``data:`` address, its rows, and those of the whole table.
    """
    kept = thin_table(table, min(MOST_ROWS, most_cells // max(table.shape[1], 1)))
    text = kept.to_csv(index=False, float_format="%.6g", lineterminator="\n")
    return {
        "file": re.sub(r"[^\w.-]+", "_", f"{dataset}-{figure}.csv"),
        # Without escapes for commas and digits this is shorter than base64.
        "address": "data:text/csv;charset=utf-8,"
        + ESCAPED.sub(lambda at: quote(at[0]), text).replace("\n", "%0A"),
        "rows": len(kept),
        "rows_of": len(table),
    }
