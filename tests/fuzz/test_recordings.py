"""Random recordings through preparation, search and validation: a finite model, or one sentence."""

import json
import re
import warnings

import numpy as np
from evopem.models.files import model_record
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.signal import lfilter

from evopem.config.order_grid import check_samples, sample_needs
from evopem.errors import InputError
from evopem.estimation.order_selection import estimate_candidates, recall
from evopem.signals.preparation import prepare
from evopem.signals.recording import Recording, check_recording
from evopem.signals.spectral.multitaper import multitaper_spectrum, spectral_peaks
from evopem.validation import validate

ORDERS = (2, 2, 1, 1)
GRID = {"delay": {"orders": [2, 2], "delays": [0, 1]}}
GRID["orders"] = {"common": [2, 2], "c": [1, 2], "b": [1, 2]}


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
    st.sampled_from(["none", "auto", 1.1, 0, -2.5]),
    st.integers(0, 4),
    st.integers(0, 4),
    st.integers(0, 50) | st.floats(0.01, 0.9),
    st.integers(1, 400) | st.floats(0.1, 0.9),
    st.sampled_from(["absolute", "quadratic"]),
)
@settings(max_examples=60, deadline=None, derandomize=True)
def test_any_recording_gives_a_finite_model_or_one_sentence(
    recording, box_cox, difference, difference_input, discard, estimation, objective
):
    search = {
        "objective": objective,
        "start": "grown",
        "mu": 3,
        "lambda": 6,
        "nu": 2,
        "mutate": "worst",
    }
    search |= {"evaluations": 60, "seed": 1, "max_root_radius": 0.9999, "burn_in": 5}
    stationarity = {
        "box_cox": box_cox, "difference": difference, "difference_input": difference_input
    }  # fmt: skip
    needs = sample_needs(GRID | {"search": search})
    try:
        check_recording(recording, "bench.csv")
        prepared = prepare(
            recording, stationarity, {"discard": discard, "estimation": estimation}, dataset="bench"
        )
        counts = (prepared.estimation.samples, prepared.validation.samples)
        check_samples(needs, *counts, "datasets.bench")
    except InputError as refused:
        refusal = str(refused)
    else:
        refusal = ""
    if refusal:
        assert re.fullmatch(r"(bench\.csv|datasets\.bench\.).*: .+; .+\.", refusal)
        return
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        spectral_peaks(multitaper_spectrum(prepared.estimation.output, 1.0, 2.0, 64))
        (candidate,) = estimate_candidates(
            prepared.estimation, [ORDERS], "b", search, needs["start"]
        )
        found = recall(candidate, prepared.estimation, search, needs["start"])
        validation = validate(found.model, prepared, scoring_start=needs["start"])
    json.dumps([candidate, model_record(found.model), validation.scalars()], allow_nan=False)
    assert np.abs(found.model.poles()).max() < 1.0
    assert np.abs(found.model.noise_zeros()).max() < 1.0
