from __future__ import annotations

import os
import time

import numpy as np
import pytest
from scipy.signal import lfilter

from evopem.errors import InputError
from evopem.files.atomic import load_arrays
from evopem.signals.recording import Recording, Segment, load_recording, save_recording
from evopem.signals.recording_checks import check_recording, saturated_share


def record(samples: int = 20, **changes) -> Recording:
    generator = np.random.default_rng(0)
    fields = {
        "inputs": generator.standard_normal(samples),
        "outputs": generator.standard_normal(samples),
        "sampling_rate": 100.0 / 3.0,
        "input_names": ("Drehmoment µ",),
        "output_units": ("m/s²",),
    }
    return Recording(**(fields | changes))


def test_a_recording_survives_its_file_bit_by_bit(tmp_path):
    recording = record()
    save_recording(recording, tmp_path / "deep" / "recording.npz")
    loaded = load_recording(tmp_path / "deep" / "recording.npz")
    assert loaded.input.tobytes() == recording.input.tobytes()
    assert loaded.output.tobytes() == recording.output.tobytes()
    assert loaded.sampling_rate == recording.sampling_rate
    for field in ("input_names", "output_names", "input_units", "output_units"):
        assert getattr(loaded, field) == getattr(recording, field)


def test_equal_recordings_give_equal_bytes(tmp_path, monkeypatch):
    save_recording(record(), tmp_path / "a.npz")
    later = time.time() + 10_000
    monkeypatch.setattr(time, "time", lambda: later)
    save_recording(record(), tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_a_failed_write_leaves_the_old_file_alone(tmp_path, monkeypatch):
    path = tmp_path / "recording.npz"
    save_recording(record(), path)
    before = path.read_bytes()

    def fail(file, **arrays):
        file.write(b"half")
        raise OSError("disk full")

    monkeypatch.setattr(np, "savez", fail)
    with pytest.raises(
        InputError, match=r"recording.npz: cannot be written \(disk full\); free disk space"
    ):
        save_recording(record(30), path)
    assert path.read_bytes() == before
    assert os.listdir(tmp_path) == ["recording.npz"]  # noqa: PTH208


def test_missing_damaged_and_foreign_files_are_refused(tmp_path):
    path = tmp_path / "recording.npz"
    with pytest.raises(InputError, match="no such file"):
        load_recording(path)
    save_recording(record(), path)
    whole = path.read_bytes()
    for length in (0, 1, 50, len(whole) // 2, len(whole) - 1):
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match="not a readable array file"):
            load_recording(path)
    np.savez(path, inputs=np.ones(3))
    with pytest.raises(InputError, match="output"):
        load_recording(path)
    np.savez(path, allow_pickle=True, a=np.array([object()], dtype=object))
    with pytest.raises(InputError):
        load_arrays(path, ("a",))


def test_channels_of_one_name_are_refused():
    with pytest.raises(ValueError, match="inputs have one name twice: a, a"):
        Recording(np.ones((9, 2)), np.ones(9), 1.0, input_names=("a", "a"))


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"outputs": np.full(20, 3.5)}, 'output "output": every sample is 3.5'),
        ({"inputs": np.where(np.arange(20) == 4, np.inf, 1.0)}, "sample 5: the value is inf"),
        ({"inputs": np.arange(3.0), "outputs": np.arange(3.0)}, "only 3 samples"),
    ],
)
def test_what_cannot_be_identified_is_refused(changes, expected):
    check_recording(record(), "file.csv")
    with pytest.raises(InputError, match=expected) as caught:
        check_recording(record(**changes), "file.csv")
    assert str(caught.value).startswith("file.csv")


def test_inputs_and_outputs_have_one_length():
    with pytest.raises(ValueError, match="19 input samples, 20 output samples"):
        record(inputs=np.arange(19.0))


@pytest.mark.parametrize("scale", [1e200, 1e-200])
def test_values_that_cannot_be_squared_are_refused(scale):
    signal = np.random.default_rng(1).standard_normal(50)
    with pytest.raises(InputError, match="leave the range of numbers; record in another unit"):
        check_recording(Recording(signal, scale * signal, 100.0), "r.csv")


def test_a_channel_cut_off_shows_in_its_saturated_share():
    signal = np.sin(0.1 * np.arange(1000))
    assert saturated_share(signal) == 0.0
    clipped = np.clip(signal, -0.8, 0.8)
    assert saturated_share(clipped) == np.mean(np.abs(signal) >= 0.8)
    # An input at 0 is switched off, an output there may be cut off.
    switched = np.maximum(signal, 0.0)
    assert saturated_share(switched, is_input=True) == 0.0 < saturated_share(switched)
    # A rudder that is put over from one side to the other is not saturated at both.
    rudder = np.clip(4.0 * signal, -1.0, 1.0)
    assert saturated_share(rudder, is_input=True) == 0.0 < saturated_share(rudder)
    assert saturated_share(clipped, is_input=True) > 0.3


def test_the_top_of_a_wave_in_coarse_steps_is_not_called_saturated():
    slow = lfilter([0.05], [1.0, -0.95], np.random.default_rng(3).standard_normal(3000))
    smooth = lfilter([0.2], [1.0, -0.8], slow / slow.std())
    found = [
        [saturated_share(np.round(part / 0.1) * 0.1) for part in (piece, np.clip(piece, -0.8, 0.8))]
        for piece in smooth.reshape(10, 300)
    ]
    whole, cut = np.array([pair for pair in found if pair[1] > 0.0]).T
    assert len(cut) >= 7
    assert np.count_nonzero(whole) == 0


def test_a_signal_of_a_few_levels_is_not_called_saturated():
    telegraph = np.repeat(np.random.default_rng(1).choice([-1.0, 1.0], 100), 10)
    assert saturated_share(telegraph) == 0.0
    white = np.random.default_rng(1).standard_normal(1000)
    assert saturated_share(np.round(white * 20) / 20) == 0.0
    # Random steps rest at every level, the lowest and the highest ones among them.
    assert saturated_share(np.repeat(white[:50], 20)) == 0.0
    # Coarse steps of an instrument keep a slow signal for as long at other values.
    slow = np.convolve(np.cumsum(white), np.ones(20))[::-1]
    assert saturated_share(np.round(0.3 * slow)) == 0.0
    assert saturated_share(np.round(0.3 * np.minimum(slow, np.quantile(slow, 0.9)))) > 0.09
    assert saturated_share(np.append(np.zeros(20), white**2)) == 0.0, "at rest before it begins"


def test_masked_samples_are_missing():
    """What stands under a mask is no sample."""
    masked = np.ma.masked_equal([0.0, 9999.0, 1.0], 9999.0)
    for values in (Recording(masked, masked, 1.0), Segment(masked, masked)):
        assert np.isnan(values.outputs[1, 0])
        assert np.isnan(values.inputs[1, 0])


def test_an_input_of_several_may_rest_in_a_measured_recording():
    """It may be for validation; estimation samples are judged as they are prepared."""
    inputs = np.column_stack([np.ones(20), np.arange(20.0)])
    two = record(inputs=inputs, input_names=("a", "b"), input_units=("", ""))
    check_recording(two, "r.csv", measured=True)
    with pytest.raises(InputError, match="every sample is 1"):
        check_recording(two, "r.csv")
    with pytest.raises(InputError, match="every sample is 1"):
        check_recording(record(inputs=np.ones(20)), "r.csv", measured=True)
