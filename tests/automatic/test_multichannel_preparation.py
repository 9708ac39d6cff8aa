"""Preparation of several channels: a rest at the start, resampling, decimation, division."""

import numpy as np
import pytest

from evopem.automatic.multichannel_preparation import (
    MultichannelPlan,
    apply_multichannel_plan,
    decide_multichannel_preparation,
)
from evopem.config.settings import SplitSettings
from evopem.errors import InputError
from evopem.signals.multichannel_preparation import divide_multichannel
from evopem.signals.recording import Recording

RATE, N = 100.0, 1200
WHOLE = SplitSettings(discard=0, estimation=1.0)


def recording(samples=N, rest=0, seed=1):
    generator = np.random.default_rng(seed)
    u = generator.standard_normal((samples, 2))
    y = generator.standard_normal((samples, 3)) + 5.0
    u[:rest], y[:rest] = 0.0, 5.0
    return Recording(u, y, RATE, ("u1", "u2"), ("a", "b", "c"), ("N", "N"), ("m", "m", ""))


def test_a_rest_before_the_first_change_is_left_out_up_to_ten_samples():
    plan = decide_multichannel_preparation(recording(rest=60), False, rate_given=True)
    assert (plan.starts, plan.factor) == ((50,), 1)
    given = decide_multichannel_preparation(recording(rest=60), True, rate_given=True)
    assert given.starts == (0,)


def test_white_signals_are_not_decimated():
    plan = decide_multichannel_preparation(recording(), False, rate_given=False)
    assert plan.factor == 1
    assert plan.decisions[1].sentence.endswith("the record is not oversampled.")


def test_both_parts_lose_the_means_of_the_first():
    divided = divide_multichannel(
        recording(), SplitSettings(discard=100, estimation=0.5), None, None, "datasets.a"
    )
    assert (divided.estimation.samples, divided.validation.samples) == (550, 550)
    np.testing.assert_allclose(divided.estimation.outputs.mean(axis=0), 0.0, atol=1e-12)
    whole = recording()
    means = whole.outputs[100:650].mean(axis=0)
    np.testing.assert_allclose(divided.validation.outputs, whole.outputs[650:] - means)
    np.testing.assert_allclose(divided.transforms.output_means, means)
    assert divided.transforms.validation_source == "cut"


def test_resampling_and_decimation_keep_all_channels_together():
    divided = divide_multichannel(recording(), WHOLE, 50.0, recording(seed=2), "datasets.a")
    assert divided.estimation.sampling_rate == 50.0
    assert divided.estimation.inputs.shape == (600, 2)
    assert divided.estimation.outputs.shape == (600, 3)
    found = apply_multichannel_plan(divided, MultichannelPlan((100,), 5, ()))
    assert found.estimation.sampling_rate == 10.0
    assert found.estimation.outputs.shape == (100, 3)
    assert found.validation.outputs.shape == (120, 3)
    assert found.transforms.decimation == 5
    assert found.transforms.discard == 100
    np.testing.assert_allclose(found.estimation.outputs.mean(axis=0), 0.0, atol=1e-12)


@pytest.mark.parametrize(
    ("validation", "says"),
    [
        (recording(), "its samples are those of the estimation recording"),
        (recording(seed=2).between(0, 4), "there are only 4 samples"),
    ],
)
def test_validation_recordings_that_serve_nothing_are_refused(validation, says):
    with pytest.raises(InputError, match=says):
        divide_multichannel(recording(), WHOLE, None, validation, "datasets.a")
