"""The parts of the report, one module each: when it applies, what it is called, what it shows.

The template ``section_<id>.html.j2`` of a part sets its content.
"""

from evopem.report.sections import (
    chapter,
    errors,
    model,
    modes,
    provenance,
    recording,
    residual_tests,
    response,
    selection,
    summary,
)

SECTIONS = (
    summary.SECTION,
    model.SECTION,
    modes.SECTION,
    response.SECTION,
    errors.SECTION,
    residual_tests.SECTION,
    recording.SECTION,
    selection.SECTION,
    chapter.SECTION,
    provenance.SECTION,
)
"""The parts in the order of the page."""

__all__ = ["SECTIONS"]
