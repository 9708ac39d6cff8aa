"""A short method beside the chosen model, and what is said where it simulates better."""

from dataclasses import replace

import pytest
from records import output_error_record

from evopem.automatic.candidates import Scorer
from evopem.automatic.fit import FitSettings
from evopem.automatic.held_out.folds import decide_folds
from evopem.automatic.subspace_comparison import with_subspace_estimate
from evopem.models.structures import Orders
from evopem.signals.recording import Segment


def test_a_short_method_is_scored_on_the_same_samples():
    u, y, _ = output_error_record(600)
    stretches = [Segment(u, y)]
    plan = decide_folds(stretches)
    scores = Scorer(stretches, plan, FitSettings()).candidate("oe", Orders(nb=2, nf=2, nk=1)).scores
    about = with_subspace_estimate(stretches, plan, "quadratic", "chosen", scores, False)
    chosen, estimate = about.alternatives
    assert about.choice == chosen.name == "chosen"
    assert chosen.score == scores.simulation
    # Both leave the noise, 20 % of the noise-free output, on samples that neither has seen.
    assert estimate.score == pytest.approx(chosen.score, rel=0.1)
    much_worse = replace(scores, simulation=50.0)
    about = with_subspace_estimate(stretches, plan, "quadratic", "chosen", much_worse, False)
    assert about.choice == estimate.name
    assert "clearly worse" in about.sentence
