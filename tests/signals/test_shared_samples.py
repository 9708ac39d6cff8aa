"""Validation on samples of the estimation is refused, whole or in part."""

import time

import numpy as np
import pytest

from evopem.errors import InputError
from evopem.signals.recording import Recording
from evopem.signals.recording_checks import check_independent, shared_start


def recording(rows):
    return Recording(
        inputs=rows[:, 0].copy(),
        outputs=rows[:, 1].copy(),
        sampling_rate=100.0,
        input_names=("u",),
        output_names=("y",),
    )


ROWS = np.random.default_rng(0).standard_normal((900, 2))


@pytest.mark.parametrize("part", [slice(None), slice(0, 500), slice(300, 800), slice(400, None)])
def test_a_copy_of_the_whole_or_a_part_is_refused_either_way(part):
    for one, other in ((ROWS, ROWS[part]), (ROWS[part], ROWS)):
        with pytest.raises(InputError, match=r"^datasets\.a\.validation_file: .+; .+\.$"):
            check_independent(recording(one), recording(other), "datasets.a.validation_file")


def test_the_place_is_found():
    assert shared_start(ROWS, ROWS[300:800]) == 300
    assert shared_start(ROWS[300:800], ROWS) == 300


def test_zeros_of_either_sign_are_equal():
    one, other = np.zeros((20, 2)), np.zeros((20, 2))
    one[:, 0] = -0.0
    one[7, 1] = other[7, 1] = 1.0
    assert shared_start(one, other) == 0


def test_one_other_sample_or_another_output_is_enough():
    other = ROWS.copy()
    other[450, 1] += 1e-12
    assert shared_start(ROWS, other) is None
    assert shared_start(ROWS, np.column_stack([ROWS[:, 0], ROWS[::-1, 1]])) is None


def test_the_same_excitation_with_another_answer_is_independent():
    answer = np.random.default_rng(1).standard_normal(900)
    check_independent(recording(ROWS), recording(np.column_stack([ROWS[:, 0], answer])), "v")


@pytest.mark.parametrize("kind", ["square", "ternary", "zeros then noise"])
def test_long_records_of_few_levels_take_a_second(kind):
    """Where many starts look alike for long."""
    generator = np.random.default_rng(2)
    samples = 200_000
    if kind == "square":
        signal = np.repeat(np.arange(samples // 50) % 2, 50).astype(float)
    elif kind == "ternary":
        signal = generator.integers(-1, 2, samples).astype(float)
    else:
        signal = np.r_[np.zeros(samples // 2), generator.standard_normal(samples // 2)]
    one = np.column_stack([signal, np.r_[np.zeros(3), signal[:-3]]])
    other = one[: samples // 2].copy()
    other[-1] += 0.5
    before = time.process_time()
    assert shared_start(one, other) is None
    assert time.process_time() - before < 5
