"""How structure and orders were chosen: decisions, scores, candidates, revisions."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from evopem.automatic.decision import Decision
from evopem.automatic.record import OtherModel
from evopem.estimation.model_record import ModelRecord
from evopem.figures.view import ChannelsView, PolynomialView, Results, View
from evopem.report.numbers import number
from evopem.report.section import Material, Section
from evopem.results.dataset import DatasetResults

# Alternatives that the table shows beside the choice.
MOST_RIVALS = 3


@dataclass(frozen=True)
class DecisionRow:
    """One row of the table of decisions."""

    subject: str
    choice: str
    rivals: str
    criterion: str
    sentence: str


@dataclass(frozen=True)
class PurposeRow:
    """A model, what it is for, and its errors on the validation samples in percent."""

    purpose: str
    file: str
    model: str
    prediction_error_percent: float
    simulation_error_percent: float

    @classmethod
    def of(cls, other: OtherModel) -> PurposeRow:
        """The row of the model for another purpose."""
        return cls(
            *(other.purpose, f"model.{other.purpose}.json", other.model),
            *(other.prediction_error_percent, other.simulation_error_percent),
        )


def purpose_rows(view: View) -> list[PurposeRow]:
    """The model and the one for another purpose; empty for the chapter's recipe."""
    record = view.results.decisions
    if record is None or record.other is None:
        return []
    validation = view.results.validation
    return [
        PurposeRow(
            *(record.purpose, "model.json", view.model_text),
            *(validation.prediction_error_percent, validation.simulation_error_percent),
        ),
        PurposeRow.of(record.other),
    ]


def decision_rows(results: Results) -> list[DecisionRow]:
    """All decisions in their order; empty for the chapter's recipe."""
    record = results.decisions
    return [] if record is None else [decision_row(each) for each in record.decisions]


def about_decisions(results: DatasetResults) -> list[str]:
    """What the decisions led to, and what no remedy helped against."""
    record = results.decisions
    if record is None:
        return []
    return [" ".join([f"The model is for {record.purpose}.", *record.remarks])]


@dataclass(frozen=True)
class StructureScores:
    """The best scores of one structure."""

    structure: str
    scores: tuple[float, ...]  # by the criteria of :class:`StructureTable`; NaN where there is none
    selected: bool


@dataclass(frozen=True)
class StructureTable:
    """The structures side by side."""

    criteria: tuple[str, ...]
    rows: tuple[StructureScores, ...]  # by the first criterion


def structure_table(results: DatasetResults) -> StructureTable | None:
    """The best model of every structure by each criterion; None where fewer than two were tried."""
    if results.decisions is None:
        return None
    compared = [
        each for each in results.decisions.decisions if each.subject.startswith(_STRUCTURE_FOR)
    ]
    best = [_best_of_structures(each) for each in compared]
    structures = {structure for scores in best for structure in scores}
    if len(structures) < 2:
        return None
    selected = results.model.structure
    rows = [
        StructureScores(
            structure.upper(),
            tuple(scores.get(structure, math.nan) for scores in best),
            structure == selected,
        )
        for structure in structures
    ]
    rows.sort(key=_rank)
    return StructureTable(tuple(each.criterion for each in compared), tuple(rows))


_STRUCTURE_FOR = "structure for "


def _rank(row: StructureScores) -> tuple[list[float], str]:
    return [math.inf if math.isnan(each) else each for each in row.scores], row.structure


def _best_of_structures(decision: Decision) -> dict[str, float]:
    """The lowest score of each structure among the alternatives, whose names begin with it."""
    best: dict[str, float] = {}
    for each in decision.alternatives:
        structure = each.name.split()[0]
        if math.isfinite(each.score):
            best[structure] = min(each.score, best.get(structure, math.inf))
    return best


def decision_row(decision: Decision) -> DecisionRow:
    """A decision with its best rivals."""
    scored = [each for each in decision.alternatives if math.isfinite(each.score)]
    rivals = sorted(scored, key=lambda each: each.score)[: MOST_RIVALS + 1]
    own = next((each for each in scored if each.name == decision.choice), None)
    if own is not None and own not in rivals:
        rivals = [*rivals[:MOST_RIVALS], own]
    shown = "; ".join(f"{each.name}: {number(each.score, 4)}" for each in rivals)
    return DecisionRow(
        decision.subject, decision.choice, shown, decision.criterion, decision.sentence
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
        return content | {
            "remarks": [*_absolute(results.model), *results.decisions.remarks],
            "trials": results.decisions.trials,
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


def _absolute(model: ModelRecord) -> list[str]:
    if model.search.settings.objective != "absolute":
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
