"""How structure and orders were chosen: decisions, scores, candidates, revisions."""

from __future__ import annotations

import math
from typing import Any

from evopem.automatic.decision import Decision
from evopem.automatic.record import OtherModel
from evopem.figures.view import View
from evopem.report.numbers import number
from evopem.report.section import Material, Section

# Alternatives that the table shows beside the choice: all structures of a choice of structures.
MOST_RIVALS = 8


def rivals(decision: Decision) -> str:
    """The best alternatives with their scores, the choice among them."""
    scored = [each for each in decision.alternatives if math.isfinite(each.score)]
    best = sorted(scored, key=lambda each: each.score)[: MOST_RIVALS + 1]
    chosen = next((each for each in scored if each.name == decision.choice), None)
    if chosen is not None and chosen not in best:
        best = [*best[:MOST_RIVALS], chosen]
    return "; ".join(f"{each.name}: {number(each.score, 4)}" for each in best)


def _content(material: Material) -> dict[str, Any]:
    view, record = material.view, material.view.results.decisions
    content = {
        "figures": material.figures_of("selection"),
        "remarks": _absolute(view),
        "candidates": [] if view.candidates is None else view.candidates.to_dict("records"),
        "decisions": [],
        "purposes": [],
        "trials": (),
    }
    if record is None:
        return content
    validation = view.results.validation
    model = OtherModel(
        *(record.purpose, view.model_text),
        *(validation.prediction_error_percent, validation.simulation_error_percent),
    )
    return content | {
        "remarks": [
            " ".join([f"The model is for {record.purpose}.", *record.remarks]),
            *_absolute(view),
        ],
        "decisions": [(each, rivals(each)) for each in record.decisions],
        "purposes": [model, record.other] if record.other else [],
        "trials": record.trials,
    }


def _absolute(view: View) -> list[str]:
    model = view.results.model
    if model.search.settings.objective != "absolute":
        return []
    weight = "power" if model.weighting == "power" else "noise"
    several = f", each output weighed by its {weight}," if len(view.outputs) > 1 else ""
    return [
        f"Sums of absolute errors{several} are minimised, and errors on other parts are mean"
        " absolute ones: outliers hardly change either."
    ]


def _title(view: View) -> str:
    chosen = "the orders" if view.results.decisions is None else "structure and orders"
    return f"Choice of {chosen}"


SECTION = Section("selection", _title, _content)
