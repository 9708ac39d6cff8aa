"""A short method beside the chosen model, and what is said where it simulates better."""

from dataclasses import replace

import pytest
from records import output_error_record

from evopem.automatic.fit import FitSettings, fit
from evopem.automatic.folds import decide_folds, held_out_scores
from evopem.automatic.peer import against_peer
from evopem.models.structures import Orders
from evopem.signals.recording import Segment


def test_a_short_method_is_scored_on_the_same_samples():
    u, y, _ = output_error_record(600)
    stretches = [Segment(u, y)]
    plan, settings = decide_folds(stretches), FitSettings()
    model = fit(stretches, Orders(nb=2, nf=2, nk=1), settings).model
    scores = held_out_scores(stretches, plan, model, settings)
    about = against_peer(stretches, plan, "quadratic", "own", scores, False)
    own, peer = about.alternatives
    assert about.choice == own.name == "own"
    assert own.score == scores.simulation
    # Both leave the noise, 20 % of the noise-free output, on samples that neither has seen.
    assert peer.score == pytest.approx(own.score, rel=0.1)
    much_worse = replace(scores, simulation=50.0)
    about = against_peer(stretches, plan, "quadratic", "own", much_worse, False)
    assert about.choice == peer.name
    assert "clearly worse" in about.sentence
