"""How structure and orders were chosen: decisions, scores, candidates, revisions."""

from __future__ import annotations

from typing import Any

from evopem.estimation.multichannel_record import MultichannelModelRecord
from evopem.figures.view import ChannelsView, PolynomialView, View
from evopem.report.section import Material, Section
from evopem.report.sentences.about_decisions import (
    about_decisions,
    decision_rows,
    purpose_rows,
    structure_table,
)


def _content(material: Material) -> dict[str, Any]:
    view, results = material.view, material.view.results
    content = {
        "figures": material.figures_of("selection"),
        "decisions": decision_rows(results),
        "purposes": purpose_rows(view),
        "structures": None,
        "candidates": [],
    }
    if isinstance(view, ChannelsView):
        remedies = results.decisions.remedies
        return content | {
            "remarks": [*_absolute(results.model), *remedies.statements],
            "trials": remedies.trials,
            "without": "without a global search of its own",
        }
    assert isinstance(view, PolynomialView)
    return content | {
        "remarks": about_decisions(results),
        "trials": results.decisions.trials if results.decisions else (),
        "without": "without revisions and without a global search of its own",
        "structures": structure_table(results),
        "candidates": results.candidates.to_dict("records"),
    }


def _absolute(model: MultichannelModelRecord) -> list[str]:
    if model.settings.objective != "absolute":
        return []
    weight = "power" if model.weighting == "power" else "noise"
    return [
        f"Sums of absolute errors are minimised, each output weighed by its {weight}, and errors on"
        " other parts are mean absolute ones: outliers hardly change either."
    ]


def _title(view: View) -> str:
    if isinstance(view, PolynomialView) and view.results.decisions is None:
        return "Choice of the orders"
    return "Choice of structure and orders"


SECTION = Section("selection", _title, _content)
