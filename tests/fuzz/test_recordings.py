"""Random recordings through preparation, search and validation: a finite model, or one sentence."""

import json
import re
import warnings

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from evopem.config.order_grid import check_samples, sample_requirements, scoring_window
from evopem.config.settings import (
    DatasetSettings,
    DelaySettings,
    OrderGrid,
    OrderSettings,
    PreparationSettings,
    SearchSettings,
    SpectrumSettings,
    SplitSettings,
    SyntheticSource,
    TransformSettings,
)
from evopem.errors import InputError
from evopem.estimation.model_record import ModelRecord
from evopem.estimation.order_selection import complete_estimate, estimate_candidates
from evopem.files.json_form import to_json
from evopem.models.armax import Orders
from evopem.signals.preparation import prepare
from evopem.signals.recording import Recording, check_recording
from evopem.signals.spectral.multitaper import multitaper_spectrum
from evopem.signals.spectral.peaks import summarize_spectrum
from evopem.validation.validation import validate

ORDERS = Orders(2, 2, 1, 1)
GRID = OrderGrid(DelaySettings((2, 2), (0, 1)), OrderSettings((2, 2), (1, 2), (1, 2)))


@st.composite
def signals(draw, samples):
    """A signal of many kinds: noise, steps, sines, trends, few levels, spikes, at any scale."""
    generator = np.random.default_rng(draw(st.integers(0, 2**32)))
    white = generator.standard_normal(samples)
    steps = np.arange(samples)
    kind = draw(
        st.sampled_from(["white", "walk", "sine", "levels", "spikes", "step", "trend", "constant"])
    )
    signal = {
        "white": white,
        "walk": np.cumsum(white),
        "sine": np.sin(draw(st.floats(0.001, 3.1)) * steps),
        "levels": np.round(white * draw(st.floats(0.1, 4))),
        "spikes": np.where(generator.random(samples) < 0.01, 1.0, 0.0),
        "step": np.where(steps < draw(st.integers(0, samples)), 0.0, 1.0),
        "trend": steps + draw(st.floats(0, 10)) * white,
        "constant": np.ones(samples),
    }[kind]
    exponent = draw(st.sampled_from([0, 0, 0, -300, -70, -50, -10, 10, 50, 70, 300]))
    offset = draw(st.sampled_from([0.0, 0.0, 1.0, -1e3, 1e12]))
    with np.errstate(over="ignore"):
        return (signal + offset) * 10.0**exponent


@st.composite
def recordings(draw):
    samples = draw(st.integers(1, 400))
    u = draw(signals(samples))
    y = draw(st.none() | signals(samples))
    if y is None:
        generator = np.random.default_rng(draw(st.integers(0, 2**32)))
        noise = draw(st.sampled_from([0.0, 1e-9, 0.1, 1.0])) * np.abs(u).max()
        with np.errstate(all="ignore"):
            y = lfilter([0, 1, 0.5], [1, -1.5, 0.7], u) + noise * generator.standard_normal(samples)
    return Recording(u, y, draw(st.sampled_from([0.001, 1.0, 100.0, 1e6])))


@given(
    recordings(),
    st.builds(
        TransformSettings,
        box_cox=st.sampled_from(["none", "auto", 1.1, 0, -2.5]),
        difference=st.integers(0, 4),
        difference_input=st.integers(0, 4),
    ),
    st.builds(
        SplitSettings,
        discard=st.integers(0, 50) | st.floats(0.01, 0.9),
        estimation=st.integers(1, 400) | st.floats(0.1, 0.9),
    ),
    st.sampled_from(["absolute", "quadratic"]),
    st.sampled_from(["arx", "incremental_order"]),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_any_recording_gives_a_finite_model_or_one_sentence(
    recording, transforms, split, objective, initialization
):
    search = SearchSettings(
        objective=objective,
        initialization=initialization,
        mu=3,
        lambda_=6,
        nu=2,
        evaluations=60,
        n_initial_discard=5,
    )
    preparation = PreparationSettings(transforms, split)
    bench = DatasetSettings(
        "bench", SyntheticSource("armax"), preparation, SpectrumSettings(), GRID, search
    )
    window = scoring_window(bench)
    try:
        check_recording(recording, "bench.csv")
        prepared = prepare(recording, preparation, place="datasets.bench")
        counts = (prepared.estimation.samples, prepared.validation.samples)
        check_samples(sample_requirements(bench), *counts, "datasets.bench")
    except InputError as refused:
        refusal = str(refused)
    else:
        refusal = ""
    if refusal:
        assert re.fullmatch(r"(bench\.csv|datasets\.bench\.).*: .+; .+\.", refusal)
        return
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        spectrum = summarize_spectrum(multitaper_spectrum(prepared.estimation.output, 1.0, 2.0, 64))
        data = prepared.estimation
        (candidate,) = estimate_candidates(data, [ORDERS], "nb", search, window)
        found = complete_estimate(candidate, data, search, window)
        validation, _ = validate(found.model, prepared, window.loss_start)
    record = ModelRecord.of(found, search, prepared.transforms)
    written = to_json((spectrum, candidate, record, validation))
    assert json.loads(json.dumps(written, allow_nan=False))
    assert np.isfinite(record.model.parameters).all()
    assert np.isfinite(validation.prediction_error_percent)
    assert np.abs(found.model.poles()).max() < 1.0
    assert np.abs(found.model.noise_zeros()).max() < 1.0
