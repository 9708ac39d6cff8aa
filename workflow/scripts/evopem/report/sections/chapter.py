"""The results beside those of the chapter, for the data set that stands in for its recording."""

from __future__ import annotations

from evopem.figures.view import PolynomialView, View
from evopem.report import chapter
from evopem.report.section import Material, Section


def _content(material: Material) -> dict[str, object]:
    return {"rows": chapter.compare_with_chapter(material.view.results)}


def _applies(view: View) -> bool:
    if not isinstance(view, PolynomialView):
        return False
    return chapter.stands_in_for_the_chapter(view.results.settings)


SECTION = Section("chapter", lambda _: "Comparison with the chapter", _content, _applies)
