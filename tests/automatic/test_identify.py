"""The automatic recipe as a whole, against known truths."""

import numpy as np
import pytest
from records import error_percent, output_error_record
from scipy.signal import lfilter

from evopem.automatic.candidates import Scorer, StructureSearch
from evopem.automatic.decision import Decision
from evopem.automatic.fit import FitSettings
from evopem.automatic.held_out.folds import FoldPlan, decide_folds
from evopem.automatic.held_out.repetition import decide_repetition
from evopem.automatic.held_out.simulation import simulated
from evopem.automatic.identify import identify
from evopem.automatic.structures import Choice, compare_structures
from evopem.errors import InputError
from evopem.estimation.estimate import estimate
from evopem.files.json_form import from_json, to_json
from evopem.models.structures import Orders
from evopem.signals.recording import Recording, Segment

SAMPLES = 120
ABOUT = Decision("folds", "given", (), "none", "They are given.")


@pytest.fixture(scope="module")
def resonance():
    u, y, truth = output_error_record(300)
    return identify(u[:SAMPLES] + 4.0, y[:SAMPLES] + 9.0, 10.0), u, y, truth


def test_the_model_simulates_unseen_samples_as_well_as_the_true_structure_does():
    """In the geometric mean of five records: which models come close to the truth is chance."""
    ratios = []
    for seed in range(3, 8):
        u, y, truth = output_error_record(300, seed=seed)
        given, held_out = slice(SAMPLES), slice(SAMPLES, None)
        found = identify(u[given] + 4.0, y[given] + 9.0, 10.0)
        simulated = found.simulate(Recording(u[held_out] + 4.0, y[held_out] + 9.0, 10.0))
        orders = {"nb": 2, "nf": 2, "nk": 1}
        oracle = estimate(u[given], y[given], orders, structure="oe", sampling_rate=10.0)
        errors = (
            error_percent(truth[held_out] + 9.0, simulated),
            error_percent(truth[held_out], oracle.model.simulate(u)[held_out]),
        )
        ratios.append(errors[0] / errors[1])
    assert np.exp(np.mean(np.log(ratios))) < 1.2


def test_decisions_have_a_json_form(resonance):
    decisions = resonance[0].decisions
    assert from_json(tuple[Decision, ...], to_json(decisions))[0] == decisions[0]
    assert len({each.subject for each in decisions}) == len(decisions)
    assert all(each.sentence.endswith(".") for each in decisions)


def test_a_choice_has_a_json_form(resonance):
    choice = resonance[0].choice
    again = from_json(Choice, to_json(choice))
    assert again.candidate.orders == choice.candidate.orders
    assert np.array_equal(again.candidate.model.parameters, choice.candidate.model.parameters)


def test_the_same_record_gives_the_same_bits(resonance):
    found, u, y, _ = resonance
    again = identify(u[:SAMPLES] + 4.0, y[:SAMPLES] + 9.0, 10.0)
    assert np.array_equal(again.model.parameters, found.model.parameters)


def test_the_arrays_are_not_changed_and_gaps_are_allowed():
    u, y, _ = output_error_record(80)
    y[30:35] = np.nan
    before = u.copy(), y.copy()
    found = identify(u, y)
    assert len(found.prepared.stretches) == 2
    assert np.array_equal(u, before[0])
    assert np.array_equal(y, before[1], equal_nan=True)


def test_a_chirp_gets_interleaved_folds():
    t = np.arange(1000.0)
    u = np.sin(0.02 * t + 0.0007 * t**2)
    plan = decide_folds([Segment(u, lfilter([0.0, 1.0], [1.0, -0.5], u))])
    assert all(blocks > 1 for _, blocks in plan.designs)


def test_feedback_does_not_lead_to_an_output_error_model():
    generator = np.random.default_rng(8)
    n = 600
    reference, e = np.repeat(generator.choice([-1.0, 1.0], n // 8), 8), generator.standard_normal(n)
    noise = lfilter([1.0, 0.4], [1.0, -1.7, 0.8], 0.3 * e)
    u, x = np.zeros(n), np.zeros(n)
    for t in range(2, n):
        x[t] = 1.7 * x[t - 1] - 0.8 * x[t - 2] + 0.3 * u[t - 1] + 0.2 * u[t - 2]
        u[t] = reference[t] - 0.3 * (x[t] + noise[t])
    stretches = [Segment(u, x + noise)]
    plan = FoldPlan(((2, 1),), ABOUT, decide_repetition(stretches))
    scorer = Scorer(stretches, plan, FitSettings())
    searches = [
        StructureSearch(structure, tuple(scorer.candidate(structure, o) for o in orders), ABOUT)
        for structure, orders in (
            ("armax", [Orders(na=n, nb=n, nc=n, nk=1) for n in (1, 2, 3)]),
            ("oe", [Orders(nb=n, nf=n, nk=1) for n in (1, 2, 3, 6)]),
        )
    ]
    chosen = compare_structures(scorer, searches).choice("simulation").candidate
    assert chosen.structure == "armax"
    assert error_percent(x, simulated(chosen.model, Segment(u, x), fitted_level=True)[:, 0]) < 25.0


def test_an_unknown_purpose_is_refused():
    u, y, _ = output_error_record(100)
    with pytest.raises(InputError, match="purpose"):
        identify(u, y, purpose="control")
