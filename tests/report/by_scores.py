"""Results of the chapter's recipe, as if the automatic one had chosen among candidates."""

from dataclasses import replace

import pandas as pd

from evopem.automatic.candidates import Candidate, StructureSearch
from evopem.automatic.cross_validation.folds import HeldOutScores
from evopem.automatic.decision import Decision
from evopem.automatic.revisions import Revised
from evopem.automatic.structures import Choice


def chosen_by_scores(results, record, tried=2):
    """The same results with the decisions of a record and so many candidates."""
    model = results.model.polynomials
    scores = HeldOutScores(7.0, 7.0, 5.0)
    candidate = Candidate(
        *(model.structure, model.orders.plant, model.orders.nk, 10, 0.5, 0.5, scores, model)
    )
    search = StructureSearch(
        model.structure, (candidate,), Decision("orders", candidate.name, (), "BIC", "")
    )
    rows = [
        ("order", model.structure, number + 1, candidate.name, 0.5, 7.0, number == 0)
        for number in range(tried)
    ]
    columns = ["step", "structure", "order", "model", "bic", "simulation_error_percent", "selected"]
    return replace(
        results,
        decisions=record,
        phases={},
        searches=(search,),
        revised=Revised(Choice("simulation", candidate, "constant"), (), (), ()),
        candidates=pd.DataFrame(rows, columns=columns),
    )
