"""Recordings with missing samples: stretches between them, with what was recorded between."""

import numpy as np
import pytest

import evopem
from evopem.config.channels import ChannelSettings
from evopem.config.settings import PreparationSettings, SplitSettings
from evopem.errors import InputError
from evopem.signals.faulty_samples import without_missing
from evopem.signals.preparation import prepare
from evopem.signals.prepared_data import measured_outputs
from evopem.signals.reading import read_measured
from evopem.signals.recording import Recording
from evopem.signals.transforms import output_levels

N, RATE = 4000, 50.0
LOST = [0, 700, 701, 1480, 2810, 2830]
CHANNELS = ChannelSettings(("u",), ("y",), sampling_rate=RATE)
A, B = [1.0, -1.5, 0.9], [0.0, 1.0, 0.5]


def signals():
    from scipy.signal import lfilter

    u, e = np.random.default_rng(7).standard_normal((2, N))
    return u, lfilter(B, A, u) + lfilter([1.0], A, 0.05 * e) + 40.0


def written(path, lost=LOST, columns=(0, 1), fields=("nan", "", "inf", "9.91E37"), rows=N):
    u, y = (signal[:rows] for signal in signals())
    values = [[repr(float(each)) for each in row] for row in zip(u, y, strict=True)]
    for number, sample in enumerate(lost):
        values[sample][columns[number % len(columns)]] = fields[number % len(fields)]
    path.write_text("u,y\n" + "".join(f"{','.join(row)}\n" for row in values))
    return path


def test_stretches_between_missing_samples(tmp_path):
    u, y = signals()
    recording, origin = read_measured(written(tmp_path / "r.csv"), CHANNELS)
    expected = [(1, 700), (702, 1480), (1481, 2810), (2831, N)]  # 19 samples are no stretch
    assert origin.left_out == N - sum(stop - first for first, stop in expected)
    assert recording.segment_firsts == tuple(first for first, _ in expected)
    assert recording.segment_recordings == (0, 0, 0, 0)
    for segment, (first, stop) in zip(recording.segments, expected, strict=True):
        np.testing.assert_array_equal(segment.output, y[first:stop])
        np.testing.assert_array_equal(segment.input, u[first:stop])
    np.testing.assert_allclose(
        recording.times * RATE, np.concatenate([range(*e) for e in expected])
    )


@pytest.mark.parametrize("lost", [range(0, N, 8), range(450)])
def test_too_many_missing_samples_are_refused(tmp_path, lost):
    with pytest.raises(InputError, match=r"% of the recording are lost, and up to 10 % may be"):
        read_measured(written(tmp_path / "r.csv", lost), CHANNELS)


def test_a_refusal_tells_the_share_that_is_lost_without_filling(tmp_path):
    """With the gaps of ten samples filled it would be 20 %."""
    lost = [*range(61, 71), *range(100, 110), *range(200, 220), *range(260, 280)]
    path = written(tmp_path / "r.csv", lost, columns=(1,), rows=400)
    with pytest.raises(InputError, match=r"without the 60 such .* 32 % of the recording are lost"):
        read_measured(path, CHANNELS)


@pytest.mark.parametrize("together", [1, 3])
def test_scattered_missing_samples_are_filled(tmp_path, together):
    """2 % of the samples of the output, so close that hardly a stretch is long enough."""
    _, y = signals()
    starts = np.arange(10, N - 10, 50 * together)
    starts += np.random.default_rng(2).integers(0, 9, starts.size)
    lost = [first + k for first in starts for k in range(together)]
    path = written(tmp_path / "r.csv", lost, columns=(1,))
    recording, origin = read_measured(path, CHANNELS)
    if together == 3:  # stretches of some 150 samples are long enough
        assert (origin.segments, origin.filled) == (26, 0)
        return
    assert (recording.samples, origin.segments, origin.left_out) == (N, 1, 0)
    assert origin.filled == len(lost)
    filled = np.isin(np.arange(N), lost)
    np.testing.assert_array_equal(recording.output[~filled], y[~filled])
    # The smallest standard deviation that an interpolation by the true model has.
    error = recording.output[filled] - y[filled]
    assert 0.0 < error.std() < 1.3 * 0.05 / np.linalg.norm(A)


def test_missing_samples_in_sequence_are_filled_as_the_system_would_move(tmp_path):
    """Splines know nothing of the input: they are off by a fifth of the output here."""
    _, y = signals()
    lost = [first + k for first in range(30, N - 30, 60) for k in range(2)]
    recording, origin = read_measured(
        written(tmp_path / "r.csv", lost, columns=(1,), fields=("nan",)), CHANNELS
    )
    assert origin.filled == len(lost)
    error = recording.output[lost] - y[lost]
    effects = np.array([[*A, 0.0], [0.0, *A]])
    smallest = 0.05 * np.sqrt(np.linalg.inv(effects @ effects.T).diagonal().mean())
    assert error.std() < 1.3 * smallest < 0.1 * y.std()


def test_a_short_recording_keeps_the_parts_between_long_gaps(tmp_path):
    """Else a fifth would be lost: the input, which no model predicts, is not filled so far."""
    lost = [*range(40, 45), *range(80, 87)]

    def read(column):
        path = written(tmp_path / f"{column}.csv", lost, columns=(column,), rows=260)
        return read_measured(path, CHANNELS)

    recording, origin = read(1)
    assert (recording.samples, origin.segments, origin.filled) == (260, 1, 12)
    error = recording.output[lost] - signals()[1][lost]
    assert error.std() < 0.2 * signals()[1].std()
    with pytest.raises(InputError, match=r"% of the recording are lost"):
        read(0)


def test_a_long_gap_beside_scattered_missing_samples_stays_one(tmp_path):
    lost = [*range(10, 3000, 40), *range(3200, 3204)]
    path = written(tmp_path / "r.csv", lost, columns=(0,))
    recording, origin = read_measured(path, CHANNELS)
    assert recording.segment_firsts == (0, 3204)
    assert (origin.filled, origin.left_out) == (75, 4)


@pytest.mark.parametrize("resample", [None, RATE / 2])
@pytest.mark.parametrize("difference", [0, 1])
def test_prepared_stretches_lead_back_to_measured_samples(tmp_path, resample, difference):
    recording = read_measured(written(tmp_path / "r.csv"), CHANNELS)[0]
    settings = PreparationSettings(split=SplitSettings(estimation=0.75, discard=100))
    transforms = settings.transforms.__class__(box_cox="none", difference=difference)
    settings = settings.__class__(split=settings.split, transforms=transforms, resample=resample)
    prepared = prepare(recording, settings)
    record = prepared.transforms
    assert record.validation_source == "gap"
    assert not record.several_recordings
    assert prepared.before_validation is None
    means = {each.output_means for each in (*record.estimation, *record.validation)}
    assert len(means) == 1
    _, y = signals()
    for part, origins in (
        (prepared.estimation, record.estimation),
        (prepared.validation, record.validation),
    ):
        assert [each.first for each in part.segments] == [each.first for each in origins]
        for segment, origin in zip(part.segments, origins, strict=True):
            measured = measured_outputs(record, origin, segment.outputs)[difference:, 0]
            assert origin.start == pytest.approx(
                origin.first / record.sampling_rate, abs=0.51 / record.sampling_rate
            )
            if resample is None:
                found = y[origin.first : origin.first + origin.samples]
                np.testing.assert_allclose(measured, found, atol=1e-8)
    share = record.estimation_samples / (record.estimation_samples + record.validation_samples)
    assert share == pytest.approx(0.75, abs=0.01)


def test_the_level_of_stretches_is_that_of_the_whole(tmp_path):
    recording = read_measured(written(tmp_path / "r.csv"), CHANNELS)[0]
    (level,) = output_levels(recording)
    assert level == pytest.approx(40.0 + 3.75 * recording.input.mean(), abs=0.05)


def test_a_mode_is_found_beside_gaps():
    """Masked samples are missing samples; the model predicts and simulates as without the gaps."""
    u, y = (each[:2000] for each in signals())
    lost = [number for number in LOST if number < 2000]
    masked = np.ma.masked_array(y, np.isin(np.arange(2000), lost))
    masked.data[lost] = 9999.0
    keys = {
        "recipe": "chapter",
        "transforms": {"box_cox": "none", "difference": 0},
        "split": {"discard": 0},
        "spectrum": {"nfft": 512},
        "delay": {"orders": [2, 2], "nk": [1, 1]},
        "orders": {"plant": [2, 2], "nc": [2, 2], "nb": [2, 2]},
        "search": {"evaluations": 100, "mu": 3, "lambda": 6, "nu": 2},
    }
    found = evopem.identify(u, masked, RATE, show_progress=False, **keys)
    frequency = abs(np.log(np.roots(A)[0])) * RATE / 2 / np.pi
    assert found.modes["frequency_hz"].iloc[0] == pytest.approx(frequency, rel=2e-3)
    (origin,) = found.results.recording_info.files
    assert (origin.segments, origin.left_out) == (3, 4)
    validation = found.results.validation
    assert len(validation.stretches) == len(found.results.model.transforms.validation)
    assert validation.simulation_error_percent < 15.0


@pytest.mark.parametrize("inputs", [0, 1])
def test_gaps_of_an_output_that_hardly_moves_are_filled(inputs):
    """More than half of the residuals of an ARX model are 0: they have no size."""
    generator = np.random.default_rng(0)
    y, u = 1.0 * (generator.random((600, 1)) < 0.2), np.zeros((600, inputs))
    y[40::41], u[:60] = np.nan, generator.standard_normal((60, inputs))
    recording, filled = without_missing(Recording(u, y, 10.0), "a.csv")
    assert filled == 14
    assert np.isfinite(recording.outputs).all()
