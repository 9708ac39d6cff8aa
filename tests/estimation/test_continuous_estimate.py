"""Direct estimates in continuous time: exact derivatives, and systems that are known."""

import numpy as np
import pytest
from scipy.signal import cont2discrete, lfilter

from evopem import InputError, PolynomialModel, Recording, SearchSettings
from evopem.estimation.continuous import (
    ContinuousProblem,
    Path,
    estimate_continuous,
    in_continuous_time,
)
from evopem.signals.recording import Segment

RATE = 10.0
DEN = np.convolve([3.0, 1.0], [1.0, 0.8, 4.0])
FINE = 50


def steps(samples, seed, hold=20):
    generator = np.random.default_rng(seed)
    return np.repeat(generator.choice([-1.0, 1.0], samples // hold + 1), hold)[:samples]


def response(num, den, u, delay=0.0):
    """Of a transfer function with a delay that is a multiple of 1/50 of the sample, from rest."""
    above, below, _ = cont2discrete((num, den), 1.0 / (FINE * RATE))
    y = lfilter(np.ravel(above), below, np.repeat(u, FINE))
    late = round(delay * FINE * RATE)
    return np.concatenate([np.zeros(late), y])[: len(y) : FINE]


def joined(noise=0.0):
    """Two inputs, two segments of one recording."""
    generator, segments = np.random.default_rng(0), []
    for number in range(2):
        u = np.column_stack([steps(300, 10 + number), steps(300, 20 + number, 13)])
        y = response([2.0, 4.0], DEN, u[:, 0], 0.46) + response([1.0], DEN, u[:, 1])
        y = y + 0.5 + noise * generator.standard_normal(300)
        segments.append(Segment(u, y, 0, 400 * number))
    return Recording(u, y, RATE).with_segments(segments)


def problem(hold="zero-order"):
    paths = (Path(2, 4.3, hold == "zero-order"), Path(1))
    start = np.array([-0.1, 1.2, 0.3, *([4.3] if hold == "zero-order" else [])])
    return ContinuousProblem(joined(0.1), hold, paths, start, 1.3)


@pytest.mark.parametrize("hold", ["zero-order", "first-order"])
def test_derivatives_are_those_of_central_differences(hold):
    searched = problem(hold)
    fit = searched.projection(searched.start)
    along = searched.jacobian(searched.start, fit)
    gradient = 2.0 * along.T @ fit.errors
    for place in range(len(searched.start)):
        move = np.zeros(len(searched.start))
        move[place] = 1e-5
        ends = [searched.projection(searched.start + sign * move).errors for sign in (1, -1)]
        expected = (ends[0] @ ends[0] - ends[1] @ ends[1]) / 2e-5
        assert np.isclose(gradient[place], expected, rtol=1e-5, atol=1e-6)


def test_two_inputs_of_two_segments_with_a_delay_within_a_sample():
    paths = [Path(2, 3.0, has_free_delay=True), Path(1)]
    model = estimate_continuous(joined(), paths, np.array([-1.0, -1 + 1j, -1 - 1j]))
    assert np.allclose(model.delays, [0.46, 0.0], atol=1e-4)
    assert np.isclose(model.level[0], 0.5, atol=1e-3)
    first, second = (
        {quantity.name: quantity.value for quantity in model.quantities(0, place)}
        for place in range(2)
    )
    assert np.isclose(first["static gain"], 1.0, rtol=1e-3)
    assert np.isclose(second["static gain"], 0.25, rtol=1e-3)
    for path in (first, second):
        assert np.isclose(path["time constant"], 3.0, rtol=1e-3)
        assert np.isclose(path["natural frequency"], 1.0 / np.pi, rtol=1e-3)
        assert np.isclose(path["damping ratio"], 0.2, rtol=1e-3)
    assert np.allclose(model.transfer_function(0, 1).num[:3], 0.0)


def test_standard_errors_cover_the_truth():
    u, hits, start = steps(300, 3), [], np.array([0.0, 4.6])
    generator = np.random.default_rng(8)
    clean = response([2.0], [3.0, 1.0], u, 0.46)
    for _ in range(100):
        data = Recording(u, clean + 0.1 * generator.standard_normal(300), RATE)
        searched = ContinuousProblem(data, "zero-order", (Path(1, 4.5, True),), start, 0.4)
        model = searched.model(searched.polish(start[None]).points[0])
        for quantity, truth in zip(model.quantities(), (2.0, 3.0, 0.46), strict=True):
            hits.append(abs(quantity.value - truth) < 1.96 * quantity.standard_error)
    # 95 % of 300 intervals, within three standard deviations of 100 independent ones.
    assert abs(np.mean(hits) - 0.95) < 3.0 * np.sqrt(0.95 * 0.05 / 100)


def test_what_has_no_counterpart_is_estimated_directly():
    u = steps(600, 5)
    data = Recording(u, response([2.0], [3.0, 1.0], u, 0.1), RATE)
    sampled = PolynomialModel(
        np.ones(1), [0.1, 0.1], F=np.poly([0.97, -0.3]), nk=2, sampling_rate=RATE
    )
    with pytest.raises(InputError, match="a real pole at z"):
        sampled.to_continuous()
    found = in_continuous_time(sampled, data, "zero-order", SearchSettings(mu=4))
    assert (found.method, len(found.model.A)) == ("estimate", 1)
    assert "real pole at z = -0.3" in found.reason
    assert np.isclose(found.model.static_gain()[0], 2.0, rtol=1e-3)


def test_fast_samples_are_estimated_directly_and_others_converted():
    u = steps(600, 6)
    data = Recording(u, response([2.0], [1.0, 1.0], u), RATE)
    above, below, _ = cont2discrete(([2.0], [1.0, 1.0]), 1.0 / RATE)
    model = PolynomialModel(below, np.ravel(above)[1:], nk=1, sampling_rate=RATE)
    settings = SearchSettings(mu=4)
    assert in_continuous_time(model, data, "zero-order", settings).method == "conversion"
    slow = PolynomialModel([1.0, -0.95], [0.1], nk=1, sampling_rate=RATE)
    found = in_continuous_time(slow, data, "zero-order", settings)
    assert found.method == "estimate"
    assert np.isclose(found.model.quantities()[1].value, 1.0, rtol=1e-3)


def test_what_is_not_estimated_directly_is_converted_or_refused():
    data, settings = Recording(steps(50, 1), steps(50, 2), RATE), SearchSettings(mu=4)
    integrator = PolynomialModel([1.0, -1.0], [0.1], nk=1, sampling_rate=RATE)
    found = in_continuous_time(integrator, data, "zero-order", settings)
    assert found.method == "conversion"
    assert np.isinf(found.model.static_gain()[0])
    assert np.allclose(found.model.poles(), 0.0)
    growing = PolynomialModel(np.poly([1.01, -0.2]), [0.1], nk=1, sampling_rate=RATE)
    found = in_continuous_time(growing, data, "zero-order", settings)
    assert found.model is None
    assert "z = -0.2" in found.reason


def test_a_delay_at_its_limit_is_none():
    u = steps(300, 4)
    data = Recording(u, response([2.0], [3.0, 1.0], u), RATE)
    model = estimate_continuous(data, [Path(1, 0.4, True)], np.array([-0.4]))
    assert model.delays[0] == 0.0
