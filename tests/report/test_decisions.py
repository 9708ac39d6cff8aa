"""The decisions of the automatic recipe on the page."""

import math
from dataclasses import replace

import pytest
from by_scores import chosen_by_scores

from evopem.automatic.decision import Alternative, Decision, DecisionRecord, OtherModel
from evopem.report.page_sections import MOST_RIVALS, phase_decision, rivals


def decision(choice, **scores):
    alternatives = tuple(Alternative(name, score) for name, score in scores.items())
    return Decision("structure for simulation", choice, alternatives, "error, %", "So.")


def test_the_best_alternatives_and_the_choice_are_listed():
    assert rivals(decision("oe", armax=7.0, oe=5.0, fir=math.nan)) == "oe: 5; armax: 7"
    many = {f"arx{k}": float(k) for k in range(20)}
    shown = rivals(decision("arx19", **many)).split("; ")
    assert len(shown) == MOST_RIVALS + 1
    assert shown[-1] == "arx19: 19"


def test_the_page_tells_the_decisions_and_the_other_model(results, build):
    other = OtherModel("prediction", "ARX(1,1,1)", 5.0, 9.0)
    chosen = decision("armax", armax=7.0, oe=5.0)
    record = DecisionRecord("simulation", (chosen,), (), (), ("It drifts.",), other)
    page = build(chosen_by_scores(results, record))
    assert "The model is for simulation. It drifts." in page
    assert "oe: 5; armax: 7" in page
    assert "model.prediction.json" in page
    assert "Choice of structure and orders" in page


def test_each_phase_of_an_order_search_is_a_decision_among_its_candidates(results, build):
    phase = replace(results.phases["nc"], reason="It is best (-3.1), ARMAX-like.")
    decided = phase_decision(phase)
    assert decided.sentence == "It is best (−3.1), ARMAX-like."
    scores = {each.name: each.score for each in decided.alternatives}
    assert len(scores) == len(phase.candidates) == 4
    assert decided.choice == str(phase.orders) == min(scores, key=scores.get)
    of_delay = phase_decision(results.phases["delay"])
    assert of_delay.choice == "nk = 3"
    tried = results.candidates[results.candidates["phase"] == "delay"]
    means = {f"nk = {nk}": rows["bic"].mean() for nk, rows in tried.groupby("nk")}
    assert {each.name: each.score for each in of_delay.alternatives} == pytest.approx(means)
    assert min(means, key=means.get) == of_delay.choice
    assert decided.choice in build(results)
