"""Single wrong samples of an output: found, replaced, and told from what only looks like them."""

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.automatic.preparation.wrong_samples import decide_outliers
from evopem.config.settings import PreparationSettings, SplitSettings
from evopem.signals import faulty_samples
from evopem.signals.faulty_samples import without_outliers
from evopem.signals.preparation import prepare
from evopem.signals.recording import Recording, Segment

A, B = [1.0, -1.5, 0.8], [0.0, 1.0, 0.5]


def response(u, e, c=(1.0,), d=(1.0,)):
    return lfilter(B, A, u) + lfilter(c, d, e)


def wrong_at(generator, y, share=0.005):
    """Rows of wrong samples, more than half a deviation off, and the output with them."""
    hit = np.flatnonzero(generator.random(len(y)) < share)
    size = generator.uniform(0.5, 10.0, hit.size) * generator.choice([-1.0, 1.0], hit.size)
    changed = y.copy()
    changed[hit] += size * y.std()
    return hit, changed


@pytest.mark.parametrize(
    "noise",
    [
        {"c": [1.0, 0.4], "d": A},
        {"d": [1.0, -0.9]},
        {},
    ],
    ids=["ARMAX", "Box-Jenkins", "output error"],
)
def test_wrong_samples_are_found_and_replaced_within_the_noise(noise):
    g = np.random.default_rng(3)
    u, e = g.standard_normal((2, 2000))
    v = response(0.0 * u, e, **noise)
    y = response(u, 0.0 * e) + 0.1 * v / v.std()
    hit, changed = wrong_at(g, y)
    found = without_outliers([Segment(u, changed)])
    assert set(np.flatnonzero(found.replaced[0])) == set(hit)
    assert np.std((found.outputs[0][:, 0] - y)[hit]) < 0.3
    kept = np.setdiff1d(np.arange(2000), hit)
    np.testing.assert_array_equal(found.outputs[0][kept, 0], changed[kept])


def test_gaps_and_channels_are_independent():
    g = np.random.default_rng(5)
    u, e = g.standard_normal((2, 1500, 2))
    y = np.column_stack([response(u[:, 0], 0.1 * e[:, 0]), response(u[:, 1], 0.1 * e[:, 1])])
    changed = y.copy()
    changed[700:720] = np.nan
    changed[[300, 900], [0, 1]] += 40.0
    found = without_outliers([Segment(u[:800], changed[:800]), Segment(u[800:], changed[800:])])
    assert np.argwhere(np.concatenate(found.replaced)).tolist() == [[300, 0], [900, 1]]
    assert np.isnan(found.outputs[0][700:720]).all()


@pytest.mark.parametrize("beside", [-17, -16, -9, -1, 0, 1, 15, 16])
def test_ends_of_the_pieces_of_a_long_record_are_no_ends(beside, monkeypatch):
    monkeypatch.setattr(faulty_samples, "LONGEST_PIECE", 1000)
    g = np.random.default_rng(9)
    u, e = g.standard_normal((2, 2700))
    y = response(u, 0.1 * e)
    hit = [400, 1000 + beside, 2000 + beside]
    y[hit] += [9.0, -8.0, 7.0]
    y[[3, -1]] += 8.0  # at the ends of the record, where others are not to be taken for it
    found = without_outliers([Segment(u, y)])
    assert np.flatnonzero(found.replaced[0]).tolist() == hit


def heavy_tails(g, u):
    return response(u, 0.3 * g.standard_t(3, len(u)), d=A)


def load_steps(g, u):
    return response(u, np.repeat(3.0 * g.standard_normal(len(u) // 100), 100))


def unmeasured_blows(g, u):
    blows = np.zeros(len(u))
    blows[[200, 201, 900, 901, 1500, 1501]] = 30.0
    return response(blows, 0.05 * g.standard_normal(len(u)))


def friction(g, u):
    return np.sign(lfilter([0.0, 0.1], [1.0, -0.98], u)) + 0.01 * g.standard_normal(len(u))


def coarse_steps(g, u):
    return np.round(4.0 * response(u, 0.0 * u)) / 4.0


@pytest.mark.parametrize(
    "unusual", [heavy_tails, load_steps, unmeasured_blows, friction, coarse_steps]
)
def test_what_the_system_does_is_not_a_wrong_sample(unusual):
    for seed in range(5):
        g = np.random.default_rng(seed)
        u = g.standard_normal(2000)
        assert not without_outliers([Segment(u, unusual(g, u))]).replaced[0].any()


def test_a_sample_that_is_far_off_among_unusual_noise_is_replaced():
    """Its replacement leaves what chance leaves once in 1000 times, but a millionth of the rest."""
    g = np.random.default_rng(13)
    u, e = g.standard_normal((2, 2000))
    e[[502, 505, 508, 511]] = [4.0, -4.0, 4.0, -4.0]
    y = response(u, 0.02 * e)
    y[[500, 900, 1400]] += [20.0, -15.0, 10.0]
    found = without_outliers([Segment(u, y)])
    assert np.flatnonzero(found.replaced[0]).tolist() == [500, 900, 1400]


def test_a_sample_without_neighbours_on_both_sides_is_kept():
    g = np.random.default_rng(11)
    u, e = g.standard_normal((2, 1000))
    y = response(u, 0.02 * e)
    y[[1, 5, 500, 996]] += 8.0
    found = without_outliers([Segment(u, y)])
    assert np.flatnonzero(found.replaced[0]).tolist() == [500]


def test_normal_noise_has_no_wrong_sample():
    """Of 100,000 samples beyond five standard errors 0.06 are expected."""
    for seed in range(50):
        g = np.random.default_rng(seed)
        u, e = g.standard_normal((2, 2000))
        assert not without_outliers([Segment(u, response(u, e, d=[1.0, -0.5]))]).replaced[0].any()


def prepared(recording, validation=None):
    settings = PreparationSettings(split=SplitSettings(discard=0))
    return prepare(recording, settings, validation).transforms


@pytest.mark.parametrize("own_file", [False, True])
def test_each_part_is_cleaned_by_itself(own_file):
    g = np.random.default_rng(7)
    u, e = g.standard_normal((2, 1000))
    y = response(u, 0.1 * e)
    y[[300, 900]] += 30.0
    recording = Recording(u, y, 10.0)
    validation = Recording(u[500:], y[500:], 10.0) if own_file else None
    if own_file:
        recording = Recording(u[:500], y[:500], 10.0)
    cleaned, others, about = decide_outliers(recording, validation, prepared(recording, validation))
    changed = np.flatnonzero(cleaned.outputs != recording.outputs).tolist()
    if own_file:
        assert np.flatnonzero(others.outputs != validation.outputs).tolist() == [400]
    assert changed == ([300] if own_file else [300, 900])
    assert about.choice == "replaced"
    assert "at 2 times are wrong alone, 1 of them among those for validation" in about.sentence
    assert "(30 s, " in about.sentence
