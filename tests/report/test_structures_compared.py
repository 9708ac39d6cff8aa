"""The table of structures: the best score of each by every criterion."""

import math
from dataclasses import replace

import pytest

from evopem.automatic.decision import Alternative, Decision
from evopem.automatic.record import DecisionRecord, OtherModel
from evopem.report.sections.selection import structure_table


def decision(purpose, criterion, **scores):
    alternatives = [
        Alternative(f"{structure} nk={number}", score)
        for structure, values in scores.items()
        for number, score in enumerate(values)
    ]
    subject = f"structure for {purpose}"
    return Decision(subject, alternatives[0].name, tuple(alternatives), criterion, "So.")


def decided(results, *decisions):
    other = OtherModel("prediction", "ARX(1,1,1)", 5.0, 9.0)
    return replace(results, decisions=DecisionRecord("simulation", decisions, (), (), (), other))


def test_each_structure_has_its_best_score(results):
    errors = decision("simulation", "error, %", armax=[9.0, 7.0], oe=[5.0], fir=[math.nan])
    table = structure_table(
        decided(results, errors, decision("modes", "BIC", armax=[-1.0], oe=[0.5, -0.5]))
    )
    assert table.criteria == ("error, %", "BIC")
    rows = [(row.structure, row.scores, row.selected) for row in table.rows]
    assert rows == [("OE", (5.0, -0.5), False), ("ARMAX", (7.0, -1.0), True)]


@pytest.mark.parametrize("given", [(), (decision("simulation", "error, %", oe=[5.0, 4.0]),)])
def test_one_structure_alone_is_no_comparison(results, given):
    assert structure_table(decided(results, *given)) is None
    assert structure_table(replace(results, decisions=None)) is None


def test_the_page_has_the_table(results, build):
    errors = decision("simulation", "error, %", armax=[7.0], oe=[5.0])
    *_, last = results.phases.values()
    phases = {**results.phases, "structures": results.phases["joint"], "chosen": last}
    page = build(replace(decided(results, errors), phases=phases))
    assert 'data-name="Structures compared"' in page
    assert "<strong>ARMAX</strong>" in page
    assert "Choice of structure and orders" in page
